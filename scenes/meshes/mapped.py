"""Files as memory: what of them is read comes when it is looked at."""

from __future__ import annotations

import mmap
from pathlib import Path

FileBytes = mmap.mmap | bytes


def map_file(file: Path) -> FileBytes:
    """The bytes of a file, without reading them; empty files, and what is no plain file, are read.

    Raises:
        OSError: it cannot be read.
    """
    with file.open("rb") as stream:
        try:
            return mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        except (ValueError, OSError):  # empty; a pipe
            return stream.read()


def let_go(data: FileBytes) -> None:
    """Give back the memory in which a mapped file lies; whoever looks at it once more gets it again."""
    if isinstance(data, mmap.mmap) and hasattr(data, "madvise"):
        data.madvise(mmap.MADV_DONTNEED)
