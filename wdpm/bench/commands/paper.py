"""`wdpm bench paper`: its options, and what it does with them."""

from __future__ import annotations

import argparse
from typing import Any

from wdpm import values
from wdpm.bench.commands.arguments import add_rows, add_threads, find_all, rows_of, slave_counts
from wdpm.bench.commands.benchmark import Benchmark, Measured
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import Indirect, RenderSettings, Routing
from wdpm.progress import Progress
from wdpm.rendering.backend import ClusterBackends
from wdpm.scenes.errors import SettingsError

ROUTINGS = ("forward", "merge", "both")

_DESCRIPTION = """\
Render scenes without slaves and with clusters of slaves on this machine: time
and speed-up, photons and triangles that each slave holds as shares of all, what
is sent, and the error against the image without slaves (it should be none).

With --simulate all scenes are in one table beside the paper's own figures, and
every slave has a machine of its own, in simulated time; see bench scaling. The
paper's scenes are those of the folder that WDPM_SCENES names, if it has them."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument(
        "scenes",
        nargs="*",
        metavar="SCENE",
        help="scene files or built-in scenes (default: cornell-box and atrium:100k)",
    )
    parser.add_argument(
        "--slaves",
        type=slave_counts,
        metavar="N,N,...",
        help="numbers of slaves; the render without slaves is always made (default: 0,2,4)",
    )
    parser.add_argument(
        "--routing",
        choices=ROUTINGS,
        default="forward",
        metavar="HOW",
        help="forward, merge or both (default: forward)",
    )
    parser.add_argument(
        "--simulate",
        action="store_true",
        help="on machines that are not there, with 10 Gbit/s between them (default of --slaves then: 2,4,8,16)",
    )
    parser.add_argument(
        "--copies",
        type=values.copies,
        default=Copies.NONE,
        metavar="none|auto",
        help="none: the scene is cut among all slaves, as in the paper; auto: each with room holds all (default: none)",
    )
    parser.add_argument("--size", type=values.size, metavar="WxH", help="size of the images (default: the scene's)")
    parser.add_argument(
        "--spp", type=values.positive_count, metavar="N", help="samples a pixel (default: the scene's, or 16)"
    )
    parser.add_argument("--photons", type=values.count, metavar="N", help="photons to be stored (default: 250k)")
    parser.add_argument(
        "--indirect",
        choices=[kind.value for kind in Indirect],
        default=Indirect.MAP.value,
        metavar="HOW",
        help="how indirect light is estimated, see wdpm render --help (default: map, as in the paper)",
    )
    add_threads(parser, "cores to use in all, shared out among slaves")
    add_rows(parser)


def run(args: argparse.Namespace, backends: ClusterBackends, progress: Progress) -> Measured:
    """What clusters hold, send and cost."""
    from wdpm.bench import paper as bench_paper

    find_all(args.scenes)
    if args.simulate:
        return _simulate(args, progress)
    given = {name: getattr(args, name) for name in ("spp", "photons") if getattr(args, name) is not None}
    chosen: dict[str, Any] = {"indirect": Indirect(args.indirect), **given}
    RenderSettings(**chosen)  # a value out of range is an error before the first scene is rendered
    routings = tuple(Routing) if args.routing == "both" else (Routing(args.routing),)
    slaves = bench_paper.DEFAULT_SLAVES if args.slaves is None else args.slaves
    rows = rows_of(args)
    scenes = [
        bench_paper.measure(
            scene, slaves, routings, backends, progress, copies=args.copies, size=args.size, rows=rows, **chosen
        )
        for scene in args.scenes or bench_paper.DEFAULT_SCENES
    ]
    return Measured([figures.grid() for figures in scenes], {"paper": [figures.to_dict() for figures in scenes]})


def _simulate(args: argparse.Namespace, progress: Progress) -> Measured:
    from wdpm.bench.simulation import paper
    from wdpm.bench.simulation.machines import Link
    from wdpm.bench.simulation.measure import Description, simulate

    chosen = {name: getattr(args, name) for name in ("spp", "photons") if getattr(args, name) is not None}
    slaves = [count for count in args.slaves or paper.SLAVES if count]
    if not slaves:
        raise SettingsError("--simulate is of slaves: give --slaves 2,4, say")
    rows, ten = rows_of(args), Description(Link(1.25e9, 50e-6))
    scenes = [
        simulate(
            name,
            slaves,
            (args.copies,),
            ten,
            progress,
            size=args.size,
            rows=rows,
            indirect=Indirect(args.indirect),
            **chosen,
        )
        for name in args.scenes or paper.paper_scenes()
    ]
    return Measured([paper.grid(scenes)], {"simulated": [each.to_dict() for each in scenes]})


BENCHMARK = Benchmark("paper", "the paper's table: what slaves hold and send", _DESCRIPTION, add_arguments, run)
