"""Pointers of Git LFS: small texts that stand for large files in a repository until those are fetched."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from wdpm.scenes.errors import SceneError

_BEGINNING: Final = b"version https://git-lfs.github.com/spec/"


def check_not_a_pointer(file: Path, named_in: Path | None = None, line: int | None = None) -> None:
    """Raise SceneError if a file is not there itself, but only its pointer. One that cannot be read is left to others.

    Args:
        named_in, line: the file that names it, for the message.
    """
    try:
        with file.open("rb") as opened:
            beginning = opened.read(len(_BEGINNING))
    except OSError:
        return
    if beginning == _BEGINNING:
        raise SceneError(
            f'"{file.name}" is a pointer of Git LFS, not the file itself; fetch it where it comes from: git lfs pull',
            named_in or file,
            line,
        )
