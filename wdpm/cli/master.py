"""`wdpm master`: render a scene with slaves that people start on other machines."""

from __future__ import annotations

import argparse
from typing import Any

from wdpm import values
from wdpm.cli import options
from wdpm.cli.monitoring import add_monitoring_options, observers
from wdpm.cli.output.image import add_image_options, chosen_way

_EXAMPLES = """\
examples:
  on one machine:
    wdpm master scene.xml -o scene.exr --slaves 2
    wdpm slave tcp://127.0.0.1:7117        (in two other terminals)
  on several, with keys for each (wdpm keys --help):
    wdpm master scene.xml --bind tcp://192.168.1.10:7117 --slaves 4 --keys cluster-keys
    wdpm slave tcp://192.168.1.10:7117 --keys slave-keys"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "master",
        help="render a scene with slaves on other machines",
        description="Wait for slaves, hand out the scene and the work, and write the image. The master itself computes "
        "no light.",
        epilog=_EXAMPLES,
    )
    add_image_options(parser)
    cluster = parser.add_argument_group("cluster")
    cluster.add_argument(
        "--bind",
        type=values.address,
        default="tcp://127.0.0.1:7117",
        metavar="tcp://HOST:PORT",
        help="address to listen on (default: tcp://127.0.0.1:7117, this machine only)",
    )
    cluster.add_argument(
        "--slaves",
        type=values.slaves,
        required=True,
        metavar="N",
        help="slaves to wait for; 2..8 begins with two, and takes up to eight",
    )
    options.add_copies_option(cluster)
    cluster.add_argument(
        "--join-timeout",
        type=values.duration,
        default=600.0,
        metavar="TIME",
        help="how long to wait for slaves that have not joined, like 90s or 30m, before those that have begin "
        "(default: 10m)",
    )
    options.add_security_options(parser)
    add_monitoring_options(parser)
    return parser


def run(args: argparse.Namespace) -> int:
    """Serve, render and write; returns the exit code."""
    from wdpm.clusters import Cluster, check_listening

    way = chosen_way(args)
    first, most = args.slaves
    with observers(args) as cluster_observers:
        check_listening(args.bind, args.keys, args.insecure)
        return way(
            args,
            lambda: Cluster.listen(
                args.bind,
                first,
                most=most,
                copies=args.copies,
                keys=args.keys,
                insecure=args.insecure,
                join_timeout=args.join_timeout,
                observers=cluster_observers,
            ),
        )
