"""Options of commands that render in several passes, and what they do with the file that keeps the passes so far."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from wdpm.scenes.errors import ClusterError

SUFFIX = ".wdpm-passes"
"""After the name of the image: box.exr.wdpm-passes."""


def add_pass_options(parser: argparse.ArgumentParser) -> None:
    """--resume and --keep-passes."""
    group = parser.add_argument_group("passes (with --passes)")
    group.add_argument(
        "--resume",
        action="store_true",
        help=f"go on with a render that was interrupted, from IMAGE{SUFFIX}; --passes may be larger than before",
    )
    group.add_argument(
        "--keep-passes",
        action="store_true",
        help=f"leave IMAGE{SUFFIX} behind when all passes are done, to add more later with --resume",
    )


def journal_of(output: Path) -> Path:
    """The journal of a render whose first output this is."""
    return output.with_name(output.name + SUFFIX)


@contextmanager
def kept_passes(args: argparse.Namespace, output: Path) -> Iterator[dict[str, Any]]:
    """What a render is to be told about its journal; sees to it that the journal goes when all is written.

    Args:
        output: the first of the images to write.
    """
    if not (args.resume or args.keep_passes or (args.passes or 1) > 1):
        yield {}
        return
    journal = journal_of(output)
    before = _written_at(journal)
    try:
        yield {"journal": journal, "resume": args.resume, "keep": True}
    except BaseException as error:
        kept = _written_at(journal)
        if kept and (kept != before or isinstance(error, KeyboardInterrupt | ClusterError)):
            print(f"wdpm: {journal} keeps the passes so far; the same command with --resume goes on", file=sys.stderr)
        raise
    if not args.keep_passes:
        journal.unlink(missing_ok=True)


def _written_at(path: Path) -> int:
    """When a file was written [ns]; 0 if there is none."""
    return path.stat().st_mtime_ns if path.exists() else 0
