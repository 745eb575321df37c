"""The code that `dataclasses` writes for each class, compiled once and kept beside Python's own compiled files.

A dataclass gets its methods as text, which is compiled whenever its module is imported: 1,400 texts for a render, an
eighth of a second. Python keeps what it compiles of files, but not of texts.

So for a process that is a command of ours, `dataclasses` finds another `exec`, which looks into a file of texts and
their code first. The file lies where Python keeps the compiled file of this module, and is of the same version of
Python. What a text compiles to depends on nothing else, so nothing in it is ever out of date; and it is to be trusted
as those files are, no less and no more. Where there is no such file, or none can be written, texts are compiled as
ever.
"""

from __future__ import annotations

import builtins
import contextlib
import dataclasses
import importlib.util
import marshal
import os
import sys
import zlib
from pathlib import Path
from types import CodeType
from typing import Any

SUFFIX = ".dataclasses"
"""Of the file, in place of ".pyc"."""

MOST_BYTES = 8 << 20
"""Of the file. Beyond that, texts that this process had no use for are left out: they are of code that has changed."""

SPOILT = (ValueError, EOFError, TypeError)
"""What `marshal` raises for what it did not write."""


class GeneratedCode:
    """What texts compile to.

    Args:
        file: where it is kept; None for nowhere.
    """

    def __init__(self, file: Path | None) -> None:
        self._file = file
        self._kept = _read(file)
        self._used: dict[str, CodeType] = {}
        self._is_new = False

    def execute(self, source: Any, in_globals: Any = None, in_locals: Any = None, /) -> None:
        """In place of `exec`."""
        code = source
        if isinstance(source, str):
            known = self._kept.get(source) or self._used.get(source)
            # As `exec` would in dataclasses, which has no features of future versions.
            code = known or compile(source, "<string>", "exec", dont_inherit=True)
            self._used[source] = code
            self._is_new = self._is_new or known is None
        builtins.exec(code, in_globals, in_locals)

    def write(self) -> None:
        """Keep what was compiled, in one step, so that nobody reads half of it; a folder may refuse."""
        if self._file is None or not self._is_new:
            return
        body = marshal.dumps({**self._kept, **self._used})
        if len(body) > MOST_BYTES:
            body = marshal.dumps(self._used)
        part = self._file.with_suffix(f".{os.getpid()}.part")
        with contextlib.suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True)
            try:
                part.write_bytes(_head(body) + body)
                part.replace(self._file)
            finally:
                part.unlink(missing_ok=True)
        self._is_new = False


def _head(body: bytes) -> bytes:
    """Tells which Python wrote the file, and whether it is whole."""
    return importlib.util.MAGIC_NUMBER + zlib.crc32(body).to_bytes(4, "little")


def _read(file: Path | None) -> dict[str, CodeType]:
    """What a file has; nothing where there is none, or another's."""
    try:
        content = b"" if file is None else file.read_bytes()
    except OSError:
        return {}
    length = len(_head(b""))
    body = content[length:]
    if content[:length] != _head(body):
        return {}
    try:
        known = marshal.loads(body)
    except SPOILT:
        return {}
    return known if isinstance(known, dict) else {}


def _file() -> Path | None:
    """Beside the compiled file of this module; None where Python keeps none."""
    if sys.dont_write_bytecode or sys.implementation.cache_tag is None:
        return None
    return Path(importlib.util.cache_from_source(__file__)).with_suffix(SUFFIX)


_CODE = GeneratedCode(_file())
"""Of this process."""


def keep_generated_code() -> None:
    """Have `dataclasses` of this process use what is kept, from here on; for commands, before they import ours."""
    vars(dataclasses)["exec"] = _CODE.execute


def write_generated_code() -> None:
    """Keep what this process has compiled of it for the next."""
    _CODE.write()
