"""Fuzz what slaves compute with: numbers of a lying peer, which packing and checks let through, in real kernels.

A batch whose arrays hold others than its sender computed may change the image (a member is believed what it computes),
or end the render with an error that says so. It may not crash a slave, nor make it fail of what is no error of wdpm's.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from fuzz_failure import Failure
from wire_cluster import Frames, WireCluster

import wdpm
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.session import Session
from wdpm.cluster.slave.jobs import Compute
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import World
from wdpm.kernels.launch import Launcher
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes.errors import WdpmError
from wdpm.scenes.flat.arrays import Triangles

SLAVES = 2

_LAUNCHER = Launcher("cpu", 1)

_WORDS = (0, 1, 2, 3, 5, 100, 0x7F7FFFFF, 0x7F800000, 0x7FC00000, 0x80000000, 0xBF800000, 0xFF800000)
"""Small whole numbers, and as floats: denormal, huge, infinite, none, -0 and -1."""


@cache
def session() -> Session:
    """A Cornell box in two cells, as small as can be."""
    settings = RenderSettings(spp=1, photons=1500, k=20)
    scene = wdpm.load("cornell-box", size=(24, 16))
    whole = prepare(scene, settings, SLAVES, _LAUNCHER, SilentProgress(), cells=SLAVES).session
    parts = [whole.partition(cell) for cell in range(SLAVES)]  # a session gives each once
    return replace(whole, partition=parts.__getitem__)


def make_worker(number: int, world: World, partition: Mapping[int, Triangles], holders: Sequence[int]) -> CellWorker:
    """A slave's worker, on one thread."""
    return CellWorker(number, world, partition, holders, _LAUNCHER)


class CellCluster(WireCluster):
    """Slaves that compute, of which one sends its peers other numbers than it has."""

    expected_failures = (WdpmError,)

    def __init__(self, rng: random.Random, liar: int, rate: float) -> None:
        super().__init__(rng, SLAVES, liar, rate)
        self.session = session()
        self._computes = [Compute(make_worker) for _ in range(SLAVES)]

    def _lie(self, frames: Frames) -> Frames:
        if b"PeerBatches" not in frames[0] or len(frames) < 2:
            return frames
        self.outcome.lies += 1
        told = list(frames)
        for _ in range(self._rng.choice((1, 1, 2, 5))):
            place = self._rng.randrange(1, len(told))
            words = np.frombuffer(told[place], "<u4").copy()
            if words.size:
                at = self._rng.randrange(words.size)
                words[at] = self._rng.choice((int(words[at]) ^ 1, (int(words[at]) + 1) & 0xFFFFFFFF, *_WORDS))
                told[place] = words.tobytes()
        return told


def run_case(number: int) -> tuple[int, list[Failure]]:
    """One render. A crash ends the process, and with it the fuzzer; an exception is a failure."""
    rng = random.Random(number)
    cluster = CellCluster(rng, rng.randrange(SLAVES), rng.choice((0.02, 0.1, 0.5)))
    try:
        cluster.run()
    except Exception as error:  # whatever it is that is no error of wdpm's
        return 1, [Failure(f"a crash: {type(error).__name__}: {error}")]
    return 1, []
