"""`wdpm inspect`: what is in a scene, which effects it calls for, and what each slave would hold of it."""

from __future__ import annotations

import argparse
from typing import Any

from wdpm import values
from wdpm.cli import options

_EXAMPLES = """\
examples:
  wdpm inspect scene.xml
  wdpm inspect scene.xml --without caustics --json
  wdpm inspect atrium:2M --slaves 8
  wdpm inspect atrium:2M --slaves 8 --memory 2G"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "inspect",
        help="show what is in a scene and what a render would do",
        description="Load a scene without rendering it, and show its contents, what the loader repaired, the effects "
        "that a render with these settings would compute and why, and what each slave would hold.",
        epilog=_EXAMPLES,
    )
    options.add_scene_options(parser)
    options.add_view_options(parser)
    parser.add_argument(
        "--slaves", type=values.positive_count, default=4, metavar="N", help="slaves to divide it among (default: 4)"
    )
    parser.add_argument(
        "--memory",
        type=values.memory,
        metavar="SIZE",
        help="memory of each, like 4G: those with room for the whole scene hold all of it, unless --copies none "
        "(default: the scene is cut among all slaves)",
    )
    options.add_copies_option(parser)
    options.add_setting_options(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    return parser


def run(args: argparse.Namespace) -> int:
    """Print the inspection; returns the exit code."""
    from rich.console import Console

    from wdpm.cli.scene import viewed_scene_of
    from wdpm.inspection.inspect import inspect
    from wdpm.inspection.tables import print_inspection
    from wdpm.quiet import quiet_warp

    quiet_warp()
    scene = viewed_scene_of(args)
    inspection = inspect(
        scene, slaves=args.slaves, copies=args.copies, memory=args.memory, **options.chosen_settings(args)
    )
    if args.json:
        print(inspection.to_json())
    else:
        print_inspection(inspection, Console())
    return 0
