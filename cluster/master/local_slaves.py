"""Slave processes on this machine, started and ended with the process that wants them."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO

from wdpm.cluster.master.events import ProcessEnded
from wdpm.cluster.transport import fork_server
from wdpm.cluster.transport.fork_server import ENDED_UNTOLD, NOT_FORKED, Forked, ForkServer
from wdpm.scenes.errors import ClusterError

GRACE_S = 5.0
"""How long slaves get to end by themselves before they are killed [s]."""

LOG_TAIL_BYTES = 4096

Command = Callable[[str], Sequence[str]]
"""The master's endpoint -> command line of a slave."""


def slave_command(
    threads: int, device: str, memory: int | None = None, *, keyed: bool = True, wait_for_kernels: bool = True
) -> Command:
    """`wdpm slave` with this interpreter.

    Standard input is the life line: the slave ends when it closes.

    Args:
        keyed: standard input brings keys first, of a run that has some of its own.
        wait_for_kernels: whether it compiles a scene's kernels itself, where others could stand in for them.
    """

    def command(endpoint: str) -> list[str]:
        options = ["--threads", str(threads), "--device", device, "--life-line"]
        options += ["--keys", "-"] if keyed else []
        options += ["--compile", "first" if wait_for_kernels else "no"]
        options += [] if memory is None else ["--memory", f"{-(-memory // 1024)}K"]
        return [sys.executable, "-m", "wdpm", "slave", endpoint, *options]

    return command


class SlaveProcess:
    """A slave process that was started here; what it prints is kept for error messages.

    It holds the reading end of a pipe as its standard input. The writing end closes when this process ends, however it
    ends, so that the slave does not outlive it.

    Args:
        command: its words.
        first_line: what it finds on its standard input, before that is only a life line.
        server: forks it, in place of a program that is started; None for none.
        server_log: what that prints: why there is no process, if it ended before it had forked this one.

    Raises:
        ClusterError: it cannot be started.
    """

    def __init__(
        self,
        command: Sequence[str],
        first_line: bytes = b"",
        server: ForkServer | None = None,
        server_log: IO[bytes] | None = None,
    ) -> None:
        self._server_log = server_log
        self._log = _new_log()  # closed in `stop`
        try:
            there, here = os.pipe()
        except OSError as error:
            self._log.close()
            raise _cannot_start(error) from None
        self._line = os.fdopen(here, "wb", buffering=0)
        try:
            self._process: Forked | subprocess.Popen[bytes] = (
                _start(command, there, self._log) if server is None else server.fork(there, self._log.fileno())
            )
        except ClusterError:
            self._line.close()
            self._log.close()
            raise
        finally:
            os.close(there)
        if first_line:
            with contextlib.suppress(BrokenPipeError):  # it has ended already, and `ended` will tell why
                self._line.write(first_line)

    @property
    def number(self) -> int:
        """Its process number."""
        return self._process.pid

    def ended(self) -> str | None:
        """Why it has ended; None while it runs."""
        code = self._process.poll()
        return None if code is None else _reason(code, self.last_line)

    @property
    def last_line(self) -> str:
        """What it printed last; empty for nothing."""
        return _last_line(self._log) or (_last_line(self._server_log) if self._server_log else "")

    @property
    def exit_code(self) -> int | None:
        """None while it runs; negative for a signal."""
        return self._process.poll()

    def wait(self) -> None:
        """Until it ends."""
        self._process.wait()

    def kill(self) -> None:
        """End it at once."""
        self._process.kill()

    def let_go(self) -> None:
        """Close its life line."""
        self._line.close()

    def leave(self, words: bytes) -> None:
        """Tell it to go on without this process, in words that it knows, and close its life line."""
        with contextlib.suppress(BrokenPipeError):  # it has ended already
            self._line.write(words)
        self.let_go()
        self._log.close()

    def stop(self, seconds: float) -> None:
        """Close its life line, wait for its end so long, and kill it then."""
        self.let_go()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(max(0.0, seconds))
        if self._process.poll() is None:
            self._process.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(GRACE_S)
        self._log.close()


class LocalSlaves:
    """Slave processes on this machine."""

    def __init__(self) -> None:
        self._slaves: list[SlaveProcess] = []
        self._servers: list[tuple[ForkServer, IO[bytes]]] = []
        self._reported: set[SlaveProcess] = set()

    def start(
        self,
        count: int,
        command: Command,
        endpoint: str,
        first_line: Callable[[], bytes] = bytes,
        *,
        forked: bool = False,
    ) -> None:
        """Start processes; ClusterError if one cannot be started.

        Args:
            first_line: gives what one of them finds on its standard input, before it is only a life line.
            forked: whether the command knows `--fork-server`: several are then forked from one, where that can be.
        """
        words = command(endpoint)
        if not (forked and count > 1 and fork_server.can_serve()):
            for _ in range(count):
                self._slaves.append(SlaveProcess(words, first_line()))
            return
        server, log = _fork_server([*words, "--fork-server"])
        self._servers.append((server, log))
        for _ in range(count):  # one by one: `stop` knows those before one that cannot be started
            self._slaves.append(SlaveProcess(words, first_line(), server, log))

    @property
    def processes(self) -> list[int]:
        """Numbers of those that run."""
        return [slave.number for slave in self._running()]

    def _running(self) -> list[SlaveProcess]:
        return [slave for slave in self._slaves if slave.ended() is None]

    def ended(self) -> Iterator[ProcessEnded]:
        """Processes that have ended since this was last asked."""
        for slave in self._slaves:
            reason = slave.ended()
            if reason is not None and slave not in self._reported:
                self._reported.add(slave)
                yield ProcessEnded(slave.number, reason, len(self._running()))

    def stop(self) -> None:
        """Wait for all to end, kill those that do not; may be called again."""
        for slave in self._slaves:
            slave.let_go()
        deadline = time.monotonic() + GRACE_S
        for slave in self._slaves:
            slave.stop(deadline - time.monotonic())
        for server, log in self._servers:
            server.stop()
            log.close()
        self._slaves, self._servers = [], []


def _start(command: Sequence[str], stdin: int, output: IO[bytes]) -> subprocess.Popen[bytes]:
    try:
        return subprocess.Popen(
            command,
            stdin=stdin,
            stdout=output,
            stderr=output,
            env=_environment(),
            # Ctrl-C is the master's to handle: it tells the slaves.
            start_new_session=True,
        )
    except OSError as error:
        raise _cannot_start(error) from None


def _cannot_start(error: OSError) -> ClusterError:
    return ClusterError(f"cannot start a slave: {error.strerror}")


def _new_log() -> IO[bytes]:
    try:
        return tempfile.TemporaryFile()
    except OSError as error:
        raise _cannot_start(error) from None


def _fork_server(command: Sequence[str]) -> tuple[ForkServer, IO[bytes]]:
    """A fork server, and what it prints."""
    log = _new_log()  # closed in `LocalSlaves.stop`
    try:
        ours, theirs = fork_server.pair()
    except OSError as error:
        log.close()
        raise _cannot_start(error) from None
    try:
        with theirs:
            process = _start(command, theirs.fileno(), log)
    except ClusterError:
        ours.close()
        log.close()
        raise

    def end() -> int:
        try:
            return process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()

    return ForkServer(ours, process.pid, end), log


def _environment() -> dict[str, str]:
    """That of this process, in which the slave finds the wdpm that runs here, installed or not."""
    package = importlib.util.find_spec("wdpm")
    if package is None or not package.submodule_search_locations:
        raise AssertionError("wdpm runs, so it can be found")
    folder = str(Path(package.submodule_search_locations[0]).absolute().parent)
    path = os.environ.get("PYTHONPATH")
    return {**os.environ, "PYTHONPATH": folder if not path else folder + os.pathsep + path}


def _reason(code: int, last: str) -> str:
    if code == ENDED_UNTOLD:
        return "it ended, after what would have told how was killed" + (f": {last}" if last else "")
    if code == NOT_FORKED:
        return "it never began, as what was to fork it was stopped"
    if code < 0:
        return f"killed by {signal.Signals(-code).name}"
    return f"it ended with exit code {code}" + (f": {last}" if last else "")


def _last_line(log: IO[bytes]) -> str:
    start = max(0, os.fstat(log.fileno()).st_size - LOG_TAIL_BYTES)
    if hasattr(os, "pread"):  # the process that writes here shares the file's place, which this leaves alone
        tail = os.pread(log.fileno(), LOG_TAIL_BYTES, start)
    else:
        log.seek(start)
        tail = log.read()
    lines = tail.decode(errors="replace").splitlines()
    return next((line.strip() for line in reversed(lines) if line.strip()), "")
