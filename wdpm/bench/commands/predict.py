"""`wdpm bench predict`: its options, and what it does with them."""

from __future__ import annotations

import argparse
from pathlib import Path

from wdpm.bench.commands.arguments import add_counts, add_rows, add_threads, find_all, relative_errors, rows_of
from wdpm.bench.commands.benchmark import Benchmark, Measured
from wdpm.progress import Progress
from wdpm.rendering.backend import Backends

_DESCRIPTION = """\
Ask scenes for errors, as --until-error does, and hold what it says against a
reference image and the clock: true error against the one asked for and the one
estimated, time taken against time predicted."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument(
        "scenes", nargs="+", type=Path, metavar="SCENE", help="scene files, each with a reference.exr beside it"
    )
    parser.add_argument(
        "--errors",
        type=relative_errors,
        default=(0.1, 0.05, 0.02, 0.01),
        metavar="E,E,...",
        help="relMSE to ask for (default: 0.1,0.05,0.02,0.01)",
    )
    parser.add_argument(
        "--clock",
        choices=("cpu", "wall"),
        default="cpu",
        help="time to predict: of all threads together, or on the wall (default: cpu, which other work on the machine "
        "does not lengthen)",
    )
    add_counts(
        parser,
        ("--seeds", 1, "runs of each error"),
        ("--smaller", 1, "pixels of the reference along a side of the image's, which are larger and cost as much less"),
    )
    add_threads(parser, "threads to render with")
    add_rows(parser)


def run(args: argparse.Namespace, backends: Backends, progress: Progress) -> Measured:
    """What --until-error predicts and estimates, against the truth."""
    from wdpm.bench import predict as bench_predict

    find_all(args.scenes)
    rows = rows_of(args)
    with backends(0) as backend:
        figures = bench_predict.measure(
            args.scenes,
            backend,
            progress,
            targets=args.errors,
            seeds=args.seeds,
            clock=args.clock,
            smaller=args.smaller,
            rows=rows,
        )
    return Measured([figures.grid()], {"predict": figures.to_dict()})


BENCHMARK = Benchmark(
    "predict", "how true it is what --until-error predicts and estimates", _DESCRIPTION, add_arguments, run
)
