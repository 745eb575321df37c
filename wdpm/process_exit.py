"""The end of a process that is a command.

Python ends by taking apart all that it has made, object by object: a third of a second for what a render imports, after
the image is written and while somebody waits. The operating system takes the memory away in no time. So what others
asked for at the end is done (threads are joined, functions of `atexit` called, streams flushed), and then the process
leaves.
"""

from __future__ import annotations

import atexit
import os
import sys
import threading
from typing import Any, NoReturn

NOT_FLUSHED = 120
"""Exit code of Python where what was printed could not be written."""


def leave(code: int) -> NoReturn:
    """End this process, as `sys.exit` does from the main thread and outside of all functions; see above."""
    join_threads: Any = getattr(threading, "_shutdown", None)  # of Python 3.11 to 3.14; no public name has it
    if join_threads is None or _is_watched():
        sys.exit(code)
    join_threads()
    atexit._run_exitfuncs()
    os._exit(code if _flush() else NOT_FLUSHED)


def _is_watched() -> bool:
    """Whether somebody waits for Python's own end: a profiler, a debugger, or a person who will look around."""
    return sys.getprofile() is not None or sys.gettrace() is not None or bool(sys.flags.inspect)


def _flush() -> bool:
    """Whether all that was printed is written."""
    try:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None and not stream.closed:
                stream.flush()
    except OSError:
        return False
    return True
