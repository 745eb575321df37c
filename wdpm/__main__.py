"""`python -m wdpm` is the command line, and so is the script `wdpm`."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from wdpm.process_exit import leave
from wdpm.standard_streams import take_streams
from wdpm.startup import hold_off_collector


def run() -> NoReturn:
    """Run the command that this process was started for, and end with its exit code."""
    take_streams()
    hold_off_collector()  # until the command has begun
    try:
        with _interrupts_end_at_once():
            from wdpm.cli.main import main
        code = main()
    except KeyboardInterrupt:  # so early that no command was there to take it: nothing is begun, and nothing to be told
        from wdpm.exit_codes import EXIT_INTERRUPTED

        print("wdpm: interrupted", file=sys.stderr)
        code = EXIT_INTERRUPTED
    leave(code)


@contextmanager
def _interrupts_end_at_once() -> Iterator[None]:
    """Have Ctrl-C end the process where it is: nothing is begun.

    Raised while NumPy is imported, it would be lost: its compiled parts then say that they cannot be imported. Who
    ignores SIGINT, or has a handler, keeps that.
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _end_at_once)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end_at_once(number: int, frame: FrameType | None) -> NoReturn:  # noqa: ARG001 - a signal handler
    os.write(2, b"wdpm: interrupted\n")
    os._exit(128 + number)


if __name__ == "__main__":
    run()
