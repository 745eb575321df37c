"""Clusters with keys: each process has its own pair, and lets in those it knows."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zmq
from fake_worker import FakeWorker, make_session
from patience import WAIT_S
from slave_threads import SMALL, SlaveThread, check_picture
from slow_slaves import AGREED

from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.messages.frames import FRAME_BYTES
from wdpm.cluster.slave.process import run_slave
from wdpm.cluster.transport.keys import Keys
from wdpm.cluster.transport.transport import Network, Role
from wdpm.cluster.transport.zeromq import curve
from wdpm.cluster.transport.zeromq.key_files import add_slave, load_keys, make_keys
from wdpm.cluster.transport.zeromq.network import ZeroMQNetwork, ZeroMQTransport
from wdpm.cluster.transport.zeromq.run_keys import RunKeys, slave_keys
from wdpm.cluster.transport.zeromq.sockets import ENVELOPE_BYTES, bind, connect, make_socket
from wdpm.scenes.errors import ClusterError

pytestmark = [pytest.mark.sockets, pytest.mark.processes]

FROM_PEER, PEER_ANSWER = packing.by_name(protocol.FromPeer), packing.by_name(protocol.PeerAnswer)


def make_master(slaves: int, keys: Keys | None) -> MasterServer:
    return MasterServer("tcp://127.0.0.1:0", slaves, limits=SMALL, agreed=AGREED, security=keys)


def knock(endpoint: str, keys: Keys | None) -> None:
    """Try to join, in vain; for longer, if the refusal has not come by then."""
    for patience in (0.5, 5.0, WAIT_S):
        with pytest.raises(ClusterError) as refused:
            run_slave(endpoint, FakeWorker, security=keys, patience=patience, agreed=AGREED, tell=lambda _: None)
        if "no master answered" not in str(refused.value):
            break
    assert "does not accept this slave's keys" in str(refused.value)


def test_a_cluster_with_keys() -> None:
    run = RunKeys()
    with make_master(3, run.master) as master:
        slaves = [SlaveThread(master.endpoint, security=slave_keys(run.for_slave())) for _ in range(3)]
        session = make_session(3, 4)
        check_picture(session, master.render(session).layers)
        for stranger in (None, slave_keys(RunKeys().for_slave())):
            knock(master.endpoint, stranger)
        check_picture(session, master.render(session).layers)
    assert [slave.end() for slave in slaves] == [None, None, None]


@pytest.mark.parametrize("keys", [None, RunKeys()], ids=["open", "curve"])
def test_frames_of_full_length_arrive(keys: RunKeys | None) -> None:
    """Large meshes and textures are sent in frames of FRAME_BYTES, which encryption makes longer."""
    context = zmq.Context[zmq.Socket[bytes]]()
    listening, calling = make_socket(context, zmq.ROUTER), make_socket(context, zmq.DEALER)
    try:
        if keys is not None:
            server = keys.master.own
            curve.serve(listening, server)
            curve.connect(calling, slave_keys(keys.for_slave()).own, server.public)
        connect(calling, bind(listening, "tcp://127.0.0.1:*"))
        sent = [b"header", bytes(FRAME_BYTES), b"end"]
        calling.send_multipart(sent)
        assert listening.poll(int(1000 * WAIT_S)), "the connection was closed"
        assert listening.recv_multipart()[1:] == sent
        calling.send_multipart([b"header", bytes(FRAME_BYTES + ENVELOPE_BYTES + 1)])
        assert not listening.poll(500), "a frame that is too long was taken"
    finally:
        context.destroy(linger=0)


def test_keys_where_the_master_has_none() -> None:
    with make_master(1, None) as master:
        knock(master.endpoint, slave_keys(RunKeys().for_slave()))


def test_a_slave_is_added_while_the_master_waits(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    make_keys(folder)
    anna, bert = (add_slave(folder, name)[0] for name in ("anna", "bert"))
    later = bert.rename(tmp_path / "bert.key")
    with make_master(2, load_keys(folder, Role.MASTER)) as master:
        owns = [load_keys(folder / name, Role.SLAVE) for name in ("anna", "bert")]
        first = SlaveThread(master.endpoint, security=owns[0])
        knock(master.endpoint, owns[1])
        later.rename(bert)
        second = SlaveThread(master.endpoint, security=owns[1])
        session = make_session(2, 2)
        check_picture(session, master.render(session).layers)
    assert anna.exists()
    assert [first.end(), second.end()] == [None, None]


class Peer:
    """A slave's listener, and its connection to another one."""

    def __init__(self, keys: Keys) -> None:
        self.network: ZeroMQNetwork = ZeroMQTransport().open(keys)
        self.listener = self.network.listen("tcp://127.0.0.1:0", Role.SLAVE, FROM_PEER)

    def greet(self, other: Peer) -> Any:
        connection = self.network.connect(other.listener.endpoint, Role.SLAVE, PEER_ANSWER)
        assert connection.send(protocol.PeerHello("cluster", 0))
        return connection


def turns(*networks: Network, until: Callable[[], Any], seconds: float) -> Any:
    """What `until` gives while networks wait for messages in turn; None if it gives nothing in time."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        for network in networks:
            network.wait(0.01)
        if (found := until()) is not None:
            return found
    return None


@pytest.fixture
def peers() -> Any:
    run = RunKeys()
    both = [Peer(slave_keys(run.for_slave())) for _ in range(2)]
    yield both
    for peer in both:
        peer.network.close()


def test_a_peer_that_is_not_known_yet_waits_at_the_door(peers: list[Peer]) -> None:
    """The master tells slaves of each other; to one of them later, if its link is slower."""
    early, late = peers
    early.greet(late)
    networks = (early.network, late.network)
    assert turns(*networks, until=late.listener.receive, seconds=0.3) is None
    late.greet(early)
    _, hello = turns(*networks, until=late.listener.receive, seconds=WAIT_S)
    assert hello == protocol.PeerHello("cluster", 0)


def test_a_peer_that_stays_unknown_is_turned_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(curve, "WAIT_FOR_NEWS_S", 0.2)
    known, unknown = Peer(slave_keys(RunKeys().for_slave())), Peer(slave_keys(RunKeys().for_slave()))
    connection = unknown.greet(known)
    networks = (known.network, unknown.network)

    def refused() -> bool | None:
        connection.broke()
        return connection.refused() or None

    assert turns(*networks, until=refused, seconds=WAIT_S)
    assert known.listener.receive() is None
    for network in networks:
        network.close()


def test_an_impostor_at_a_peers_address_hears_nothing(peers: list[Peer]) -> None:
    """Endpoints say whose key must be there."""
    one, other = peers
    address, own_key = other.listener.endpoint.partition("#")[0], one.listener.endpoint.partition("#")[2]
    wrong = f"{address}#{own_key}"
    connection = one.network.connect(wrong, Role.SLAVE, PEER_ANSWER)
    connection.send(protocol.PeerHello("cluster", 0))
    assert turns(one.network, other.network, until=other.listener.receive, seconds=0.3) is None


@pytest.mark.parametrize("mark", ["", "#", "#00", "#" + "zz" * 32])
def test_endpoints_without_a_key(peers: list[Peer], mark: str) -> None:
    address = peers[1].listener.endpoint.partition("#")[0]
    with pytest.raises(ClusterError, match="cannot connect to"):
        peers[0].network.connect(address + mark, Role.SLAVE, PEER_ANSWER)


def test_a_key_where_there_are_none(peers: list[Peer]) -> None:
    network = ZeroMQTransport().open(None)
    with pytest.raises(ClusterError, match="there are none here"):
        network.connect(peers[0].listener.endpoint, Role.SLAVE, PEER_ANSWER)
    network.close()


def test_many_strangers_at_the_door(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(curve, "MOST_WAITING", 2)
    peer, strangers = (
        Peer(slave_keys(RunKeys().for_slave())),
        [Peer(slave_keys(RunKeys().for_slave())) for _ in range(4)],
    )
    connections = [stranger.greet(peer) for stranger in strangers]

    def two_turned_away() -> bool | None:
        for connection in connections:
            connection.broke()
        return sum(connection.refused() for connection in connections) == 2 or None

    assert turns(peer.network, *(s.network for s in strangers), until=two_turned_away, seconds=WAIT_S)
    for each in (peer, *strangers):
        each.network.close()


def test_nothing_waits_for_a_key_that_comes_with_the_run() -> None:
    """A master knows all its slaves' keys before they knock, also those of slaves that it starts later."""
    run = RunKeys()
    with make_master(1, run.master) as master:
        late = SlaveThread(master.endpoint, security=slave_keys(run.for_slave()))
        session = make_session(1, 1)
        check_picture(session, master.render(session).layers)
    assert late.end() is None
