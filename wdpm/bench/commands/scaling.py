"""`wdpm bench scaling`: its options, and what it does with them."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from wdpm import values
from wdpm.bench.commands.arguments import add_rows, find_all, rows_of, slave_counts
from wdpm.bench.commands.benchmark import Benchmark, Measured
from wdpm.cluster.limits import MOST_SLAVES
from wdpm.cluster.plan.copies import Copies
from wdpm.progress import Progress
from wdpm.rendering.backend import ClusterBackends
from wdpm.scenes.errors import SettingsError

if TYPE_CHECKING:
    from wdpm.bench.rows import Rows

_DESCRIPTION = """\
Render scenes in one process and with clusters of slaves on this machine, with
copies of the scene and without: CPU seconds of all processes over those of one,
bytes sent, and the most that a slave holds.

With --simulate no slave is started: master and slaves, one thread each, run in
simulated time on the machines and links that the options describe. Their jobs
are computed here, one after another, so a simulation takes as long as all slaves
compute together. It prints the speed-up, and where the rest of the time goes."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument("scenes", nargs="+", metavar="SCENE", help="scene files or built-in scenes")
    parser.add_argument(
        "--slaves",
        type=slave_counts,
        default=(1, 2, 4, 8),
        metavar="N,N,...",
        help="numbers of slaves; one process is always measured (default: 1,2,4,8)",
    )
    parser.add_argument(
        "--simulate",
        type=values.cluster_sizes,
        metavar="N..M",
        help="simulate clusters with these numbers of slaves: 2..16 is 2,4,8,16; or N,N,...",
    )
    parser.add_argument(
        "--link",
        type=values.bandwidth,
        default=1.25e9,
        metavar="RATE",
        help="bandwidth between simulated machines (default: 10Gb)",
    )
    parser.add_argument(
        "--latency", type=values.latency, default=50e-6, metavar="TIME", help="latency between them (default: 50us)"
    )
    parser.add_argument(
        "--machines",
        type=values.positive_count,
        metavar="N",
        help="simulated machines that the slaves are spread over (default: one for each slave)",
    )
    parser.add_argument(
        "--cores", type=values.positive_count, default=1, metavar="N", help="cores of a simulated machine (default: 1)"
    )
    parser.add_argument(
        "--copies",
        type=values.copies,
        action="append",
        metavar="none|auto",
        help="as in wdpm render; may be given twice (default: both)",
    )
    parser.add_argument(
        "--memory",
        type=values.memory,
        metavar="SIZE",
        help="most memory of each slave, like 2G: slaves without room for the whole scene share copies of it "
        "(default: no limit)",
    )
    parser.add_argument("--size", type=values.size, metavar="WxH", help="size of the images (default: the scene's)")
    parser.add_argument(
        "--spp", type=values.positive_count, metavar="N", help="samples a pixel (default: the scene's, or 16)"
    )
    parser.add_argument("--photons", type=values.count, metavar="N", help="photons to be stored (default: 250k)")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE.svg", help="of --simulate: also write the speed-ups as a plot"
    )
    add_rows(parser)


def run(args: argparse.Namespace, backends: ClusterBackends, progress: Progress) -> Measured:
    """What more slaves cost."""
    from wdpm.bench.scaling import measure

    find_all(args.scenes)
    chosen = {name: getattr(args, name) for name in ("spp", "photons") if getattr(args, name) is not None}
    copies = tuple(dict.fromkeys(args.copies or (Copies.AUTO, Copies.NONE)))
    rows = rows_of(args)
    if args.plot is not None and args.simulate is None:
        raise SettingsError("--plot shows what --simulate finds: give --simulate 2..16, too")
    if args.memory is not None and args.simulate is not None:
        raise SettingsError("--memory is of real slaves: simulated ones have room for the whole scene; leave one out")
    if args.simulate is not None:
        return _simulate(args, copies, rows, progress, chosen)
    scenes = [
        measure(name, args.slaves, copies, backends, progress, size=args.size, memory=args.memory, rows=rows, **chosen)
        for name in args.scenes
    ]
    return Measured([each.grid() for each in scenes], {"scaling": [each.to_dict() for each in scenes]})


def _simulate(
    args: argparse.Namespace, copies: tuple[Copies, ...], rows: Rows, progress: Progress, chosen: dict[str, int]
) -> Measured:
    from wdpm.bench.simulation.machines import Link
    from wdpm.bench.simulation.measure import Description, simulate
    from wdpm.bench.simulation.plot import plot
    from wdpm.images.files import write_bytes

    if max(args.simulate) > MOST_SLAVES:
        raise SettingsError(f"--simulate {max(args.simulate)}: a cluster has at most {MOST_SLAVES} slaves")
    description = Description(Link(args.link, args.latency), args.machines, args.cores)
    scenes = [
        simulate(name, args.simulate, copies, description, progress, size=args.size, rows=rows, **chosen)
        for name in args.scenes
    ]
    if args.plot is not None:
        write_bytes(plot(scenes).encode(), args.plot)
    return Measured([each.grid() for each in scenes], {"simulated": [each.to_dict() for each in scenes]})


BENCHMARK = Benchmark("scaling", "cost of more slaves, measured or simulated", _DESCRIPTION, add_arguments, run)
