"""`wdpm blender`: write the file that Blender installs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

_EXAMPLES = """\
examples:
  wdpm blender wdpm.zip
  pip wheel --wheel-dir wheels wdpm   (with Python 3.11)
  wdpm blender wdpm.zip --wheels wheels

Then in Blender: Edit > Preferences > Get Extensions > Install from Disk."""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "blender",
        help="write the add-on that Blender installs",
        description="Write an extension that makes wdpm a render engine of Blender (docs/blender.md). Without wheels, "
        "wdpm must be installed into Blender's Python; with them, the file has all that it needs.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("file", type=Path, metavar="FILE.zip", help="new file")
    parser.add_argument(
        "--wheels", type=Path, metavar="FOLDER", help="wheels of wdpm and of what it needs, for one platform"
    )
    return parser


def run(args: argparse.Namespace) -> int:
    """Write the file; returns the exit code."""
    from wdpm.blender.extension import write_extension

    wheels = write_extension(args.file, args.wheels)
    inside = f"with {len(wheels)} wheels" if wheels else "without wheels: it needs wdpm in Blender's Python"
    print(f"wrote {args.file}, {inside}")
    return 0
