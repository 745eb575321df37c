"""How a slave ends with which nothing is wrong: told so by its master, or because that has gone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest
from slave_threads import SlaveThread

from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.transport.registry import transport_of
from wdpm.cluster.transport.transport import Listener, Network, Role
from wdpm.scenes.errors import ClusterEndedError, ClusterError, MasterLostError

pytestmark = pytest.mark.processes

ADDRESS = "memory://how-slaves-end"


@pytest.fixture
def slave() -> SlaveThread:
    return SlaveThread(ADDRESS, rejoin=1.0)


@pytest.fixture
def master() -> Iterator[tuple[Network, Listener]]:
    """Nothing but a listener."""
    with closing(transport_of(ADDRESS).open(None)) as network:
        yield network, network.listen(ADDRESS, Role.MASTER, packing.by_name(protocol.FromSlave))


def let_in(network: Network, listener: Listener) -> bytes:
    """Take the slave's Hello; returns its identity."""
    while (received := listener.receive()) is None:
        network.wait(0.1)
    identity, hello = received
    assert isinstance(hello, protocol.Hello)
    listener.admit(identity)
    listener.send(identity, protocol.Welcome(0, "cluster", 1.0, 60.0))
    return identity


def test_a_master_that_goes(master: tuple[Network, Listener], slave: SlaveThread) -> None:
    let_in(*master)
    master[0].close()
    error = slave.end()
    assert isinstance(error, MasterLostError)
    assert "lost the master" in str(error)


def test_a_master_that_has_no_image(master: tuple[Network, Listener], slave: SlaveThread) -> None:
    identity = let_in(*master)
    master[1].send(identity, protocol.Stop("a slave failed", False))
    error = slave.end()
    assert type(error) is ClusterEndedError
    assert "without an image: a slave failed" in str(error)


def test_no_master() -> None:
    error = SlaveThread("memory://nobody", patience=0.3).end()
    assert type(error) is ClusterError
    assert "no master answered" in str(error)
