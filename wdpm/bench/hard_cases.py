"""Runs the suite of hard cases, which lies beside the sources and not in them, and counts its verdicts."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

from wdpm.report.grid import Grid
from wdpm.scenes.errors import SettingsError

SUITE = Path("tests") / "hard_cases" / "run.py"
"""From the repository's root."""

NEAREST = 3
"""Names that are shown where none is as it was given."""

SOUND = ("passes", "limit")
"""Verdicts that are as the suite says they must be."""


@dataclass(frozen=True)
class Figures:
    """What became of each case.

    Attributes:
        page: the page with a row a case.
        cases: name, section, verdict, seconds and problems of each, as the suite's figures.json has them.
    """

    page: Path
    cases: tuple[dict[str, Any], ...]

    @property
    def failed(self) -> int:
        """Cases that are not as they must be."""
        return sum(case["verdict"] not in SOUND for case in self.cases)

    def grid(self) -> Grid:
        """A row a section: cases, those that pass, known limits, those that fail, and the time."""
        rows = []
        for section in dict.fromkeys(case["section"] for case in self.cases):
            here = [case for case in self.cases if case["section"] == section]
            passed, limits = (sum(case["verdict"] == verdict for case in here) for verdict in SOUND)
            seconds = sum(case["seconds"] for case in here)
            counts = (len(here), passed, limits, len(here) - passed - limits)
            rows.append((section, *(str(count) for count in counts), f"{seconds:,.0f} s"))
        columns = ("section", "cases", "pass", "known limits", "fail", "time")
        return Grid("Hard cases", columns, tuple(rows), (f"The page with a row a case: {self.page}",))

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"page": str(self.page), "cases": list(self.cases)}


def measure(output: Path, only: Sequence[str] = (), *, small: bool = False) -> Figures:
    """Run the suite; it tells its own progress.

    Args:
        output: folder of the page.
        only: texts that are in the names of the cases to run.
        small: at the size of the tests.

    Raises:
        SettingsError: the suite is not there, no case has such a name, or the suite did not get to its end.
    """
    suite = find_suite()
    if only:
        check_only(_names(suite), only)
    command = [sys.executable, str(suite), "-o", str(output), *(["--small"] if small else [])]
    if only:
        command += ["--only", *only]
    figures = output / "figures.json"
    figures.unlink(missing_ok=True)
    code = subprocess.run(command, check=False).returncode
    if not figures.exists():
        raise SettingsError(f"the hard cases did not get to their end: {suite} ended with exit code {code}")
    return Figures(output / "index.html", tuple(json.loads(figures.read_text(encoding="utf-8"))))


def check_only(names: Sequence[str], only: Sequence[str]) -> None:
    """Raise SettingsError unless a case has all of these texts in its name.

    Args:
        names: of all cases.
    """
    if any(all(text in name for text in only) for name in names):
        return
    near = sorted(names, key=lambda name: _likeness(name, " ".join(only)), reverse=True)[:NEAREST]
    wanted = " and ".join(repr(text) for text in only)
    raise SettingsError(
        f"--only: no hard case has {wanted} in its name; the nearest are {', '.join(repr(name) for name in near)}; "
        f"python {SUITE} --list shows all"
    )


def _likeness(name: str, text: str) -> float:
    """From 0 to 1: of the whole name, or of the words in it."""
    name, text = name.lower(), text.lower()
    words = max(SequenceMatcher(None, word, text).ratio() for word in name.split())
    return 1.0 if text in name else max(words, SequenceMatcher(None, name, text).ratio())


def _names(suite: Path) -> list[str]:
    listing = subprocess.run([sys.executable, str(suite), "--list"], check=False, stdout=subprocess.PIPE, text=True)
    if listing.returncode:
        raise SettingsError(f"the hard cases cannot be listed: {suite} ended with exit code {listing.returncode}")
    return listing.stdout.splitlines()


def find_suite() -> Path:
    """The program that runs the suite.

    Raises:
        SettingsError: wdpm is installed without its tests.
    """
    suite = Path(__file__).resolve().parents[2] / SUITE
    if not suite.exists():
        raise SettingsError(
            f"the hard cases lie in {SUITE.parent} of the repository, and this wdpm is installed without it: "
            "clone the repository, and run make hard-cases there"
        )
    return suite
