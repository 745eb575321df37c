"""What a benchmark tells `wdpm bench` of itself.

A new one is a file in this folder with a BENCHMARK, and a line in BENCHMARKS of wdpm/cli/bench.py. What computes is
imported by its `run` when that is called, so that help comes at once.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from wdpm.progress import Progress
from wdpm.rendering.backend import ClusterBackends

if TYPE_CHECKING:
    from wdpm.report.grid import Grid


@dataclass(frozen=True)
class Measured:
    """What came out.

    Attributes:
        grids: tables to print, and to write as Markdown.
        figures: what the tables show, in full, by name, as JSON has it.
        code: exit code of the command.
    """

    grids: Sequence[Grid]
    figures: dict[str, Any]
    code: int = 0


@dataclass(frozen=True)
class Benchmark:
    """One benchmark.

    Attributes:
        name: on the command line.
        help: one line, for the list of all.
        description: what it measures, in lines as they are to be shown.
        add_arguments: adds its own options; those that all have (--json, --markdown) are there already. Where there is
            `--plot`, its argument is a .svg file, and checked before anything is measured.
        run: measures with what renders, which has the threads of `--threads`; raises WdpmError before it renders for
            what it cannot do.
    """

    name: str
    help: str
    description: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace, ClusterBackends, Progress], Measured]
