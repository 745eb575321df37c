"""All that the doctor looks at."""

from __future__ import annotations

from collections.abc import Sequence

from wdpm.doctor import kernels, machine, software
from wdpm.doctor.facts import Fact, State


def examine() -> list[Fact]:
    """Look at this machine; takes as long as Warp needs to start."""
    facts = [
        machine.python(),
        machine.system(),
        machine.cores(),
        machine.memory(),
        machine.processes(),
        machine.temporary_files(),
        machine.open_files(),
        machine.network(),
        *software.packages(),
        kernels.kernel_cache(),
        kernels.gpus(),
    ]
    return [fact for fact in facts if fact is not None]


def lines_of(facts: Sequence[Fact]) -> list[str]:
    """For people: a line each, what to do below it, and what it comes to at the end."""
    width = max(len(fact.about) for fact in facts)
    lines = []
    for fact in facts:
        lines.append(f"{fact.state.value:5}  {fact.about:{width}}  {fact.found}")
        if fact.advice is not None:
            lines.append(f"{'':5}  {'':{width}}  -> {fact.advice}")
    wrong = sum(fact.state is State.WRONG for fact in facts)
    lines.append("")
    lines.append(f"{wrong} of these must be put right" if wrong else "nothing is wrong")
    return lines
