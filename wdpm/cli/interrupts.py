"""Ctrl-C that is not lost.

Python raises KeyboardInterrupt wherever the main thread is at. In a destructor, which Warp's arrays have, or in a
callback, nobody can catch it: Python prints it and goes on, and so would a render.

A process may also inherit that SIGINT is ignored: shells without job control start what they put in the background so
(POSIX), and schedulers pass it on. A command takes SIGINT all the same, because `kill -INT` is how a job script ends a
master or a slave in good order: what is complete stays, slaves are told, and the exit code is 130. The price: Ctrl-C in
the terminal of such a script ends what it has put in the background, too; who wants otherwise starts it with setsid.
SIGHUP, which nohup has ignored, stays as it was.

SIGTERM is how schedulers, containers and service managers ask a process to end. It is an interrupt like Ctrl-C: a slave
says goodbye, a master tells its slaves, and nothing half written stays. The exit code is 143. So is SIGHUP, which comes
when a terminal is closed or a connection to it lost; the exit code is 129.
"""

from __future__ import annotations

import _thread
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from wdpm.standard_streams import wait_for_no_reader


class Terminated(KeyboardInterrupt):
    """SIGTERM came."""


class HungUp(KeyboardInterrupt):
    """SIGHUP came."""


ENDING: dict[signal.Signals, type[KeyboardInterrupt]] = {signal.SIGTERM: Terminated}
"""What signals raise that end a process."""
if hasattr(signal, "SIGHUP"):  # not on Windows
    ENDING[signal.SIGHUP] = HungUp


def _raise_ending(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - a signal handler
    global _came
    wait_for_no_reader()  # the last lines are for a person, who may be there no more
    _came = ENDING.get(signal.Signals(number), KeyboardInterrupt)
    raise _came


_came: type[KeyboardInterrupt] | None = None
"""What a signal has raised in the command that runs."""


WAIT_S = 0.01
"""Between one look at the main thread and the next."""


@contextmanager
def interrupts_raise() -> Iterator[None]:
    """Have SIGINT raise KeyboardInterrupt, also where it was inherited as ignored; it is as it was afterwards.

    A handler that somebody has installed stays. Only the main thread may set one: elsewhere nothing changes.
    """
    before = signal.getsignal(signal.SIGINT)
    plain = before in (signal.SIG_IGN, signal.default_int_handler)
    if not plain or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, _raise_ending)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def termination_raises() -> Iterator[None]:
    """Have SIGTERM and SIGHUP raise, unless somebody has installed a handler. Nothing changes off the main thread."""
    free = [number for number in ENDING if signal.getsignal(number) is signal.SIG_DFL]
    if threading.current_thread() is not threading.main_thread():
        free = []
    for number in free:
        signal.signal(number, _raise_ending)
    try:
        yield
    finally:
        for number in free:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def interrupts_outlive_imports() -> Iterator[None]:
    """Have an interrupt that came while a compiled module was imported come out as one.

    Such modules say of it that they cannot be imported, and images are written by one that nobody needs before.
    """
    global _came
    _came = None
    try:
        yield
    except ImportError:
        if _came is None:
            raise
        raise _came from None


@contextmanager
def no_lost_interrupts() -> Iterator[None]:
    """Have a KeyboardInterrupt that Python could not raise come again, once it can; for the main thread."""
    before = sys.unraisablehook
    lost = _Lost(before)
    sys.unraisablehook = lost.hook
    try:
        yield
    finally:
        sys.unraisablehook = before
        if lost.take():
            raise lost.kind


class _Lost:
    """Whether an interrupt was lost.

    Args:
        otherwise: told of all other exceptions that cannot be raised.
    """

    def __init__(self, otherwise: Callable[[Any], object]) -> None:
        self._otherwise = otherwise
        self._waiting = False
        self.kind: type[KeyboardInterrupt] = KeyboardInterrupt

    def hook(self, unraisable: Any) -> None:
        """Stands for sys.unraisablehook."""
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            self._otherwise(unraisable)
        elif not self._waiting:
            self._waiting = True
            self.kind = unraisable.exc_type
            # Not threading.Thread: a destructor may run while this thread holds the locks of that module.
            _thread.start_new_thread(self._send_again, ())

    def take(self) -> bool:
        """Whether an interrupt is still to be raised; the caller does that."""
        waiting, self._waiting = self._waiting, False
        return waiting

    def _send_again(self) -> None:
        """Raise the signal as soon as the main thread is out of the destructor and of the hook."""
        main = threading.main_thread().ident
        while self._waiting:
            time.sleep(WAIT_S)
            frame = sys._current_frames().get(main or 0)
            if not self._is_deaf(frame) and self.take():
                again = next((number for number, kind in ENDING.items() if kind is self.kind), signal.SIGINT)
                if hasattr(signal, "pthread_kill"):
                    signal.pthread_kill(main or 0, again)
                else:
                    _thread.interrupt_main(again)

    def _is_deaf(self, frame: FrameType | None) -> bool:
        while frame is not None:
            if frame.f_code.co_name == "__del__" or frame.f_code is _Lost.hook.__code__:
                return True
            frame = frame.f_back
        return False
