"""`wdpm render`: render a scene here, alone or with a local cluster."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from wdpm import values
from wdpm.cli import options
from wdpm.cli.monitoring import add_monitoring_options, observers
from wdpm.cli.output.image import add_image_options, chosen_way
from wdpm.cli.placing.options import add_placing_options, is_placed
from wdpm.cli.placing.running import render_placed
from wdpm.cluster.plan.copies import Copies
from wdpm.scenes.errors import SettingsError
from wdpm.startup import hold_off_collector

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wdpm.cluster.cluster_events import ClusterObserver
    from wdpm.rendering.backend import Backend

_EXAMPLES = """\
examples:
  wdpm render cornell-box
  wdpm render scene.xml -o scene.exr -o scene.png --size 512x512 --spp 64 --photons 1M
  wdpm render scene.xml --slaves 4 --report report.json
  wdpm render scene.xml -D resx=256 -D resy=256
  wdpm render scene.xml --passes 16 --spp 256
  wdpm render scene.xml --passes 32 --spp 512 --resume
  wdpm render scene.xml --until-error 0.02
  wdpm render scene.xml --time-budget 60s
  wdpm render scene.xml --slaves 4 --passes 64 --spp 1024 --view
  wdpm render moving.glb --frames 1..48 --fps 24 -o frames/moving.exr
  wdpm render scene.%04d.xml --frames 1..100 -o frames/a.png --resume
  wdpm render scene.xml --tev 127.0.0.1:14158
  srun -n 9 wdpm render scene.xml --slurm
  wdpm render scene.xml --strict
  wdpm render scene.xml --replay 10,7,3"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "render",
        help="render a scene on this machine",
        description="Render a scene on this machine: in this process, or with --slaves by a cluster of processes. "
        "The image is the same, bit for bit.",
        epilog=_EXAMPLES,
    )
    add_image_options(parser)
    options.add_compile_option(options.add_machine_options(parser))
    add_monitoring_options(parser)
    debugging = parser.add_argument_group("debugging")
    debugging.add_argument(
        "--replay",
        type=values.sample,
        metavar="X,Y,SAMPLE",
        help="in place of an image, trace one sample of one pixel, all counted from 0 and the upper left, with the "
        "same settings, and print what happens at each vertex of its path",
    )
    cluster = parser.add_argument_group("cluster")
    cluster.add_argument(
        "--slaves",
        type=values.count,
        default=0,
        metavar="N",
        help="slave processes to start; 0 renders in this one (default: 0)",
    )
    options.add_copies_option(cluster)
    cluster.add_argument(
        "--memory",
        type=values.memory,
        metavar="SIZE",
        help="most memory of each slave, like 4G (default: its part of half the machine's)",
    )
    add_placing_options(parser)
    return parser


def run(args: argparse.Namespace) -> int:
    """Render and write, or replay a sample; returns the exit code."""
    hold_off_collector()
    _keep_memory(args)
    if is_placed(args):
        return render_placed(args)
    way = chosen_way(args)
    for name in ("memory", "copies"):
        if getattr(args, name) is not None and not args.slaves:
            raise SettingsError(f"--{name} is of slaves, and there are none: give --slaves N, too, or leave it out")
    if args.replay is not None:
        if args.view or args.tev is not None:
            option = "--view" if args.view else "--tev"
            raise SettingsError(f"--replay makes no image that {option} could show; leave one of them out")
        from wdpm.cli.replay import replay_and_print

        return replay_and_print(args)
    with observers(args) as cluster_observers:
        return way(args, lambda: _backend(args, cluster_observers))


def _keep_memory(args: argparse.Namespace) -> None:
    """Where this process alone computes, launch after launch takes as much memory as the one before."""
    from wdpm.cluster.host_memory import keep_free_memory
    from wdpm.devices import available_cores

    if not args.slaves and (args.threads or available_cores()) == 1:
        keep_free_memory()


def _backend(args: argparse.Namespace, cluster_observers: Sequence[ClusterObserver]) -> Backend:
    from wdpm.local_backend import backend_here

    chosen = {name: getattr(args, name) for name in ("slaves", "threads", "device", "memory")}
    copies = args.copies or Copies.AUTO
    return backend_here(**chosen, copies=copies, observers=cluster_observers, compiling=args.compile)
