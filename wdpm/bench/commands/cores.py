"""`wdpm bench cores`: its options, and what it does with them."""

from __future__ import annotations

import argparse

from wdpm import values
from wdpm.bench.commands.arguments import counts, find_all
from wdpm.bench.commands.benchmark import Benchmark, Measured
from wdpm.cluster.messages.checks import MOST_PROCESSES
from wdpm.progress import Progress
from wdpm.rendering.backend import ClusterBackends
from wdpm.scenes.errors import SettingsError

_DESCRIPTION = """\
Reckon how long scenes would take on more cores than this machine has. They are
rendered here with as many processes and threads, which take turns; the CPU time
of each part is measured, and the critical path is what it would take if each
process had a core. It is a reckoning: that cores share memory and its bandwidth,
and that a clock falls as more of them work, is not in it."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument("scenes", nargs="+", metavar="SCENE", help="scene files or built-in scenes")
    parser.add_argument(
        "--cores",
        type=counts,
        default=(2, 8, 16),
        metavar="N,N,...",
        help="numbers of cores; one is always measured (default: 2,8,16)",
    )
    parser.add_argument("--size", type=values.size, metavar="WxH", help="size of the images (default: the scene's)")
    parser.add_argument(
        "--spp", type=values.positive_count, metavar="N", help="samples a pixel (default: the scene's, or 16)"
    )


def run(args: argparse.Namespace, _: ClusterBackends, progress: Progress) -> Measured:
    """What more cores would bring."""
    from wdpm.bench.cores.measure import measure

    if max(args.cores) > MOST_PROCESSES:
        raise SettingsError(f"--cores {max(args.cores)}: a render has at most {MOST_PROCESSES} processes")
    find_all(args.scenes)
    chosen = {} if args.spp is None else {"spp": args.spp}
    scenes = [measure(name, args.cores, progress, size=args.size, **chosen) for name in args.scenes]
    return Measured([each.grid() for each in scenes], {"cores": [each.to_dict() for each in scenes]})


BENCHMARK = Benchmark("cores", "what more cores would bring, reckoned", _DESCRIPTION, add_arguments, run)
