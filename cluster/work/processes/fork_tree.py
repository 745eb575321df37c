"""Several processes forked at once: those that are there already help to fork the others.

A fork takes some milliseconds, in which the system copies the tables of all pages, and whoever forks can do no other
meanwhile. So the first process gives half of the processes to the first that it forks, half of what is left to the
next, and they do the same: sixteen are there after five forks' time. All are children of the first process, which
waits for each, and each ends with it.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import signal
import threading
import traceback
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NoReturn

from wdpm.cluster.transport import stream
from wdpm.cluster.work.processes.sibling import can_fork_siblings, fork_sibling

Serve = Callable[[stream.Stream], None]
"""What a forked process does with its end of the stream to the first one. It ends when this returns."""


_growing = threading.Lock()
"""Threads may render at once: what one forks would have the ends of streams that another is about to close, and nobody
would see these end."""


def _let_others_grow() -> None:
    """In a process that was forked: whoever had the lock is not there."""
    global _growing
    _growing = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_others_grow)


@dataclass(frozen=True)
class Forked:
    """A process as the first one knows it.

    Attributes:
        stream: to it. It ends without a word if the process is gone, or has not come about.
    """

    stream: stream.Stream
    _numbers: ctypes.Array[ctypes.c_int32]
    _place: int

    @property
    def pid(self) -> int:
        """0 as long as it is not forked; for good if the stream has ended, or if the one before it in the list has."""
        return int(self._numbers[self._place])


def fork_tree(count: int, serve: Serve, others: Sequence[stream.Stream] = ()) -> list[Forked]:
    """Fork processes from this one.

    Args:
        count: how many, at least 1.
        others: what forked processes have to close, so that whoever is at the other end sees it if this one does.

    Returns:
        Those that have been forked, or will be in a moment, each after the one that forks it. They are fewer than were
        asked for if the system allows no more; and one may not come about even so.

    Raises:
        OSError: the system allows none.
    """
    with _growing:
        return _Tree(count, serve, others).grow()


class _Tree:
    """Processes by their places, from 0; those that a process forks have higher places than its own."""

    def __init__(self, count: int, serve: Serve, others: Sequence[stream.Stream]) -> None:
        self._serve = serve
        self._others = others
        # An anonymous mapping is shared by all that are forked after it.
        self._numbers = (ctypes.c_int32 * count).from_buffer(mmap.mmap(-1, count * ctypes.sizeof(ctypes.c_int32)))
        self._pairs: list[tuple[stream.Stream, stream.Stream]] = []
        try:
            for _ in range(count):
                self._pairs.append(stream.pair())
        except OSError:  # too many open files
            self._close_both(range(len(self._pairs)))
            raise

    def grow(self) -> list[Forked]:
        """Fork all, in the first process."""
        rest = range(len(self._pairs))
        while rest:
            rest, given = divided(rest) if can_fork_siblings() else (rest[1:], rest[:1])
            try:
                pid = self._fork()
            except OSError:
                if len(rest) + len(given) == len(self._pairs):
                    self._close_both(range(len(self._pairs)))
                    raise
                self._close_both([*rest, *given])
                rest, given = range(0), range(0)
                break
            if pid == 0:
                self._begin(given)
            self._numbers[given[0]] = pid
            self._close_theirs(given)
        there = [place for place, (ours, _) in enumerate(self._pairs) if ours.fileno() >= 0]
        return [Forked(self._pairs[place][0], self._numbers, place) for place in there]

    @staticmethod
    def _fork() -> int:
        with warnings.catch_warnings():
            # Python warns of threads, which a fork leaves behind with whatever locks they hold. Those of this process
            # compute (none does now, the launcher has stopped its own), draw a progress bar or wait for a network: none
            # of that is touched on the other side.
            warnings.simplefilter("ignore", DeprecationWarning)
            return os.fork()

    # In a forked process.

    def _begin(self, given: range) -> NoReturn:
        """Be the first of the given places, and fork the others. Never returns: the caller's stack is the parent's."""
        code = 1
        try:
            # Ctrl-C reaches all processes of a terminal; the parent decides what follows.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            for number in (signal.SIGTERM, signal.SIGHUP):
                signal.signal(number, signal.SIG_DFL)
            for other in self._others:
                other.close()
            for ours, _ in self._pairs:
                ours.close()
            place = self._fork_further(given)
            self._serve(self._pairs[place][1])
            code = 0
        except BaseException:
            traceback.print_exc()
        os._exit(code)

    def _fork_further(self, given: range) -> int:
        """Fork all places but the first; the place that this process has then, as each of those comes along here."""
        self._close_theirs(place for place in range(len(self._pairs)) if place not in given)
        place, rest = given[0], given[1:]
        while rest:
            rest, given = divided(rest)
            try:
                pid = fork_sibling(ctypes.addressof(self._numbers) + given[0] * ctypes.sizeof(ctypes.c_int32))
            except OSError:  # the first process sees streams end, and does without
                self._close_theirs([*rest, *given])
                break
            if pid == 0:
                self._close_theirs([place, *rest])
                place, rest = given[0], given[1:]
            else:
                self._close_theirs(given)
        return place

    def _close_theirs(self, places: Iterable[int]) -> None:
        for place in places:
            self._pairs[place][1].close()

    def _close_both(self, places: Iterable[int]) -> None:
        for place in places:
            for end in self._pairs[place]:
                end.close()


def divided(places: range) -> tuple[range, range]:
    """What one forks oneself, and what the process that is forked next does: half, or one more."""
    half = len(places) // 2
    return places[:half], places[half:]


def forks_of_the_first(count: int) -> int:
    """How many of so many processes the first one forks itself."""
    return count.bit_length() if can_fork_siblings() else count
