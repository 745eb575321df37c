"""`wdpm bench`: benchmarks of wdpm on this machine: kernels, clusters, effects, the time to an error beside Mitsuba 3.

What each benchmark takes and does is in a file of its own in wdpm/bench/commands/.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from wdpm.bench.commands import (
    cores,
    cuda,
    device,
    effects,
    hard_cases,
    kernels,
    paper,
    peers,
    predict,
    scaling,
)
from wdpm.bench.commands.benchmark import Benchmark
from wdpm.cluster.plan.copies import Copies
from wdpm.rendering.backend import Backend

BENCHMARKS = (
    kernels.BENCHMARK,
    paper.BENCHMARK,
    scaling.BENCHMARK,
    cores.BENCHMARK,
    effects.BENCHMARK,
    peers.BENCHMARK,
    hard_cases.BENCHMARK,
    predict.BENCHMARK,
    cuda.BENCHMARK,
    device.BENCHMARK,
)

_EXAMPLES = """\
examples:
  wdpm bench kernels
  wdpm bench paper scene.xml --slaves 0,2,4 --routing both --markdown table.md
  wdpm bench scaling scene.xml --slaves 1,4,8 --copies auto
  wdpm bench cores scene.xml --cores 2,8,16
  wdpm bench effects --plot effects.svg
  wdpm bench hard-cases --only furnace -o out/hard-cases
  wdpm bench peers sibenik/scene.xml sponza/scene.xml --errors 0.05,0.02,0.01,0.005
  wdpm bench peers glass.xml --reference reference.exr --region 136,222,226,250 --errors 0.02
  wdpm bench peers cbox/scene.xml --ways map,gather,cache
  wdpm bench peers */scene.xml --samples 64,1024 --trim 0.001 --ways defaults,path --rows peers.jsonl

wdpm bench WHAT --help says more. The libraries compared with come with: pip install 'wdpm[peers,test]'"""

LOG_WIDTH = 120
"""Columns of the tables where there is no terminal that says how many it has."""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "bench",
        help="benchmarks: kernels, clusters, effects, comparison with Mitsuba 3",
        description="Measure wdpm on this machine. What is compared is measured by turns in one run: ratios mean more "
        "than times.",
        epilog=_EXAMPLES,
    )
    benches = parser.add_subparsers(title="benchmarks", metavar="WHAT", required=True)
    for benchmark in BENCHMARKS:
        _add_benchmark(benches, benchmark)
    return parser


def run(args: argparse.Namespace) -> int:
    """Measure, print and write; returns the exit code."""
    from rich.console import Console

    from wdpm.bench import outputs
    from wdpm.local_backend import backend_here
    from wdpm.progress import make_progress
    from wdpm.quiet import quiet_warp
    from wdpm.report.grid import machine_in_words

    quiet_warp()
    outputs.check_outputs(args.json, args.markdown)
    if getattr(args, "plot", None) is not None:
        outputs.check_plot(args.plot)
    progress = make_progress()
    try:
        threads = getattr(args, "threads", None)  # some benchmarks are of one core, and have no such option

        def backends(
            slaves: int, copies: Copies = Copies.AUTO, cores: int | None = None, memory: int | None = None, /
        ) -> Backend:
            return backend_here(slaves, cores or threads, copies=copies, memory=memory)

        measured = args.benchmark.run(args, backends, progress)
    finally:
        progress.finish()
    console = Console() if sys.stdout.isatty() else Console(width=LOG_WIDTH)
    for grid in measured.grids:
        grid.print(console)
    console.print(f"\nMeasured on {machine_in_words()}.", markup=False, highlight=False)
    outputs.write_outputs(measured.grids, measured.figures, args.json, args.markdown)
    return int(measured.code)


def _add_benchmark(benches: Any, benchmark: Benchmark) -> None:
    parser: argparse.ArgumentParser = benches.add_parser(
        benchmark.name,
        help=benchmark.help,
        description=benchmark.description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--json", type=Path, metavar="FILE.json", help="also write all figures as JSON")
    parser.add_argument("--markdown", type=Path, metavar="FILE.md", help="also write the tables as Markdown")
    benchmark.add_arguments(parser)
    parser.set_defaults(benchmark=benchmark, parser=parser)
