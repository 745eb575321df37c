"""`wdpm slave`: compute for a master."""

from __future__ import annotations

import argparse
from typing import Any

from wdpm import values
from wdpm.cli import options

_EXAMPLES = """\
examples:
  wdpm slave tcp://127.0.0.1:7117
  wdpm slave tcp://192.168.1.10:7117 --keys slave-keys --threads 8 --memory 16G --rejoin 1h"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "slave",
        help="compute for a master",
        description="Hold a part of the scene and of the photon map, and compute for the master until it has no more "
        "work.",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "address", type=values.address_of_master, metavar="tcp://HOST:PORT", help="address of the master"
    )
    machine = options.add_machine_options(parser)
    machine.add_argument(
        "--compile",
        choices=("first", "no"),
        default="first",
        help="kernels for just the scene's effects, where they are not compiled yet: first: wait for them; no: use "
        "kernels for all effects if these are, which give the same bits (default: first)",
    )
    parser.add_argument(
        "--memory", type=values.memory, metavar="SIZE", help="most memory to use, like 8G (default: no limit)"
    )
    parser.add_argument(
        "--timeout",
        type=values.duration,
        default=60.0,
        metavar="TIME",
        help="how long to wait for the master's first answer, like 90s or 2m (default: 60s)",
    )
    parser.add_argument(
        "--rejoin",
        type=values.duration,
        metavar="TIME",
        help="how long to wait for a master that was lost, like 90s or 2h: it may be started again with --resume "
        "(default: as --timeout)",
    )
    parser.add_argument(
        "--share",
        type=values.positive_count,
        default=1,
        metavar="N",
        help="slaves that share this machine: use an N-th of its cores, unless --threads says how many (default: 1)",
    )
    parser.set_defaults(threads=None)
    # For the process that starts local slaves: end when standard input closes.
    parser.add_argument("--life-line", action="store_true", help=argparse.SUPPRESS)
    # For the process that starts several: be one of which they are forked (cluster/transport/fork_server.py).
    parser.add_argument("--fork-server", action="store_true", help=argparse.SUPPRESS)
    options.add_security_options(parser)
    return parser


def run(args: argparse.Namespace) -> int:
    """Work until the master is done; returns the exit code."""
    from wdpm.cluster.host_memory import keep_free_memory
    from wdpm.cluster.slave.time_slices import ask_for_long_slices
    from wdpm.devices import available_cores, check_memory
    from wdpm.serving import fork_slaves, security_of, serve
    from wdpm.standard_streams import outlive_readers
    from wdpm.startup import hold_off_collector

    outlive_readers()
    hold_off_collector()
    keep_free_memory()
    if args.fork_server and not fork_slaves(args.address):
        return 0
    ask_for_long_slices()
    check_memory(args.memory)
    serve(
        args.address,
        security_of(args.address, args.keys, args.insecure),
        threads=args.threads or max(1, available_cores() // args.share),
        device=args.device,
        memory=args.memory,
        patience=args.timeout,
        rejoin=args.rejoin,
        wait_for_kernels=args.compile == "first",
        life_line=args.life_line,
    )
    return 0
