"""`wdpm bench cuda`: its options, and what it does with them."""

from __future__ import annotations

import argparse

from wdpm.bench.commands.arguments import counts
from wdpm.bench.commands.benchmark import Benchmark, Measured
from wdpm.progress import Progress
from wdpm.rendering.backend import Backends

_DESCRIPTION = """\
Compile every kernel for CUDA, which needs no GPU: seconds, registers, spilled
registers and local memory of each, and whether an instruction may have other
bits than the CPU's (exit code 1 then). Registers need: pip install 'wdpm[cuda]'"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument("--only", default="", metavar="TEXT", help="modules whose names contain this")
    parser.add_argument(
        "--arch", type=counts, default=(80, 90), metavar="N,N", help="compute capabilities (default: 80,90)"
    )
    parser.add_argument(
        "--no-variants", action="store_true", help="only the modules that all scenes share: half a minute, not minutes"
    )
    parser.add_argument("--no-ptxas", action="store_true", help="without registers and memory, which need ptxas")


def run(args: argparse.Namespace, backends: Backends, progress: Progress) -> Measured:  # noqa: ARG001
    """The table; its exit code tells of instructions that are not exact."""
    from wdpm.bench.gpu.assembler import find_ptxas
    from wdpm.bench.gpu.table import measure

    ptxas = None if args.no_ptxas else find_ptxas()
    figures = measure(args.arch, ptxas, progress, only=args.only, variants=not args.no_variants)
    return Measured([figures.grid()], {"cuda": figures.to_dict()}, code=int(bool(figures.inexact)))


BENCHMARK = Benchmark(
    "cuda", "what kernels take of a compiler for GPUs and of a GPU, without one", _DESCRIPTION, add_arguments, run
)
