"""`wdpm bench kernels`: its options, and what it does with them."""

from __future__ import annotations

import argparse

from wdpm.bench.commands.benchmark import Benchmark, Measured
from wdpm.progress import Progress
from wdpm.rendering.backend import Backends

_DESCRIPTION = """\
Measure one core of this machine in one process: rays against Embree, nearest
photons against SciPy's cKDTree, and how many photons are traced a second.
Times to compile are apart. What is not installed is left out, and said so."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument(
        "scenes", nargs="*", metavar="SCENE", help="scenes to trace rays in, besides a bumpy ball in a room"
    )


def run(args: argparse.Namespace, backends: Backends, progress: Progress) -> Measured:  # noqa: ARG001
    """Rays, photon gathers and photon tracing on one core."""
    from wdpm.bench import kernels as bench_kernels

    figures = bench_kernels.measure(progress, bench_kernels.Load(models=tuple(args.scenes)))
    return Measured([figures.grid()], {"kernels": figures.to_dict()})


BENCHMARK = Benchmark(
    "kernels", "ray traversal, photon gathers and photon tracing on one core", _DESCRIPTION, add_arguments, run
)
