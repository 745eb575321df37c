"""`wdpm check`: what is wrong or risky in a scene, what a render does about it, and a mended copy of a mesh file."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wdpm.cli import options

if TYPE_CHECKING:
    from wdpm.checkup.findings import Checkup
    from wdpm.checkup.fix import Mended

EXIT_BAD_INPUT = 2

_EXAMPLES = """\
examples:
  wdpm check scene.xml
  wdpm check scene.xml --json && wdpm render scene.xml
  wdpm check model.obj --fix mended.obj

exit code: 0 nothing found (or notes only), 1 something worth a look, 2 a scene that a render refuses"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "check",
        help="what is wrong or risky in a scene",
        description="Look for what is wrong or risky in a scene, without rendering it: what it is and where, what a "
        "render does about it, and what to do.",
        epilog=_EXAMPLES,
    )
    options.add_scene_options(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")
    parser.add_argument(
        "--fix",
        type=Path,
        metavar="OUT",
        help="write a mended copy of a mesh file (.obj, .ply, .stl, .off); the file itself is never changed",
    )
    return parser


def run(args: argparse.Namespace) -> int:
    """Print what was found, write the mended copy; returns the exit code."""
    from rich.console import Console

    from wdpm.quiet import quiet_warp
    from wdpm.scenes.errors import SceneError

    quiet_warp()
    checkup, refusal = None, None
    try:
        checkup = _check(args)
    except SceneError as error:
        if args.fix is None:
            raise
        refusal = error  # what cannot be rendered may still be mended
    mended = None if args.fix is None else _mend(args)
    if args.json:
        found = {"refused": str(refusal)} if checkup is None else json.loads(checkup.to_json())
        if mended is not None:
            found["fix"] = {"output": str(mended.output), "changes": list(mended.changes)}
        print(json.dumps(found, indent=2))
    else:
        if checkup is not None:
            checkup.print(Console())
        if mended is not None:
            _tell(mended)
    if refusal is not None:
        print(f"wdpm: error: {refusal}", file=sys.stderr)
    return EXIT_BAD_INPUT if checkup is None else checkup.exit_code


def _check(args: argparse.Namespace) -> Checkup:
    from wdpm.checkup.run import check

    return check(args.scene, defines=dict(args.definitions), size=args.size, lenient=args.lenient)


def _mend(args: argparse.Namespace) -> Mended:
    from wdpm.checkup.fix import mend

    return mend(Path(args.scene), args.fix)


def _tell(mended: Mended) -> None:
    print(f"\nwritten: {mended.output}")
    for change in mended.changes:
        print(f"  {change}")
    if not mended.changes:
        print("  nothing to mend: a copy as it was")
