"""Standard streams of a command that are closed, or go to a disk that is full: no reason to lose a picture.

A render that tells how far it is would otherwise end at the first line that has no room in its log. What cannot be
written is lost, the command goes on, and its exit code says so at the end (cli/main.py).
"""

from __future__ import annotations

import codecs
import io
import os
import select
import sys
from typing import Any, TextIO


class _Lossy(io.RawIOBase):
    """Writes as another does, and goes on where that cannot.

    A reader of a pipe who has left is an error as ever, since nobody wants the rest, but where that is not what the
    command is for (outlive_readers).

    Attributes:
        error: why something was lost last; None where all is written.
    """

    def __init__(self, stream: io.TextIOWrapper) -> None:
        self._stream = stream  # which would close its file if nobody had it any more
        self._raw: Any = getattr(stream.buffer, "raw", stream.buffer)
        self.error: OSError | None = None

    def write(self, data: Any, /) -> int | None:
        if _in_haste and not _takes_more(self.fileno()):
            return len(memoryview(data))
        try:
            written: int | None = self._raw.write(data)
        except BlockingIOError:
            raise
        except BrokenPipeError:
            if not _readers_may_leave:
                raise
            return len(memoryview(data))
        except OSError as error:
            self.error = error
            return len(memoryview(data))
        return written

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return int(self._raw.fileno())

    def isatty(self) -> bool:
        return bool(self._raw.isatty())


_readers_may_leave = False
"""Whether what is printed is beside what the command is for."""

_in_haste = False
"""Whether the process is to end now."""

_output: _Lossy | None = None
"""Standard output, once it is taken."""

_ANYTHING = "wdpm.anything"


def _written_somehow(error: UnicodeError) -> tuple[str | bytes, int]:
    """Names of files as the bytes that they are; what else has no encoding (names in a scene) as an escape."""
    try:
        return codecs.lookup_error("surrogateescape")(error)
    except UnicodeEncodeError:
        return codecs.lookup_error("backslashreplace")(error)


codecs.register_error(_ANYTHING, _written_somehow)


def take_streams() -> None:
    """Have standard streams that are there, and take everything; for a process that is a command, at its start."""
    global _output
    _open_closed()
    sys.stdout, _output = _lossy_stream(sys.stdout)
    sys.stderr, _ = _lossy_stream(sys.stderr)


def outlive_readers() -> None:
    """Go on where whoever reads what is printed has left, as `| head` does: what is made goes elsewhere."""
    global _readers_may_leave
    _readers_may_leave = True


def wait_for_no_reader() -> None:
    """Lose what would wait for somebody to read, from now on: of a pipe that is full and a terminal that is held."""
    global _in_haste
    _in_haste = True


def _takes_more(file: int) -> bool:
    """Whether a file takes a line at once; also where nobody can say."""
    if not hasattr(select, "poll"):
        return True
    poll = select.poll()
    poll.register(file, select.POLLOUT)
    return bool(poll.poll(0))


def why_output_lost() -> OSError | None:
    """Why something that went to standard output is not written; None where all is.

    Standard error is for those who watch: a render of which a line there is lost is done all the same.
    """
    return _output.error if _output is not None else None


def _open_closed() -> None:
    """Open what is closed to nowhere: the next file would else be opened in its place, and be printed into."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    if sys.stdin is None:
        sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115 - as long as the process
    if sys.stdout is None:
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115


def _lossy_stream(stream: TextIO) -> tuple[TextIO, _Lossy | None]:
    """The same, whatever becomes of what is written, and what knows it; one that is no file as it is."""
    if not isinstance(stream, io.TextIOWrapper):
        return stream, None
    lossy = _Lossy(stream)
    buffer: Any = lossy if stream.write_through else io.BufferedWriter(lossy)  # as Python does with -u, and without
    wrapper = io.TextIOWrapper(
        buffer,
        stream.encoding,
        _ANYTHING if stream.errors in ("strict", "surrogateescape", "backslashreplace") else stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
    return wrapper, lossy
