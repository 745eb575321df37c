"""`wdpm bench`: how fast this machine is, as ratios against libraries, in one run."""

from __future__ import annotations

import argparse
from typing import Any

_EXAMPLES = """\
examples:
  wdpm bench kernels

The libraries compared with come with: pip install 'wdpm[peers,test]'"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "bench",
        help="how fast this machine is",
        description="Measure one core of this machine, in one run: rays against Embree, nearest photons against SciPy.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("what", choices=("kernels",), metavar="WHAT", help="kernels: ray traversal and photon gathers")
    return parser


def run(args: argparse.Namespace) -> int:
    """Measure and print; returns the exit code."""
    from rich.console import Console

    from wdpm import bench

    bench.run(args.what, Console())
    return 0
