"""`wdpm render --slaves N` whose slaves are killed before they have joined, or before they are ready to work."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import tempfile
import time
from pathlib import Path

from commands import command, drawn, options_of
from slaves import ENVIRONMENT
from trials import Trial, digest_of, expected

from wdpm.images.image import load

SLAVES = 4
LONGEST_S = 300.0
"""After which a render counts as hung [s]."""

MOMENTS = ("started", '"event": "joined"', '"phase": "partition"', '"event": "cell sent"', '"event": "ready"')
"""What is there of a render when slaves are struck: all processes, or this in its log."""


def trial(number: int, seed: int) -> Trial:
    """A render that loses one to three of four slaves at one moment of its start."""
    chance = random.Random(f"{seed} early {number}")
    what = drawn(chance, number)
    wanted = expected(*what.picture)
    victims, moment = chance.randint(1, SLAVES - 1), MOMENTS[number % len(MOMENTS)]
    lone = number % 2 == 1
    began = time.monotonic()
    error = _render([what.scene, *options_of(what)], chance, victims, moment, wanted, lone=lone)
    happened = f"{victims} of {SLAVES} killed at {moment}{', and what they were forked from' if lone else ''}"
    return Trial("early", number, what, (happened,), time.monotonic() - began, error=error)


def slaves_of(process: int) -> tuple[list[int], list[int]]:
    """Numbers of the slaves that a process has started, or had forked, and of what they were forked from."""
    started = [child for child in _children(process) if "slave" in _words(child)]
    servers = [child for child in started if "--fork-server" in _words(child)]
    forked = [slave for server in servers for slave in _children(server)]
    return [child for child in started if child not in servers] + forked, servers


def _children(process: int) -> list[int]:
    found = []
    for children in Path(f"/proc/{process}/task").glob("*/children"):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            found += [int(child) for child in children.read_text().split()]
    return found


def _words(process: int) -> list[str]:
    """Its command; nothing if it has ended."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{process}/cmdline").read_text().split("\0")
    return []


def _render(words: list[str], chance: random.Random, victims: int, moment: str, wanted: str, *, lone: bool) -> str:
    """Returns what is wrong.

    Args:
        lone: what slaves are forked from is killed first.
    """
    with tempfile.TemporaryDirectory() as folder:
        output, log, said = Path(folder) / "image.exr", Path(folder) / "log", Path(folder) / "said"
        whole = command("render", *words, "--slaves", str(SLAVES), "--log", str(log), "-o", str(output))
        with said.open("w") as errors:
            render = subprocess.Popen(whole, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=errors)
            try:
                while render.poll() is None:
                    slaves, servers = slaves_of(render.pid)
                    there = log.read_text() if log.exists() else ""
                    if len(slaves) == SLAVES and (moment == "started" or moment in there):
                        for victim in (*(servers if lone else ()), *chance.sample(slaves, victims)):
                            os.kill(victim, signal.SIGKILL)
                        break
                    time.sleep(0.005)
                code = render.wait(LONGEST_S)
            except subprocess.TimeoutExpired:
                return f"not rendered within {LONGEST_S:g} s: {said.read_text()[-500:]}"
            finally:
                render.kill()
                render.wait()
        if code:
            return f"exit code {code}: {said.read_text()[-500:]}"
        digest = digest_of(load(output))
        return "" if digest == wanted else f"bits differ: {digest}, of one process {wanted}"
