"""A cluster of a program with several threads: those that ask at once, and one that closes it meanwhile."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from fake_worker import make_session
from patience import WAIT_S
from slave_threads import SMALL, SlaveThread
from slow_slaves import AGREED

import wdpm
from wdpm.cluster.master.server import MasterServer
from wdpm.progress import Progress
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import ClusterError

pytestmark = pytest.mark.sockets


def test_renders_that_threads_ask_for_at_once_come_one_after_the_other() -> None:
    scene = cornell_box((8, 6))
    alone = [wdpm.render(scene, spp=1, photons=500, seed=seed).digest() for seed in range(3)]
    with wdpm.Cluster.local(slaves=1) as cluster, ThreadPoolExecutor(3) as threads:
        asked = [threads.submit(cluster.render, scene, spp=1, photons=500, seed=seed) for seed in range(3)]
        assert [each.result(WAIT_S).digest() for each in asked] == alone


class Begun(Progress):
    """Tells that the master waits for answers."""

    def __init__(self) -> None:
        self.seen = threading.Event()

    def advance(self, amount: int) -> None:  # noqa: ARG002 - that it is called is all
        self.seen.set()


def test_a_render_hears_that_another_thread_has_closed_its_cluster() -> None:
    begun = Begun()
    with MasterServer("tcp://127.0.0.1:0", 2, limits=SMALL, agreed=AGREED) as master, ThreadPoolExecutor(1) as threads:
        slave = SlaveThread(master.endpoint)  # another one never comes
        rendered = threads.submit(master.render, make_session(2, 4), begun)
        assert begun.seen.wait(WAIT_S)
        master.close()
        with pytest.raises(ClusterError, match="has been closed"):
            rendered.result(WAIT_S)
    slave.end()
