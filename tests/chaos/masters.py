"""A master that is killed at random moments and started again with --resume, among slaves that wait for it."""

from __future__ import annotations

import os
import random
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import wdpm
from wdpm.images.image import load

SLAVES = 3
LONGEST_S = 600.0
"""After which a render counts as hung [s]."""

PHASES = ("partition", "photons", "map", "records", "render")
MOST_STEPS = 12
"""In a phase, before a master is killed; the image has more buckets than that."""

Words = list[str]


def command(*words: str) -> Words:
    """wdpm as a process runs it."""
    return [sys.executable, "-m", "wdpm", *words]


class Hung(RuntimeError):
    """A process did not end."""


def ended(process: subprocess.Popen[bytes]) -> int:
    """Its exit code."""
    try:
        return process.wait(LONGEST_S)
    except subprocess.TimeoutExpired:
        process.kill()
        raise Hung(f"{process.args} did not end within {LONGEST_S:g} s") from None


@contextmanager
def waiting_slaves(address: str, environment: dict[str, str]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Slaves that wait for any master at an address for as long as the render may take."""
    words = command("slave", address, "--threads", "1", "--timeout", "600", "--rejoin", "600s")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    slaves = [subprocess.Popen(words, env=environment, **quiet) for _ in range(SLAVES)]
    try:
        yield slaves
    finally:
        for slave in slaves:
            slave.kill()
            slave.wait()


def steps(log: Path, phase: str) -> int:
    """Steps that a master has taken in a phase, by its log; -1 before that begins."""
    if not log.exists():
        return -1
    _, begun, since = log.read_text().rpartition(f'"phase": "{phase}"')
    return since.count('"event": "progress"') if begun else -1


def kill_in(master: subprocess.Popen[bytes], log: Path, phase: str, after: int) -> bool:
    """Kill a master when it has taken some steps in a phase, or is through; False if it was faster."""
    deadline = time.monotonic() + LONGEST_S
    while steps(log, phase) < after and steps(log, "render") < MOST_STEPS:
        if master.poll() is not None:
            return False
        if time.monotonic() > deadline:
            master.kill()
            raise Hung(f"{master.args} did not come so far within {LONGEST_S:g} s")
        time.sleep(0.01)
    master.kill()
    master.wait()
    return True


def render(scene: str, options: Words, chance: random.Random) -> tuple[str, list[str], float]:
    """An image whose master is killed one to three times.

    Returns:
        Digest of the image, what happened, and the time that it took [s].
    """
    environment = {**os.environ, "PYTHONPATH": str(Path(wdpm.__file__).parents[1])}
    happened: list[str] = []
    with tempfile.TemporaryDirectory() as folder, socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        free.close()
        output = Path(folder) / "image.exr"
        words = command("master", scene, *options, "-q", "-o", str(output), "--resume", "--journal", folder)
        log = Path(folder) / "log"
        words += ["--bind", address, "--slaves", str(SLAVES), "--log", str(log)]
        began = time.monotonic()
        with waiting_slaves(address, environment) as slaves:
            for _ in range(chance.randint(1, 3)):
                phase, after = chance.choice(PHASES), chance.randrange(MOST_STEPS)
                master = subprocess.Popen(words, env=environment, stderr=subprocess.DEVNULL)
                if not kill_in(master, log, phase, after):
                    break
                log.unlink()
                journal = output.with_name(output.name + ".wdpm-journal")
                size = journal.stat().st_size if journal.exists() else 0
                happened.append(f"kill in {phase} after {after} ({size // 1024} KiB kept)")
            if not output.exists() and (code := ended(subprocess.Popen(words, env=environment))):
                raise RuntimeError(f"the master ended with {code}, after {', '.join(happened)}")
            codes = [ended(slave) for slave in slaves]
            if codes != [0] * SLAVES:
                raise RuntimeError(f"slaves ended with {codes}, after {', '.join(happened)}")
        return load(output).digest(), happened, time.monotonic() - began
