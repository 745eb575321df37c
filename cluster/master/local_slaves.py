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
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from wdpm.scenes.errors import ClusterError

GRACE_S = 5.0
"""How long slaves get to end by themselves before they are killed [s]."""

LOG_TAIL_BYTES = 4096

Command = Callable[[str], Sequence[str]]
"""The master's endpoint -> command line of a slave."""


def slave_command(threads: int, device: str, memory: int | None = None) -> Command:
    """`wdpm slave` with this interpreter, for a run with keys of its own.

    Standard input brings the keys, and is the life line: the slave ends when it closes.
    """

    def command(endpoint: str) -> list[str]:
        options = ["--threads", str(threads), "--device", device, "--keys", "-", "--life-line"]
        options += [] if memory is None else ["--memory", f"{-(-memory // 1024)}K"]
        return [sys.executable, "-m", "wdpm", "slave", endpoint, *options]

    return command


@dataclass(frozen=True)
class _Slave:
    process: subprocess.Popen[bytes]
    log: IO[bytes]


class LocalSlaves:
    """Slave processes; what they print is kept for error messages.

    Each holds the reading end of a pipe as its standard input. The writing end closes when this process ends, however
    it ends, so that no slave outlives it.
    """

    def __init__(self) -> None:
        self._slaves: list[_Slave] = []
        self._reported: set[int] = set()

    def start(self, count: int, command: Command, endpoint: str, first_line: Callable[[], bytes] = bytes) -> None:
        """Start processes; ClusterError if one cannot be started.

        Args:
            first_line: gives what one of them finds on its standard input, before it is only a life line.
        """
        for _ in range(count):
            log = tempfile.TemporaryFile()  # noqa: SIM115 - closed in `stop`
            try:
                process = subprocess.Popen(
                    command(endpoint),
                    stdin=subprocess.PIPE,
                    stdout=log,
                    stderr=log,
                    env=_environment(),
                    # Ctrl-C is the master's to handle: it tells the slaves.
                    start_new_session=True,
                )
            except OSError as error:
                log.close()
                raise ClusterError(f"cannot start a slave: {error.strerror}") from None
            self._slaves.append(_Slave(process, log))
            _tell(process, first_line())

    @property
    def processes(self) -> list[int]:
        """Numbers of those that run."""
        return [slave.process.pid for slave in self._slaves if slave.process.poll() is None]

    def ended(self) -> Iterator[tuple[int, str]]:
        """Processes that have ended since this was last asked: number, and why."""
        for slave in self._slaves:
            code = slave.process.poll()
            if code is not None and slave.process.pid not in self._reported:
                self._reported.add(slave.process.pid)
                yield slave.process.pid, _reason(code, slave.log)

    def stop(self) -> None:
        """Wait for all to end, kill those that do not; may be called again."""
        for slave in self._slaves:
            if slave.process.stdin is not None:
                with contextlib.suppress(BrokenPipeError):  # what an ended one did not read
                    slave.process.stdin.close()
        deadline = time.monotonic() + GRACE_S
        for slave in self._slaves:
            try:
                slave.process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                slave.process.kill()
                slave.process.wait()
            slave.log.close()
        self._slaves = []


def _tell(process: subprocess.Popen[bytes], line: bytes) -> None:
    if process.stdin is not None and line:
        with contextlib.suppress(BrokenPipeError):  # it has ended already, and `ended` will tell why
            process.stdin.write(line)
            process.stdin.flush()


def _environment() -> dict[str, str]:
    """That of this process, in which the slave finds the wdpm that runs here, installed or not."""
    package = importlib.util.find_spec("wdpm")
    if package is None or not package.submodule_search_locations:
        raise AssertionError("wdpm runs, so it can be found")
    folder = str(Path(package.submodule_search_locations[0]).absolute().parent)
    path = os.environ.get("PYTHONPATH")
    return {**os.environ, "PYTHONPATH": folder if not path else folder + os.pathsep + path}


def _reason(code: int, log: IO[bytes]) -> str:
    if code < 0:
        return f"killed by {signal.Signals(-code).name}"
    log.seek(0, os.SEEK_END)
    log.seek(max(0, log.tell() - LOG_TAIL_BYTES))
    lines = log.read().decode(errors="replace").strip().splitlines()
    return f"it ended with exit code {code}" + (f": {lines[-1]}" if lines else "")
