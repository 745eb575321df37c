"""The page of a run, as Markdown: counts and prices first, then every render."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from trials import Trial

FLOORS = {"none": 2.0, "auto": 1.3}
"""What a render with one slave killed may take of the undisturbed one, by copies."""


def page(trials: Sequence[Trial], seed: int) -> str:
    """All of a run."""
    equal = sum(not trial.error for trial in trials)
    lines = [f"# {equal} of {len(trials)} renders have the bits of one process (seed {seed})", ""]
    lines += [
        "| faults | renders | bits equal | longest s | finished tasks done again |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for kind in dict.fromkeys(trial.kind for trial in trials):
        these = [trial for trial in trials if trial.kind == kind]
        good = sum(not trial.error for trial in these)
        longest = max(trial.seconds for trial in these)
        lines.append(f"| {kind} | {len(these)} | {good} | {longest:.0f} | {sum(trial.redone for trial in these)} |")
    lines += ["", *_prices(trials), "", *_rows(trials)]
    return "\n".join(lines) + "\n"


def _prices(trials: Sequence[Trial]) -> list[str]:
    """What faults cost, in CPU time of all processes over that of the undisturbed render of the same configuration."""
    lines = [
        "CPU time of all processes, dead ones included, over the undisturbed render of the same configuration;",
        "what new processes took until they were ready to work is told by itself. Wall-clock time likewise, with them.",
        "",
        "| faults | copies | renders | CPU: median | worst | a start, s | wall: median | worst | floor |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for kind in ("kill", "kills", "term", "stop"):
        for copies, floor in FLOORS.items():
            these = [
                t
                for t in trials
                if t.kind == kind and t.configuration.copies == copies and t.base_cpu_s and not t.error
            ]
            if these:
                prices, walls = [t.price for t in these], [t.seconds / t.base_seconds for t in these]
                starts = median(t.start_up_s for t in these)
                lines.append(
                    f"| {kind} | {copies} | {len(these)} | {median(prices):.2f} | {max(prices):.2f} | {starts:.1f} | "
                    f"{median(walls):.2f} | {max(walls):.2f} | {floor} |"
                )
    return lines


def _rows(trials: Sequence[Trial]) -> list[str]:
    lines = ["| faults | configuration | what happened | s | CPU s | starts, CPU s | bits |"]
    lines.append("| --- | --- | --- | ---: | ---: | ---: | --- |")
    lines += [
        f"| {t.kind} | {t.configuration} | {'; '.join(t.happened)} | {t.seconds:.1f} | {t.cpu_s:.1f} | "
        f"{t.start_up_s:.1f} | {t.error or 'equal'} |"
        for t in trials
    ]
    return lines
