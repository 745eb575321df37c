"""`wdpm doctor`: whether this machine has what wdpm needs."""

from __future__ import annotations

import argparse
import json
from typing import Any

_EXAMPLES = """\
examples:
  wdpm doctor
  wdpm doctor --json
  wdpm doctor --prepare

exit code: 0 nothing is wrong, 1 something must be put right"""

EXIT_WRONG = 1


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "doctor",
        help="whether this machine has what wdpm needs",
        description="Look at this machine: Python, cores, memory, ports, versions, extras, the cache of compiled "
        "kernels, GPUs; and say what to do about each that is not as it should be.",
        epilog=_EXAMPLES,
    )
    parser.add_argument(
        "--prepare",
        action="store_true",
        help="first compile the kernels for all effects, on all cores, so that no render of any scene waits for a "
        "compiler",
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")
    return parser


def run(args: argparse.Namespace) -> int:
    """Print what was found; returns the exit code."""
    from wdpm.doctor.examine import examine, lines_of
    from wdpm.doctor.facts import State

    if args.prepare:
        from wdpm.doctor.preparation import prepare_kernels
        from wdpm.progress import make_progress

        prepare_kernels(make_progress())
    facts = examine()
    if args.json:
        print(json.dumps([fact.to_dict() for fact in facts], indent=2))
    else:
        print("\n".join(lines_of(facts)))
    return EXIT_WRONG if any(fact.state is State.WRONG for fact in facts) else 0
