"""What a check of a scene tells: findings, and all of them as tables or JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

MOST_NAMES = 3
"""Meshes that a row of the table names before it only counts."""

MOST_PLACES = 5
"""Triangles that a finding names."""


class Level(Enum):
    """How bad it is.

    ERROR: a render refuses the scene. WARNING: worth a look: the picture may not be what was meant. NOTE: good to know;
    the picture is right.
    """

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


@dataclass(frozen=True)
class Finding:
    """One thing found at one place of a scene.

    Attributes:
        level: how bad it is.
        kind: a name for scripts: "zero-area", "open-solid", ...
        what: what is wrong, in words that are the same at every place.
        renderer: what a render does about it.
        advice: what can be done.
        mesh: the mesh it is in, or None.
        material: the material it is about, or None.
        count: how many (triangles, edges, ...); 1 for what cannot be counted.
        total: out of how many, or None.
        places: a few of the triangles, by their number in the mesh.
        detail: figures of this place.
    """

    level: Level
    kind: str
    what: str
    renderer: str
    advice: str
    mesh: str | None = None
    material: str | None = None
    count: int = 1
    total: int | None = None
    places: tuple[int, ...] = ()
    detail: str = ""


@dataclass(frozen=True)
class Checkup:
    """All that was found in a scene.

    Attributes:
        scene: its name.
        file: where it is from, if from a file.
        meshes, triangles: how many were looked at.
        findings: the worst first.
    """

    scene: str
    file: str | None
    meshes: int
    triangles: int
    findings: tuple[Finding, ...]

    @property
    def exit_code(self) -> int:
        """0 if nothing was found or notes only, 1 for warnings, 2 for errors."""
        levels = {finding.level for finding in self.findings}
        return 2 if Level.ERROR in levels else 1 if Level.WARNING in levels else 0

    def of(self, kind: str) -> tuple[Finding, ...]:
        """The findings of one kind."""
        return tuple(finding for finding in self.findings if finding.kind == kind)

    def to_json(self) -> str:
        """All of it as JSON."""
        return json.dumps(asdict(self) | {"exit_code": self.exit_code}, indent=2, default=_plain)

    def print(self, console: Console) -> None:
        """All of it as text: one entry for each kind of finding, whatever the number of meshes that it is in."""
        from rich.markup import escape
        from rich.table import Table

        source = f" ({self.file})" if self.file else ""
        title = f"{self.scene}{source}: {self.triangles:,} triangles in {self.meshes:,} meshes"
        console.print(f"[bold]{escape(title)}[/]", highlight=False)
        color = {Level.ERROR: "red", Level.WARNING: "yellow", Level.NOTE: "cyan"}
        for group in _by_kind(self.findings):
            first = group[0]
            console.print(f"\n[{color[first.level]}]{first.level.value}[/] {escape(first.what)}", highlight=False)
            lines = Table.grid(padding=(0, 1))
            lines.add_column(no_wrap=True)
            lines.add_column()
            for name, text in (("where:", _where(group)), ("render:", first.renderer), ("do:", first.advice)):
                if text:
                    lines.add_row(f"  {name}", escape(text))
            console.print(lines, highlight=False)
        counts = [_counted(sum(f.level is level for f in self.findings), level.value) for level in Level]
        console.print(f"\n{', '.join(counts)}" if self.findings else "\nnothing found", highlight=False)


def sorted_findings(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The worst first, those of a kind together, in the order in which kinds and places were found."""
    kept = list(findings)
    rank = {level: number for number, level in enumerate(Level)}
    first: dict[tuple[int, str, str], int] = {}
    for number, finding in enumerate(kept):
        first.setdefault(_group(finding, rank), number)
    return tuple(sorted(kept, key=lambda f: (rank[f.level], first[_group(f, rank)])))


def _group(finding: Finding, rank: dict[Level, int]) -> tuple[int, str, str]:
    return rank[finding.level], finding.kind, finding.what


def _by_kind(findings: Iterable[Finding]) -> list[list[Finding]]:
    groups: dict[tuple[Level, str, str], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.level, finding.kind, finding.what), []).append(finding)
    return list(groups.values())


def _where(group: list[Finding]) -> str:
    """The meshes with figures, the largest count first."""
    ordered = sorted(group, key=lambda finding: -finding.count)
    parts = [_place(finding) for finding in ordered[:MOST_NAMES]]
    if len(ordered) > MOST_NAMES:
        rest = sum(finding.count for finding in ordered[MOST_NAMES:])
        parts.append(f"{_counted(len(ordered) - MOST_NAMES, 'more mesh', 'more meshes')} ({rest:,})")
    return "; ".join(part for part in parts if part)


def _place(finding: Finding) -> str:
    names = []
    if finding.mesh is not None:
        names.append(f'mesh "{finding.mesh}"')
    if finding.material is not None:
        names.append(f'material "{finding.material}"')
    figures = ""
    if finding.total is not None:
        figures = f"{finding.count:,} of {finding.total:,}"
    elif finding.count > 1 or finding.places:
        figures = f"{finding.count:,}"
    if finding.places:
        figures += f" (triangles {', '.join(map(str, finding.places))}{', ...' if _more(finding) else ''})"
    return ": ".join(part for part in (", ".join(names), ", ".join(p for p in (figures, finding.detail) if p)) if part)


def _counted(count: int, name: str, names: str = "") -> str:
    return f"{count:,} {name if count == 1 else names or name + 's'}"


def _more(finding: Finding) -> bool:
    return finding.count > len(finding.places)


def _plain(value: object) -> object:
    if isinstance(value, Level):
        return value.value
    raise TypeError(f"{type(value).__name__} is not JSON")
