"""Renders of a local cluster whose slave processes are killed, terminated or stopped for a while, at random moments.

Each image must have the bits of one process, and no render may hang. `make chaos` runs it; a page goes to out/chaos.
Of --masters more renders the master is killed, and started again with --resume (masters.py).

    python tests/chaos/run.py --renders 40 --masters 10 --seed 1 -o out/chaos
"""

from __future__ import annotations

import argparse
import itertools
import os
import random
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import masters

import wdpm
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import Indirect, Routing
from wdpm.images.image import Image
from wdpm.scenes.model.scene import Scene

SLAVES = 4
FAULTS = {"kill": signal.SIGKILL, "term": signal.SIGTERM, "stop": signal.SIGSTOP}
STOPPED_S = 3.0
"""How long a process that is stopped stands still [s]."""


@dataclass(frozen=True)
class Trial:
    """One render.

    Attributes:
        faults: what happened, and when, as a share of the time of an undisturbed render.
        seconds, undisturbed: wall-clock.
    """

    copies: str
    routing: str
    indirect: str
    faults: tuple[str, ...]
    seconds: float
    undisturbed: float
    bits_equal: bool


def run(scene: Scene, renders: int, seed: int) -> Iterator[Trial]:
    """Render again and again."""
    chance = random.Random(seed)
    expected: dict[Indirect, str] = {}
    for _ in range(renders):
        copies, routing = chance.choice(list(Copies)), chance.choice(list(Routing))
        indirect = chance.choice([Indirect.CACHE, Indirect.MAP])
        chosen = {"photons": 20_000, "spp": 8, "routing": routing, "indirect": indirect}
        if indirect not in expected:
            expected[indirect] = _digest(wdpm.render(scene, **chosen))
        with wdpm.Cluster.local(SLAVES, copies=copies) as cluster:
            cluster.render(scene, **{**chosen, "photons": 1000, "spp": 1})
            began = time.monotonic()
            cluster.render(scene, **{**chosen, "seed": 1})
            undisturbed = time.monotonic() - began
            happened: list[str] = []
            with _faults(chance, cluster.processes, undisturbed, happened):
                began = time.monotonic()
                image = cluster.render(scene, **chosen)
                seconds = time.monotonic() - began
        equal = _digest(image) == expected[indirect]
        yield Trial(copies.value, routing.value, indirect.value, tuple(happened), seconds, undisturbed, equal)


def run_masters(name: str, size: str, renders: int, seed: int) -> Iterator[Trial]:
    """Renders whose master is killed."""
    chance = random.Random(seed)
    width, height = map(int, size.split("x"))
    scene = wdpm.load(name, size=(width, height))
    expected: dict[tuple[Indirect, int], tuple[str, float]] = {}
    for _ in range(renders):
        copies, routing = chance.choice(list(Copies)), chance.choice(list(Routing))
        indirect, passes = chance.choice([Indirect.CACHE, Indirect.MAP]), chance.choice([1, 2])
        chosen = {"photons": 20_000, "spp": 8, "routing": routing, "indirect": indirect, "passes": passes}
        options = [f"--{name}={getattr(value, 'value', value)}" for name, value in chosen.items()]
        options += ["--size", size, "--copies", copies.value, "--bucket", "16"]
        if (indirect, passes) not in expected:
            began = time.monotonic()
            digest = _digest(wdpm.render(scene, **chosen))
            expected[indirect, passes] = digest, time.monotonic() - began
        digest, undisturbed = expected[indirect, passes]
        found, happened, seconds = masters.render(name, options, chance)
        what = (copies.value, routing.value, f"{indirect.value}, {passes} passes")
        yield Trial(*what, tuple(happened), seconds, undisturbed, found == digest)


@contextmanager
def _faults(chance: random.Random, processes: tuple[int, ...], duration: float, happened: list[str]) -> Iterator[None]:
    """Faults of one to three of the processes, each at a random moment."""
    timers = []
    for victim in chance.sample(processes, chance.randint(1, SLAVES - 1)):
        kind, moment = chance.choice(list(FAULTS)), chance.random()
        timers.append(threading.Timer(moment * duration, _strike, (kind, moment, victim, happened)))
    for timer in timers:
        timer.start()
    try:
        yield
    finally:
        for timer in timers:
            timer.cancel()
            timer.join()


def _strike(kind: str, moment: float, process: int, happened: list[str]) -> None:
    happened.append(f"{kind} at {moment:.0%}")
    os.kill(process, FAULTS[kind])
    if kind == "stop":
        time.sleep(STOPPED_S)
        os.kill(process, signal.SIGCONT)


def _digest(image: Image) -> str:
    return Image({name: layer for name, layer in image.layers.items() if name != "cell"}).digest()


def page(trials: list[Trial], seed: int) -> str:
    """A table of all renders, as Markdown."""
    slaves = [t for t in trials if "passes" not in t.indirect]
    equal, worst = sum(t.bits_equal for t in trials), max((t.seconds / t.undisturbed for t in slaves), default=0.0)
    lines = [
        f"# {equal} of {len(trials)} renders have the bits of one process (seed {seed})",
        "",
        f"{SLAVES} slaves; the longest took {worst:.2f} times as long as undisturbed.",
        f"Where masters were killed: {masters.SLAVES} slaves, and the time of starting all processes is included; "
        "undisturbed is that of one process, which is there already.",
        "",
        "| copies | routing | indirect | faults | s | undisturbed | bits |",
        "| --- | --- | --- | --- | ---: | ---: | --- |",
    ]
    lines += [
        f"| {t.copies} | {t.routing} | {t.indirect} | {', '.join(t.faults)} | {t.seconds:.1f} | {t.undisturbed:.1f} | "
        f"{'equal' if t.bits_equal else 'DIFFER'} |"
        for t in trials
    ]
    return "\n".join(lines) + "\n"


def main() -> int:
    """Run, print and write; 1 if an image differed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--renders", type=int, default=40)
    parser.add_argument("--masters", type=int, default=0, help="renders whose master is killed")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scene", default="cornell-box")
    parser.add_argument("--size", default="128x128")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/chaos"))
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    scene = wdpm.load(args.scene, size=(width, height))
    args.output.mkdir(parents=True, exist_ok=True)
    trials: list[Trial] = []
    lost = run_masters(args.scene, args.size, args.masters, args.seed)
    for trial in itertools.chain(run(scene, args.renders, args.seed), lost):
        trials.append(trial)
        print(f"{len(trials)}: {trial}", flush=True)
        (args.output / "index.md").write_text(page(trials, args.seed))  # as it goes: what was found is kept
    return int(not all(trial.bits_equal for trial in trials))


if __name__ == "__main__":
    raise SystemExit(main())
