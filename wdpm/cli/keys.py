"""`wdpm keys`: make the keys of a cluster."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

_EXAMPLES = """\
examples:
  wdpm keys cluster-keys
  scp -rp cluster-keys other-machine:"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "keys",
        help="make the keys of a cluster",
        description="Make CURVE keys, with which master and slaves encrypt and know each other. Copy the folder to "
        "every machine and keep it secret.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="new folder for the keys")
    return parser


def run(args: argparse.Namespace) -> int:
    """Make the keys; returns the exit code."""
    from wdpm.cluster.transport.zeromq.key_files import make_keys

    for path in make_keys(args.folder):
        print(f"wrote {path}")
    return 0
