"""The command line. Each command is a file of its own in this folder, with add_parser(subparsers) and run(args).

Only run() imports what computes, so that help and errors of the command line come at once; and of a command that is
called, only its own file is imported.
"""

from __future__ import annotations

import argparse
import errno
import importlib
import os
import re
import sys
import textwrap
from collections.abc import Sequence
from typing import Any, NoReturn

from wdpm.cli.interrupts import (
    HungUp,
    Terminated,
    interrupts_outlive_imports,
    interrupts_raise,
    no_lost_interrupts,
    termination_raises,
)
from wdpm.exit_codes import EXIT_BAD_INPUT, EXIT_HUNG_UP, EXIT_INTERRUPTED, EXIT_TERMINATED, exit_code_of
from wdpm.scenes.errors import WdpmError, did_you_mean, is_of_memory
from wdpm.scenes.scene_root import files_within
from wdpm.standard_streams import why_output_lost
from wdpm.startup import let_collector_go

COMMANDS = {
    "render": "render",
    "master": "master",
    "slave": "slave",
    "status": "status",
    "inspect": "inspect",
    "check": "check",
    "compare": "compare",
    "convert": "output.convert",
    "view": "view",
    "accuracy": "accuracy",
    "bench": "bench",
    "keys": "keys",
    "slurm": "placing.slurm",
    "blender": "blender",
    "doctor": "doctor",
}
"""Modules of this folder, by the commands that they are, in the order of `wdpm --help`."""

OF_OTHERS = ("slurm",)
"""Commands with options of another command."""

COMPLETING = "_ARGCOMPLETE"
"""Set by a shell that asks what could come next on its line; nobody else waits for the library that answers."""

_EXAMPLES = """\
examples:
  wdpm render cornell-box -o box.exr -o box.png
  wdpm render scene.xml --slaves 4 --photons 1M --spp 64
  wdpm compare a.exr b.exr -o difference.png

wdpm COMMAND --help says more."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code (wdpm/exit_codes.py): 0, 1, 2 for bad input, 3, 75, 129, 130 or 143.

    1: a cluster failed, or compare --equal or check found something. 3: the image is there, but not as good as
    --until-error asked for (wdpm/cli/goal.py). 75: a slave has lost its master. 129, 130, 143: SIGHUP, SIGINT
    (Ctrl-C) or SIGTERM.
    """
    arguments = sys.argv[1:] if argv is None else argv
    if COMPLETING in os.environ:
        _complete(make_parser())
    parser = make_parser(arguments[0] if arguments else None)
    if not arguments:
        parser.print_help(sys.stderr)
        return EXIT_BAD_INPUT
    command = arguments[0]
    if not command.startswith("-") and command not in COMMANDS:
        parser.error(f"there is no command '{command}'{did_you_mean(command, COMMANDS)}")
    args, unknown = parser.parse_known_args(arguments)
    if unknown:
        _refuse(args.parser, unknown)
    let_collector_go()  # a command that imports what computes holds it off again
    try:
        with interrupts_raise(), termination_raises(), no_lost_interrupts(), interrupts_outlive_imports():
            with files_within(getattr(args, "scene_root", None)):
                code: int = args.run(args)
            sys.stdout.flush()
        if not code and (lost := why_output_lost()) is not None:
            print(f"wdpm: error: standard output: cannot be written: {str(lost.strerror).lower()}", file=sys.stderr)
            return EXIT_BAD_INPUT
    except WdpmError as error:
        print(f"wdpm: error: {error}", file=sys.stderr)
        return exit_code_of(error)
    except Terminated:
        print("wdpm: terminated", file=sys.stderr)
        return EXIT_TERMINATED
    except HungUp:
        print("wdpm: hung up", file=sys.stderr)
        return EXIT_HUNG_UP
    except KeyboardInterrupt:
        print("wdpm: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of a pipe has left, as `| head` does. Python would complain once more when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (OSError, MemoryError, RuntimeError) as error:
        if is_of_memory(error):
            what = f"not enough memory: {str(error) or 'for Python itself'}"
        elif isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            what = f"{error.filename}: {str(error.strerror).lower()}"  # whatever it was to be
        else:
            raise
        print(f"wdpm: error: {what}", file=sys.stderr)
        return EXIT_BAD_INPUT
    finally:
        let_collector_go()
    return code


def _refuse(parser: argparse.ArgumentParser, unknown: Sequence[str]) -> NoReturn:
    """End with an error that names what a command does not know, and the option that was perhaps meant."""
    option = unknown[0].partition("=")[0]
    known = re.findall(r"--[\w-]+", parser.format_usage()) if option.startswith("-") else []
    parser.error(f"unrecognized arguments: {' '.join(unknown)}{did_you_mean(option, known)}")


def _complete(parser: argparse.ArgumentParser) -> None:
    """Tell the shell, and exit; do nothing where argcomplete is not installed."""
    try:
        import argcomplete
    except ModuleNotFoundError:
        return
    argcomplete.autocomplete(parser)


def make_parser(called: str | None = None) -> argparse.ArgumentParser:
    """The parser of all commands; of one only, if it is known that this is called."""
    parser = _Parser(
        prog="wdpm",
        description="Global illumination by photon mapping, on one machine or on a cluster, to the same bits.",
        epilog=_EXAMPLES,
        formatter_class=_Help,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    alone = called is not None and called in COMMANDS and called not in OF_OTHERS
    for name in [str(called)] if alone else COMMANDS:
        command = importlib.import_module(f"wdpm.cli.{COMMANDS[name]}")
        subparser = command.add_parser(subparsers)
        subparser.formatter_class = _Help
        subparser.set_defaults(run=command.run, parser=subparser)
    return parser


class _Parser(argparse.ArgumentParser):
    """Takes no abbreviated options, which would break when options are added, and gives one line for an error."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"allow_abbrev": False, **options})

    def error(self, message: str) -> NoReturn:
        self.exit(EXIT_BAD_INPUT, f"wdpm: error: {message} (see {self.prog} --help)\n")


class _Help(argparse.RawDescriptionHelpFormatter):
    """Wraps the description, leaves the examples as they are, and makes room for the longest option."""

    def __init__(self, prog: str, **options: Any) -> None:
        super().__init__(prog, **{"max_help_position": 28, **options})

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n" in text:
            return super()._fill_text(text, width, indent)
        return textwrap.fill(text, width, initial_indent=indent, subsequent_indent=indent)


class _Version(argparse.Action):
    """Looks the version up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from importlib import metadata  # reads mail headers

        try:
            version = metadata.version("wdpm")
        except metadata.PackageNotFoundError:
            version = "(a checkout that is not installed)"
        print(f"wdpm {version}")
        parser.exit()
