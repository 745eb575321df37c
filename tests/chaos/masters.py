"""A master that is killed at random moments and started again with --resume, among slaves that wait for it."""

from __future__ import annotations

import random
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from commands import command, drawn, options_of
from slaves import ENVIRONMENT
from trials import Trial, digest_of, expected

from wdpm.images.image import load

SLAVES = 3
LONGEST_S = 600.0
"""After which a render counts as hung [s]."""

PHASES = ("partition", "photons", "map", "records", "render")
MOST_STEPS = 10
"""In a phase, before a master is killed; the image has more buckets than that."""

KILLS = 5
"""Of the master of one render."""


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
def waiting_slaves(address: str) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Slaves that wait for any master at an address for as long as the render may take."""
    words = command("slave", address, "--threads", "1", "--timeout", "600", "--rejoin", "600s")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    slaves = [subprocess.Popen(words, env=ENVIRONMENT, **quiet) for _ in range(SLAVES)]
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


def trial(number: int, seed: int) -> Trial:
    """An image whose master is killed again and again, or as often as it is slow enough for that."""
    chance = random.Random(f"{seed} masters {number}")
    what = drawn(chance, number)
    wanted = expected(*what.picture)
    happened: list[str] = []
    began = time.monotonic()
    try:
        digest = _render([what.scene, *options_of(what)], chance, happened)
        error = "" if digest == wanted else f"bits differ: {digest}, of one process {wanted}"
    except RuntimeError as failed:
        error = str(failed)
    return Trial("masters", number, what, tuple(happened), time.monotonic() - began, error=error)


def _moments(chance: random.Random) -> list[tuple[str, int]]:
    """Phases, and steps in them, after which a master is killed."""
    return [(chance.choice(PHASES), chance.randrange(MOST_STEPS)) for _ in range(KILLS)]


def _render(words: list[str], chance: random.Random, happened: list[str]) -> str:
    """The digest of an image.

    Args:
        words: the scene and its options.
        happened: what has, is added to it.
    """
    with tempfile.TemporaryDirectory() as folder, socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        free.close()
        output = Path(folder) / "image.exr"
        log = Path(folder) / "log"
        whole = command("master", *words, "-q", "-o", str(output), "--resume", "--journal", folder)
        whole += ["--bind", address, "--slaves", str(SLAVES), "--log", str(log)]
        with waiting_slaves(address) as slaves:
            for phase, after in sorted(_moments(chance), key=lambda moment: PHASES.index(moment[0])):
                master = subprocess.Popen(whole, env=ENVIRONMENT, stderr=subprocess.DEVNULL)
                if not kill_in(master, log, phase, after):
                    break
                log.unlink()
                journal = output.with_name(output.name + ".wdpm-journal")
                size = journal.stat().st_size if journal.exists() else 0
                happened.append(f"kill in {phase} after {after} ({size // 1024} KiB kept)")
            if not output.exists() and (code := ended(subprocess.Popen(whole, env=ENVIRONMENT))):
                raise RuntimeError(f"the master ended with {code}")
            codes = [ended(slave) for slave in slaves]
            if codes != [0] * SLAVES:
                raise RuntimeError(f"slaves ended with {codes}")
        return digest_of(load(output))
