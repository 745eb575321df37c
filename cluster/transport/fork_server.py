"""Processes that are forked from one which has loaded what all of them need, and how its owner hears of them.

A slave spends half a second of CPU time on imports and kernels before it has anything to do. Where several are started
at once, one process, the fork server, does that for all, and the pages that it has filled are there once.

The server's standard input is an end of a pair of sockets without a name. An order for a fork brings two descriptors:
the new process's standard input, and what takes its output and errors. News go the other way: whom it has forked, with
a descriptor of that process, and who has ended how. The server outlives its owner no longer than its processes do.
They do not hang on it: if it is killed, nothing more can be forked, and how they end is no longer told, but they go on,
and the owner can still see that they end, and kill them. Linux alone: elsewhere a fork after so many imports is not
safe.
"""

from __future__ import annotations

import errno
import gc
import os
import select
import signal
import socket
import struct
import threading
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from wdpm.scenes.errors import ClusterError, SettingsError

ENDED_UNTOLD = 256
"""In place of an exit code, which is less: it ended after its server, so nobody knows how."""

NOT_FORKED = 257
"""The same: it never came to be, as its server had been stopped, and was given up."""

_ORDER = struct.Struct("<i")  # the number of the process, in the order in which they were asked for

_FORKED, _ENDED = 0, 1
_NEWS = struct.Struct("<iii")  # which, the number of the process, and its process number or its exit code

_OFTEN_S, _GLANCE_S = 0.02, 1.0

LONGEST_S = 30.0
"""How long a number of a process is waited for, and a server that was stopped before it has forked all that it was to
(SIGSTOP): one that loads from a busy disk may take some seconds."""


def can_serve() -> bool:
    """Whether this system has what fork servers need: Linux since 5.3, where a container does not forbid it."""
    if not hasattr(os, "pidfd_open"):
        return False
    try:
        os.close(os.pidfd_open(os.getpid()))
    except OSError:
        return False
    return True


def pair() -> tuple[socket.socket, socket.socket]:
    """The owner's end, and the server's standard input. Each order, and each piece of news, is one packet."""
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)


# The owner's side.


@dataclass(eq=False)
class _Known:
    """What has been heard of a process; its handle is open while it runs."""

    pid: int | None = None
    handle: int | None = None
    code: int | None = None

    def has_ended(self, code: int) -> None:
        """Take that in."""
        self.code = code
        if self.handle is not None:
            os.close(self.handle)
            self.handle = None


class ForkServer:
    """A fork server, as its owner knows it. Any thread may use it.

    Args:
        line: the owner's end of `pair`.
        pid: of the server.
        end: waits for its end, which comes when `line` is closed, or brings it about, and gives its exit code.
    """

    def __init__(self, line: socket.socket, pid: int, end: Callable[[], int]) -> None:
        self.pid = pid
        self._line = line
        self._end = end
        self._known: list[_Known] = []
        self._stopped_s = 0.0  # for how long it was seen to be stopped, while it was to fork something
        self._looked_at = time.monotonic()
        self._code: int | None = None
        self._lock = threading.Lock()

    def fork(self, stdin: int, output: int) -> Forked:
        """Have a process forked; what hinders that is told as its end. Descriptors may be closed afterwards."""
        with self._lock:
            number, known = len(self._known), _Known(code=self._code)
            self._known.append(known)
        with suppress(OSError):  # the server is gone: then so is this
            socket.send_fds(self._line, [_ORDER.pack(number)], [stdin, output])
        return Forked(self, known)

    def kill(self, known: _Known) -> None:
        """End a process at once, if it runs; one that is yet to be forked is waited for no more."""
        with self._lock:
            if known.handle is None:
                known.code = ENDED_UNTOLD if known.code is None else known.code
            else:
                with suppress(ProcessLookupError):
                    signal.pidfd_send_signal(known.handle, signal.SIGKILL)

    def take_news(self, seconds: float = 0.0) -> None:
        """Take in what has come, after waiting so long for some; ClusterError where that takes too many open files."""
        if seconds > 0.0:
            if self._code is None:
                _has_come(self._line.fileno(), seconds)
            else:
                time.sleep(min(seconds, _OFTEN_S))
        with self._lock:
            while self._code is None and _has_come(self._line.fileno()):
                self._take_one()
            if self._code is not None:
                self._look_at(self._known)
            else:
                self._give_up_if_stopped()

    def _give_up_if_stopped(self) -> None:
        """End a server that was stopped, and not to go on again, before it has forked what it was to."""
        awaited = [known for known in self._known if known.pid is None and known.code is None]
        now = time.monotonic()
        since, self._looked_at = min(now - self._looked_at, _GLANCE_S), now  # nobody knows what was while none looked
        self._stopped_s = self._stopped_s + since if awaited and _is_stopped(self.pid) else 0.0
        if self._stopped_s > LONGEST_S:
            for known in awaited:
                known.code = NOT_FORKED
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    def _take_one(self) -> None:
        try:
            news, handles, _, _ = socket.recv_fds(self._line, _NEWS.size, 1, socket.MSG_CMSG_CLOEXEC)
        except ConnectionResetError:
            news, handles = b"", []
        if not news:
            self._is_gone()
            return
        what, number, value = _NEWS.unpack(news)
        known = self._known[number]
        if what == _ENDED:
            known.has_ended(value)
            return
        known.pid = value
        if known.code is not None:  # it was killed before it came to be, and ends with its standard input
            for handle in handles:
                os.close(handle)
            return
        if not handles:  # the system drops what there is no room for
            known.code = ENDED_UNTOLD  # nobody can say when it does: it is let go
            raise ClusterError(f"cannot start a slave: {os.strerror(errno.EMFILE)}")
        (known.handle,) = handles

    def _is_gone(self) -> None:
        """The server has ended. What it has not forked never comes to be."""
        self._code = self._end()
        for known in self._known:
            if known.pid is None and known.code is None:
                known.code = self._code

    def look_at(self, known: _Known) -> None:
        """See whether a process has ended, where the server stands still and does not tell."""
        with self._lock:
            self._look_at([known])

    def _look_at(self, processes: list[_Known]) -> None:
        for known in processes:
            if known.handle is not None and _has_come(known.handle):
                known.has_ended(ENDED_UNTOLD)

    def stop(self) -> None:
        """End it, once all that it has forked have ended; may be called again."""
        with self._lock:
            self._line.close()
            if self._code is None:
                self._is_gone()
            self._look_at(self._known)
            for known in self._known:  # whose ends nobody asks for any more
                if known.handle is not None:
                    known.has_ended(ENDED_UNTOLD)


class Forked:
    """A process of a server, with what subprocess.Popen has of one."""

    def __init__(self, server: ForkServer, known: _Known) -> None:
        self._server = server
        self._known = known

    @property
    def pid(self) -> int:
        """Its process number, which is waited for, LONGEST_S at most; the server's, if it has not come to be."""
        deadline = time.monotonic() + LONGEST_S
        while self._known.pid is None and self._known.code is None and time.monotonic() < deadline:
            self._server.take_news(1.0)
        return self._server.pid if self._known.pid is None else self._known.pid

    def poll(self) -> int | None:
        """Its exit code, negative for a signal, or ENDED_UNTOLD; None while it runs."""
        self._server.take_news()
        return self._known.code

    def wait(self, timeout: float | None = None) -> int | None:
        """As `poll`, but waits for its end, so long at most [s]."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while self.poll() is None:
            left = 1.0 if deadline is None else deadline - time.monotonic()
            if left <= 0.0:
                self._server.look_at(self._known)
                break
            self._server.take_news(left)
        return self._known.code

    def kill(self) -> None:
        """End it at once, if there is such a process; what its server has yet to fork ends with its standard input."""
        self._server.kill(self._known)


def _is_stopped(process: int) -> bool:
    """Whether a process that this one has started was stopped, and has not gone on since."""
    with suppress(OSError):  # it has been waited for, or this system does not tell
        return os.waitid(os.P_PID, process, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None
    return False


def _has_come(descriptor: int, seconds: float = 0.0) -> bool:
    """Whether something can be read, or a process has ended, after waiting so long for it."""
    poll = select.poll()  # where select() knows no descriptor beyond 1,023
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(1000.0 * seconds))


# The server's side.


def serve_forks() -> bool:
    """Be a fork server until the owner is gone and all processes have ended; for a process of one thread.

    Returns:
        True in each process that was forked, which goes on from here, False in the server at the end.

    Raises:
        SettingsError: standard input is no line of an owner.
    """
    with _line_of_owner() as line:
        gc.freeze()  # so that the collector's marks do not copy the pages of all objects into each process
        return _Server(line).run()


def _line_of_owner() -> socket.socket:
    with suppress(OSError):  # it is closed, or no socket
        line = socket.socket(fileno=os.dup(0))
        if can_serve() and line.family == socket.AF_UNIX and line.type == socket.SOCK_SEQPACKET:
            return line
        line.close()
    raise SettingsError("--fork-server is for the process that starts slaves; its orders come over standard input")


class _Server:
    def __init__(self, line: socket.socket) -> None:
        self._line = line
        self._ear, self._bell = socket.socketpair()  # rings when a process has ended
        self._ear.setblocking(False)
        self._bell.setblocking(False)
        self._numbers: dict[int, int] = {}  # of processes that run, by process number

    def run(self) -> bool:
        """See serve_forks."""
        signal.signal(signal.SIGCHLD, lambda _number, _frame: None)
        signal.set_wakeup_fd(self._bell.fileno(), warn_on_full_buffer=False)
        owned = True
        while owned or self._numbers:
            ready, _, _ = select.select([self._ear, *([self._line] if owned else [])], [], [])
            if self._ear in ready:
                with suppress(BlockingIOError):
                    self._ear.recv(4096)
                self._reap()
            if self._line in ready:
                order, descriptors = self._next_order()
                owned = bool(order)
                if owned:
                    (number,) = _ORDER.unpack(order)
                    if self._fork(number, descriptors):
                        return True
        return False

    def _next_order(self) -> tuple[bytes, list[int]]:
        """An order, and the descriptors that came with it; an empty one if the owner is gone."""
        try:
            order, descriptors, _, _ = socket.recv_fds(self._line, _ORDER.size, 2, socket.MSG_CMSG_CLOEXEC)
        except ConnectionResetError:  # before it has heard all news
            return b"", []
        return order, descriptors

    def _fork(self, number: int, descriptors: list[int]) -> bool:
        """Fork a process; whether this is the one that was forked."""
        try:
            with warnings.catch_warnings():
                # Python warns of threads. Those of numpy and scipy, the only ones, their library ends before a fork.
                warnings.simplefilter("ignore", DeprecationWarning)
                pid = os.fork()
        except OSError as error:
            os.write(descriptors[1], f"cannot be forked: {error.strerror}\n".encode())
            self._tell(_ENDED, number, 1)
        else:
            if pid == 0:
                self._become(descriptors)
                return True
            self._numbers[pid] = number
            descriptors = [*descriptors, os.pidfd_open(pid)]
            self._tell(_FORKED, number, pid, descriptors[-1:])
        for descriptor in descriptors:
            os.close(descriptor)
        return False

    def _become(self, descriptors: list[int]) -> None:
        """Be a process of one's own, with this standard input and output."""
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        os.setsid()
        stdin, output = descriptors
        for descriptor, place in ((stdin, 0), (output, 1), (output, 2)):
            os.dup2(descriptor, place)
        for descriptor in descriptors:
            os.close(descriptor)
        self._ear.close()
        self._bell.close()

    def _reap(self) -> None:
        for pid, number in list(self._numbers.items()):
            ended, status = os.waitpid(pid, os.WNOHANG)
            if ended:
                del self._numbers[pid]
                self._tell(_ENDED, number, os.waitstatus_to_exitcode(status))

    def _tell(self, what: int, number: int, value: int, handle: list[int] | None = None) -> None:
        with suppress(OSError):  # the owner is gone
            socket.send_fds(self._line, [_NEWS.pack(what, number, value)], handle or [])
