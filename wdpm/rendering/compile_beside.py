"""The process that compiles a scene's kernels beside its render, and after it (kernels_beside.py).

A program: `python -m wdpm.rendering.compile_beside FOLDER EFFECTS...` compiles the kernels of each set of effects,
names with commas between them, into Warp's cache in FOLDER. It ends when standard input closes, which its starter
holds open, unless that has said GO_ON. Where another such process compiles into the same cache it ends at once: renders
that follow each other would leave one each, all at the same.
"""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path
from typing import Final

from wdpm.rendering.record_file import FileLock

NICENESS = 5
"""Added to that of the render: beside a process that renders a compiler has about a quarter of a core."""

COMPILERS = 2
"""At a time. The largest module takes as long as all others together."""

GO_ON: Final = b"go on\n"
"""On standard input: not to end with the process that has started this."""

BUSY: Final = 75
"""Exit code where another process compiles into the same cache (EX_TEMPFAIL of sysexits.h)."""

LOCK: Final = "wdpm-compiling.lock"
"""The file in Warp's cache that says so."""

LIMIT_S = 900.0
"""After which it ends in any case [s]: no compiler takes so long, but a machine may stand still, or its disk."""


def main(arguments: list[str]) -> int:
    """Compile; returns the exit code."""
    folder, *wanted = arguments
    _end_after(LIMIT_S)
    threading.Thread(target=_end_with_starter, daemon=True).start()
    if hasattr(os, "nice"):  # not on Windows
        os.nice(NICENESS)
    try:
        lock = FileLock(Path(folder) / LOCK)
    except BlockingIOError:
        return BUSY
    try:
        _compile(Path(folder), wanted)
    finally:
        lock.release()
    return 0


def _compile(folder: Path, wanted: list[str]) -> None:
    from wdpm.kernels.cached import use_cache_folder
    from wdpm.kernels.compile import compile_for_cpu
    from wdpm.kernels.features import Features
    from wdpm.kernels.variants import make_variants
    from wdpm.quiet import quiet_warp

    quiet_warp()
    use_cache_folder(folder)
    for names in wanted:
        features = Features(**dict.fromkeys(filter(None, names.split(",")), True))
        compile_for_cpu(make_variants(features).modules(), threads=COMPILERS)


def _end_after(seconds: float) -> None:
    timer = threading.Timer(seconds, _end)
    timer.daemon = True
    timer.start()


def _end_with_starter() -> None:
    said = b""
    while piece := os.read(sys.stdin.fileno(), len(GO_ON)):  # no lock of Python's that its end would wait for
        said += piece
    if said != GO_ON:
        os._exit(0)


def _end() -> None:
    from wdpm.kernels.cached import remove_half_made

    remove_half_made(os.getpid())
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
