"""`wdpm keys`: make the keys of a cluster."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from wdpm.scenes.errors import SettingsError

_ADD, _ADD_READER = "add", "add-reader"

_EXAMPLES = """\
examples:
  wdpm keys cluster-keys                      the master's pair, in a new folder
  wdpm keys add cluster-keys anna bert        a pair for each of two slaves
  wdpm keys add-reader cluster-keys bob       a pair for somebody who only asks `wdpm status`
  scp -rp cluster-keys/anna anna:slave-keys   to its machine; the master does not need the folder, remove it there
  rm cluster-keys/slaves/anna.key             let anna in no more"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "keys",
        help="make the keys of a cluster",
        description="Make CURVE keys, with which master and slaves encrypt and know each other: a pair for the master, "
        "and one for each slave. A master that runs lets new ones in at once.",
        usage="wdpm keys FOLDER | wdpm keys add FOLDER NAME... | wdpm keys add-reader FOLDER NAME...",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "words",
        nargs="+",
        metavar="FOLDER",
        help="new folder for the master's keys; or `add` or `add-reader`, its folder and names",
    )
    return parser


def run(args: argparse.Namespace) -> int:
    """Make the keys; returns the exit code."""
    from wdpm.cluster.transport.zeromq.key_files import add_slave, make_keys

    match args.words:
        case [str(folder)] if folder not in (_ADD, _ADD_READER):
            written = make_keys(Path(folder))
        case [command, folder, *names] if command in (_ADD, _ADD_READER) and names:
            written = [path for name in names for path in add_slave(Path(folder), name, reader=command == _ADD_READER)]
        case words:
            raise SettingsError(
                f"wdpm keys {' '.join(words)}: expected a FOLDER, or: add FOLDER NAME..., or: add-reader FOLDER NAME..."
            )
    for path in written:
        print(f"wrote {path}")
    return 0
