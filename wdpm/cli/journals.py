"""What an interrupted render leaves beside its image, and how the same command goes on from there.

Two files: the passes that are complete (IMAGE.wdpm-passes), and what is finished of the pass that is rendered
(IMAGE.wdpm-journal), which every render has that takes more than some seconds. Both go when the image is written.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wdpm.scenes.errors import ClusterError, GuardError, ImageError, SettingsError

if TYPE_CHECKING:  # they need what computes, which a command that is only asked for help does not import
    from wdpm.images.image import Image
    from wdpm.rendering.session_journal import SessionJournal

PASSES, LOG = ".wdpm-passes", ".wdpm-journal"
"""After the name of the image: box.exr.wdpm-passes, box.exr.wdpm-journal."""


def add_journal_options(parser: argparse.ArgumentParser) -> None:
    """--resume, --journal, --no-journal and --keep-passes."""
    group = parser.add_argument_group("going on after an interruption (docs/resume.md)")
    group.add_argument(
        "--resume",
        action="store_true",
        help="continue an interrupted render of this image, to the same bits; start from the beginning if nothing was "
        "kept. --passes may be larger than before",
    )
    either = group.add_mutually_exclusive_group()
    either.add_argument(
        "--journal",
        type=Path,
        metavar="FOLDER",
        help="where to keep finished work, from the start of the render (default: beside the image, after 10 s)",
    )
    either.add_argument("--no-journal", action="store_true", help="keep no unfinished pass, only complete ones")
    group.add_argument(
        "--keep-passes",
        action="store_true",
        help=f"do not remove IMAGE{PASSES} at the end, to add more passes later with --resume",
    )


@dataclass(frozen=True)
class Places:
    """Where a render keeps what is finished.

    Attributes:
        passes: file of complete passes.
        log: file of the pass that is rendered.
    """

    passes: Path
    log: Path


def places_of(output: Path, folder: Path | None = None) -> Places:
    """Of a render whose first output this is."""
    beside = output if folder is None else folder / output.name
    return Places(beside.with_name(beside.name + PASSES), beside.with_name(beside.name + LOG))


@contextmanager
def journals(args: argparse.Namespace, output: Path) -> Iterator[dict[str, Any]]:
    """What a render is to be told about its journals; sees to it that they go when all is written.

    An interrupted one writes the picture as far as it is, beside the place of the whole one, and says how to go on.

    Args:
        output: the first of the images to write.

    Raises:
        ImageError: the image cannot be written there: journals could not either.
        SettingsError: there is a journal of an interrupted render, which `args` do not ask to go on with; or it is of
            another one.
    """
    from wdpm.images.files import check_place

    check_place(output)
    places = places_of(output, args.journal)
    if args.journal is not None:
        _make_folder(args.journal)
    in_passes = args.keep_passes or (args.passes or 1) > 1 or (args.resume and places.passes.exists())
    passes: dict[str, Any] = {}
    _check_places(places, in_passes=in_passes, log=args.journal is not None)
    if in_passes:
        passes = {"journal": places.passes, "resume": args.resume and places.passes.exists(), "keep": True}
    log = None if args.no_journal else _log(args, places.log)
    if args.resume and not (passes.get("resume") or places.log.exists()):
        _tell(f"there is nothing to go on with at {places.log}; the render begins")
    before = _written_at(places)
    try:
        yield {**passes, **({} if log is None else {"log": log})}
    except BaseException as error:
        _end_early(args, places, before, log, error)
        raise
    if log is not None:
        log.remove()
        for path in _partial_outputs(args, output):
            path.unlink(missing_ok=True)
    if in_passes and not args.keep_passes:
        places.passes.unlink(missing_ok=True)


def _log(args: argparse.Namespace, path: Path) -> SessionJournal:
    from wdpm.rendering.session_journal import SessionJournal

    return SessionJournal(path, resume=args.resume, at_once=args.journal is not None)


def _end_early(
    args: argparse.Namespace, places: Places, before: tuple[int, int], log: SessionJournal | None, error: BaseException
) -> None:
    """The render ended without its image: write what there is, and say how to go on."""
    picture = None
    if log is not None:
        picture = log.picture() if isinstance(error, KeyboardInterrupt | ClusterError) else None
        if isinstance(error, GuardError):  # it would come again
            log.remove()
        log.close()
    if picture is not None:
        _write_partial(args, picture)
    kept = _written_at(places)
    if not any(kept) or (kept == before and not isinstance(error, KeyboardInterrupt | ClusterError)):
        return
    if kept[1]:
        _tell(f"{places.log} keeps what is finished; the same command with --resume goes on")
    else:
        _tell(f"{places.passes} keeps the passes so far; the same command with --resume goes on")


def _write_partial(args: argparse.Namespace, picture: Image) -> None:
    from wdpm.cli.result import first_output

    for path in _partial_outputs(args, first_output(args)):
        try:
            picture.save(path)
        except ImageError as error:
            _tell(str(error))
            continue
        _tell(f"wrote {path}: the picture as far as it is")


def _partial_outputs(args: argparse.Namespace, first: Path) -> list[Path]:
    return [path.with_name(f"{path.stem}.partial{path.suffix}") for path in args.output or [first]]


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SettingsError(f"--journal {folder}: cannot be made: {(error.strerror or str(error)).lower()}") from None


def _check_places(places: Places, *, in_passes: bool, log: bool) -> None:
    """Find out before the render whether journals can be written, and remove what a killed one left half written.

    Args:
        in_passes: whether there is one of passes.
        log: whether there is one from the first moment on.
    """
    from wdpm.images.files import check_place

    for path in [places.passes] * in_passes + [places.log] * log:
        check_place(path)


def _written_at(places: Places) -> tuple[int, int]:
    """When the files were written [ns]; 0 for one that is not there."""
    passes, log = (path.stat().st_mtime_ns if path.exists() else 0 for path in (places.passes, places.log))
    return passes, log


def _tell(text: str) -> None:
    print(f"wdpm: {text}", file=sys.stderr, flush=True)
