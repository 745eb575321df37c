"""`wdpm bench hard-cases`: its options, and what it does with them."""

from __future__ import annotations

import argparse
from pathlib import Path

from wdpm.bench.commands.benchmark import Benchmark, Measured
from wdpm.progress import Progress
from wdpm.rendering.backend import Backends

_DESCRIPTION = """\
Run the suite of hard cases in full: scenes on which renderers fail, each against
a value that does not come from wdpm. Writes a page with a row for each case:
picture, expected, measured, tolerance, verdict, time. Exit code 1 if one fails.
The suite is in the repository only, not in an installed package."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("hard-cases"), metavar="FOLDER",
        help="folder of the page (default: hard-cases)",
    )  # fmt: skip
    parser.add_argument("--only", nargs="+", default=(), metavar="TEXT", help="cases whose names contain all of these")
    parser.add_argument("--small", action="store_true", help="at the size of the tests: a minute or two")


def run(args: argparse.Namespace, backends: Backends, progress: Progress) -> Measured:  # noqa: ARG001
    """The suite of hard cases; its verdict becomes the exit code."""
    from wdpm.bench import hard_cases as bench_hard_cases

    figures = bench_hard_cases.measure(args.output, args.only, small=args.small)
    return Measured([figures.grid()], {"hard_cases": figures.to_dict()}, code=int(figures.failed > 0))


BENCHMARK = Benchmark(
    "hard-cases", "scenes on which renderers fail, against known values", _DESCRIPTION, add_arguments, run
)
