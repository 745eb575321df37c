"""Connections that swallow what goes one way, while everything else is carried: nobody waits for ever for what is gone.

A firewall, or a proxy that has lost its other half, may acknowledge every byte and pass none on. The system sees a
connection in order, and heartbeats go over another one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial

import pytest
from fake_worker import FakeWorker, make_session, make_view
from links import LinkedTransport, Links
from patience import wait_until
from slave_threads import SlaveThread, check_picture
from slow_slaves import AGREED
from tcp_proxy import TcpProxy
from test_slow_links import At, Notes, big_session

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.session import SessionResult
from wdpm.cluster.transport import registry
from wdpm.cluster.transport.receipts import patience_s
from wdpm.scenes.errors import ClusterError, MasterLostError

pytestmark = [pytest.mark.sockets, pytest.mark.processes]

LIMITS = ClusterLimits(
    heartbeat_s=0.1,
    late_s=2.0,
    dead_s=3.0,
    peer_gone_s=0.2,
    rejoin_s=2.0,
    rejoin_longest_s=0.5,
    photon_task_paths=500,
    part_triangles=600,
)
"""No thread of a process stands still for so long while another one runs, however laden the machine."""

SLOW = 300_000.0
"""Bytes a second, at which each part of a cell takes a tenth of the time that counts as death."""

BULK = 0
"""The first connection over a link to a master carries all but heartbeats, which have the second."""

LATER = range(2, 100)
"""Connections over the same link that are made later."""


class Linked:
    """A master and slaves in this process, each of which has links to its master and from its peers.

    Attributes:
        notes: what the person at the master was told, and told: the one at each slave.
        ends: what ended each slave.
    """

    def __init__(self, slaves: int) -> None:
        self.slaves = slaves
        self.links = [Links() for _ in range(slaves)]
        self.notes: list[str] = []
        self.told: list[list[str]] = [[] for _ in range(slaves)]
        self.ends: list[BaseException | None] = []

    def to_master(self, slave: int) -> TcpProxy:
        """The link that a slave reaches its master by."""
        return self.links[slave].opened[0]

    def from_peers(self, slave: int) -> TcpProxy:
        """The link that others reach a slave by."""
        return self.links[slave].opened[1]

    def render(self, harm: Callable[[], None], delay: float = 0.01) -> SessionResult:
        """An image that takes a while; the links are harmed when buckets begin: all have said who they are.

        Args:
            delay: of each task [s].
        """
        session = make_session(self.slaves, 2 * self.slaves, view=make_view(160, 160))
        notes = Notes(At("render", harm))
        self.notes = notes.lines
        with ExitStack() as stack:
            master = stack.enter_context(MasterServer("tcp://127.0.0.1:0", self.slaves, limits=LIMITS, agreed=AGREED))
            threads = []
            for links, told in zip(self.links, self.told, strict=True):
                stack.callback(links.close)
                worker = partial(FakeWorker, delay=delay)
                with scheme_of(links) as scheme:
                    address = master.endpoint.replace("tcp", scheme, 1)
                    threads.append(SlaveThread(address, worker, limits=LIMITS, tell=told.append, rejoin=3.0))
                    wait_until(lambda links=links: len(links.opened) == 2, "the links of a slave")
            try:
                result = master.render(session, notes)
            finally:
                master.close()
                self.ends = [thread.end() for thread in threads]
            check_picture(session, result.layers)
        return result


@contextmanager
def scheme_of(links: Links) -> Iterator[str]:
    """Whose addresses are reached over these links."""
    registry.register("linked", lambda: LinkedTransport(links))
    try:
        yield "linked"
    finally:
        del registry._MAKERS["linked"]


@pytest.mark.parametrize("there", [True, False], ids=["to-master", "to-slave"])
def test_between_a_master_and_its_only_slave(there: bool) -> None:
    """The slave joins again, over another connection: which of the two finds it tells the other."""
    cluster = Linked(1)
    result = cluster.render(lambda: cluster.to_master(0).swallow(BULK, there=there))
    assert len(result.lost) == 1
    assert cluster.ends == [None]
    why = "nothing that was sent to the master has come" if there else "it takes this slave for lost"
    assert any(why in line for line in cluster.told[0])
    assert there or any("nothing that was sent to it has come" in line for line in cluster.notes)


def test_batches_between_two_slaves() -> None:
    """They connect again, and none of them is lost."""
    cluster = Linked(2)

    def harm() -> None:
        for slave in range(2):
            cluster.from_peers(slave).swallow(0, there=True)

    result = cluster.render(harm)
    assert len(result.lost) == 0
    assert any("they connect again" in line for line in cluster.notes)
    assert any("nothing that was sent to slave" in line for line in cluster.notes)


def test_receipts_between_two_slaves() -> None:
    """Nobody can tell that batches come: they connect again, too."""
    cluster = Linked(2)
    result = cluster.render(lambda: cluster.from_peers(0).swallow(0, there=False), delay=0.1)
    assert len(result.lost) == 0
    assert any("they connect again" in line for line in cluster.notes)


def test_a_slave_that_cannot_come_back_leaves_the_others_alone() -> None:
    cluster = Linked(2)
    result = cluster.render(lambda: cluster.to_master(0).swallow(BULK, *LATER, there=True))
    assert len(result.lost) == 1
    assert [end is None for end in cluster.ends] == [False, True]


def test_where_nobody_is_left_the_render_ends_with_one_error() -> None:
    cluster = Linked(1)
    with pytest.raises(ClusterError, match="no slave is left, and none came within 2 s"):
        cluster.render(lambda: cluster.to_master(0).swallow(BULK, *LATER, there=True))
    assert [type(end) for end in cluster.ends] == [MasterLostError]


def test_all_that_comes_is_known_to_have_come() -> None:
    """Or a cluster that has nothing to do for a while would fall apart."""
    with MasterServer("tcp://127.0.0.1:0", 2, limits=LIMITS, agreed=AGREED) as master:
        slaves = [SlaveThread(master.endpoint, limits=LIMITS) for _ in range(2)]
        notes = Notes()
        for digest in ("a", "b"):
            session = make_session(2, 4, digest)
            result = master.render(session, notes)
            check_picture(session, result.layers)
            time.sleep(1.5 * patience_s(LIMITS.dead_s))
            assert len(result.lost) == 0
    assert [slave.end() for slave in slaves] == [None, None]
    assert not any("lost" in line or "broke" in line for line in notes.lines)


def test_a_slow_link_that_moves_is_not_given_up() -> None:
    """What waits takes longer than anybody may be silent, and no part of it does."""
    with (
        MasterServer("tcp://127.0.0.1:0", 1, limits=LIMITS, agreed=AGREED) as master,
        TcpProxy(master.endpoint, bytes_per_s=SLOW) as link,
    ):
        slave = SlaveThread(link.endpoint, limits=LIMITS)
        session = big_session(1)
        began = time.monotonic()
        result = master.render(session)
        assert time.monotonic() - began > 1.5 * patience_s(LIMITS.dead_s), "the link was not slow"
        check_picture(session, result.layers)
        master.close()  # while the link stands
        assert slave.end() is None
    assert len(result.lost) == 0
