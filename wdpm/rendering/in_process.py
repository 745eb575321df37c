"""A cluster in this process for a scene that is prepared: workers, and queues in place of sockets."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import replace

from wdpm.cluster.in_process import NO_TRIANGLES, MemoryCluster
from wdpm.cluster.session import Session
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import World
from wdpm.kernels.launch import Launcher
from wdpm.rendering.prepare import Prepared
from wdpm.scenes.flat.arrays import Triangles


def memory_cluster(
    prepared: Prepared, workers: int, launcher: Launcher, shuffle: random.Random | None = None
) -> tuple[MemoryCluster, Session]:
    """A cluster that renders any number of sessions of a scene, and the session to begin with.

    Args:
        workers: as many as the scene was prepared for.
        shuffle: shuffles the order in which messages arrive.
    """
    pilot = prepared.pilot
    if pilot is None:

        def make_worker(
            number: int, world: World, partition: Mapping[int, Triangles], holders: Sequence[int]
        ) -> CellWorker:
            return CellWorker(number, world, partition, holders, launcher)

        return MemoryCluster(make_worker, workers, shuffle=shuffle), prepared.session

    def adopt(_number: int, world: World, *_others: object) -> CellWorker:
        pilot.adopt(world)
        return pilot

    # The pilot's worker has all triangles already.
    return MemoryCluster(adopt, 1, shuffle=shuffle), replace(prepared.session, partition=lambda _: NO_TRIANGLES)
