"""`wdpm bench predict`: its options, and what it does with them."""

from __future__ import annotations

import argparse
from pathlib import Path

from wdpm.bench.commands.arguments import add_counts, add_rows, add_threads, find_all, relative_errors, rows_of
from wdpm.bench.commands.benchmark import Benchmark, Measured
from wdpm.progress import Progress
from wdpm.rendering.backend import Backends
from wdpm.scenes.builtin.names import BUILT_IN_NAMES
from wdpm.scenes.errors import SettingsError

_DESCRIPTION = """\
Render scenes with --until-error, and compare its estimates with the truth: the
true error, by a reference image, with the error asked for and the one estimated,
and the time taken with the time predicted."""


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
        help="time to predict: of all threads together, or wall-clock (default: cpu, which depends less on other work "
        "on the machine)",
    )
    add_counts(
        parser,
        ("--seeds", 1, "runs of each error"),
        ("--smaller", 1, "factor by which images are narrower and lower than the reference"),
    )
    add_threads(parser, "threads to render with")
    add_rows(parser)


def run(args: argparse.Namespace, backends: Backends, progress: Progress) -> Measured:
    """What --until-error predicts and estimates, against the truth."""
    from wdpm.bench import predict as bench_predict

    for scene in args.scenes:
        if str(scene).partition(":")[0] in BUILT_IN_NAMES:
            raise SettingsError(f"{scene} is built in; expected files with a reference.exr beside them")
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
    "predict", "how true the estimates and predictions of --until-error are", _DESCRIPTION, add_arguments, run
)
