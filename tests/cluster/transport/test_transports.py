"""What every transport keeps, and whole clusters over other ones than sockets."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fake_worker import arrays, make_session
from flaky_transport import FlakyTransport
from patience import WAIT_S, wait_until
from slave_threads import SMALL, SlaveThread, check_picture
from slow_slaves import AGREED

from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events
from wdpm.cluster.master.loop import MasterShell
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.transport import registry, stream
from wdpm.cluster.transport.local_sockets import address_for_master
from wdpm.cluster.transport.mailbox import Mailbox
from wdpm.cluster.transport.memory import MemoryTransport
from wdpm.cluster.transport.registry import register, transport_of
from wdpm.cluster.transport.transport import Connection, Network, Role, Transport
from wdpm.cluster.transport.zeromq.network import ZeroMQTransport
from wdpm.scenes.errors import ClusterEndedError, ClusterError, ProtocolError, SettingsError

FROM_SLAVE, FROM_MASTER = packing.by_name(protocol.FromSlave), packing.by_name(protocol.FromMaster)
FROM_PEER = packing.by_name(protocol.FromPeer)

pytestmark = pytest.mark.processes

LONG_S = 2 * WAIT_S
"""Nothing takes so long: who waits for it has not been woken."""

names = (f"place{number}" for number in itertools.count())


def soon(ask: Callable[[], Any], network: Network) -> Any:
    """What is not None, or not False."""
    deadline = time.monotonic() + WAIT_S
    while not (answer := ask()):
        assert time.monotonic() < deadline, f"it did not happen within {WAIT_S:g} s"
        network.wait(0.02)
    return answer


TRANSPORTS: dict[str, tuple[Callable[[], Transport], Callable[[], str]]] = {
    "zeromq": (ZeroMQTransport, lambda: "tcp://127.0.0.1:0"),
    "memory": (MemoryTransport, lambda: f"memory://{next(names)}"),
    "flaky": (FlakyTransport, lambda: f"flaky://{next(names)}"),
}


@pytest.fixture(params=[*TRANSPORTS, "local sockets"])
def place(request: pytest.FixtureRequest) -> Iterator[tuple[Transport, str]]:
    """A transport, and an address of it to listen at."""
    if request.param == "local sockets":
        with address_for_master() as address:
            assert address is not None
            yield ZeroMQTransport(), address
    else:
        make, of = TRANSPORTS[request.param]
        yield make(), of()


@pytest.fixture
def transport(place: tuple[Transport, str]) -> Transport:
    return place[0]


@pytest.fixture
def ends(place: tuple[Transport, str]) -> Iterator[tuple[Network, Any, Network, Connection]]:
    """A network with a listener, and another with a connection to it."""
    transport, address = place
    here, there = transport.open(None), transport.open(None)
    listener = here.listen(address, Role.MASTER, FROM_SLAVE)
    yield here, listener, there, there.connect(listener.endpoint, Role.MASTER, FROM_MASTER, b"slave")
    there.close()
    here.close()


def test_messages_arrive_in_order_and_are_answered(ends: tuple[Network, Any, Network, Connection]) -> None:
    here, listener, there, connection = ends
    assert listener.receive() is None
    assert connection.receive() is None
    for number in range(5):
        assert connection.send(protocol.PeerGone(number))
    for number in range(5):
        assert soon(listener.receive, here) == (b"slave", protocol.PeerGone(number))
    assert listener.send(b"slave", protocol.Stop("enough", True))
    assert soon(connection.receive, there) == protocol.Stop("enough", True)
    assert not connection.broke()


def test_what_is_not_accepted_is_a_protocol_error(ends: tuple[Network, Any, Network, Connection]) -> None:
    here, listener, _, connection = ends
    assert connection.send(protocol.Stop("a slave says what only the master may", True))
    identity, wrong = soon(listener.receive, here)
    assert identity == b"slave"
    assert isinstance(wrong, ProtocolError)


def test_an_answer_to_nobody_is_told(ends: tuple[Network, Any, Network, Connection]) -> None:
    here, listener, _, connection = ends
    assert not listener.send(b"stranger", protocol.Heartbeat())
    assert connection.send(protocol.Heartbeat())
    soon(listener.receive, here)
    connection.close(deliver=False)
    soon(lambda: not listener.send(b"slave", protocol.Heartbeat()), here)


def test_a_connection_that_breaks_says_so_once(ends: tuple[Network, Any, Network, Connection]) -> None:
    here, listener, there, connection = ends
    assert connection.send(protocol.Heartbeat())
    soon(listener.receive, here)
    here.close()
    assert soon(connection.broke, there)
    assert not connection.broke()
    soon(lambda: not connection.send(protocol.Heartbeat()), there)


def test_a_broken_connection_is_heard_of_though_something_else_is_there_each_time(place: tuple[Transport, str]) -> None:
    transport, address = place
    here, there = transport.open(None), transport.open(None)
    listener = here.listen(address, Role.MASTER, FROM_SLAVE)
    connection = there.connect(listener.endpoint, Role.MASTER, FROM_MASTER)
    assert connection.send(protocol.Hello({}, "host", 1, 1, 1, "nowhere"))
    soon(listener.receive, here)
    ear, bell = stream.pair()
    bell.sendall(b".")
    there.watch(ear.fileno())
    here.close()

    def heard() -> bool:
        there.rest(0.0)
        assert there.wait(0.0) == {ear.fileno()}
        return there.stirred and connection.broke()

    wait_until(heard)
    there.close()
    ear.close()
    bell.close()


def test_the_same_identity_again_takes_the_place_of_the_first(
    ends: tuple[Network, Any, Network, Connection],
) -> None:
    here, listener, there, first = ends
    assert first.send(protocol.Note("first"))
    soon(listener.receive, here)
    first.close(deliver=False)
    second = there.connect(listener.endpoint, Role.MASTER, FROM_MASTER, b"slave")
    assert second.send(protocol.Note("again"))
    assert soon(listener.receive, here) == (b"slave", protocol.Note("again"))
    assert listener.send(b"slave", protocol.Heartbeat())
    assert soon(second.receive, there) == protocol.Heartbeat()


def test_arrays_arrive_with_their_bits(transport: Transport, place: tuple[Transport, str]) -> None:
    here, there = transport.open(None), transport.open(None)
    listener = here.listen(here.address_for_peers(transport.resolve(place[1])), Role.SLAVE, FROM_PEER)
    connection = there.connect(listener.endpoint, Role.SLAVE, {})
    sent = Batch.of_task(Kind.LIT, 1, 0, 0, 1, arrays(Kind.LIT, 9))
    assert connection.send(protocol.PeerHello("cluster", 0))
    identity, _ = soon(listener.receive, here)
    listener.admit(identity)
    assert connection.send(protocol.PeerBatches(3, (sent,)))
    _, message = soon(listener.receive, here)
    assert message.epoch == 3
    for name, array in sent.arrays.items():
        np.testing.assert_array_equal(message.batches[0].arrays[name], array)
    there.close()
    here.close()


def test_waiting_ends_when_another_thread_puts_something_in_the_mailbox(transport: Transport) -> None:
    network, mailbox = transport.open(None), Mailbox()
    network.watch(mailbox.fd)
    assert network.wait(0.01) == set()
    timer = threading.Timer(0.05, mailbox.put, ["news"])
    timer.start()
    assert network.wait(LONG_S) == {mailbox.fd}
    timer.join()
    assert mailbox.take() == ["news"]
    assert network.wait(0.01) == set()
    mailbox.close()
    network.close()


def test_waiting_ends_when_a_message_comes(ends: tuple[Network, Any, Network, Connection]) -> None:
    here, listener, _, connection = ends
    timer = threading.Timer(0.05, connection.send, [protocol.Heartbeat()])
    timer.start()
    began = time.monotonic()
    while listener.receive() is None:
        here.wait(LONG_S)
    assert time.monotonic() - began < LONG_S
    timer.join()


def test_messages_do_not_end_a_rest(ends: tuple[Network, Any, Network, Connection]) -> None:
    here, listener, _, connection = ends
    mailbox = Mailbox()
    here.watch(mailbox.fd)
    assert connection.send(protocol.PeerGone(1))
    here.rest(0.05)
    assert mailbox.take() == []
    mailbox.put("done")
    here.rest(LONG_S)  # the time limit of a test would tell
    assert mailbox.take() == ["done"]
    assert soon(listener.receive, here) == (b"slave", protocol.PeerGone(1))
    mailbox.close()


def test_a_place_is_taken_once(place: tuple[Transport, str]) -> None:
    transport, address = place
    here, there = transport.open(None), transport.open(None)
    endpoint = here.listen(address, Role.MASTER, FROM_SLAVE).endpoint
    with pytest.raises(ClusterError, match="cannot listen at"):
        there.listen(endpoint, Role.MASTER, FROM_SLAVE)
    there.close()
    here.close()
    here.close()


@pytest.fixture
def flaky(monkeypatch: pytest.MonkeyPatch) -> FlakyTransport:
    """What flaky:// means in this test."""
    monkeypatch.setattr(registry, "_MAKERS", dict(registry._MAKERS))
    transport = FlakyTransport()
    register("flaky", lambda: transport)
    return transport


def a_cluster(
    address: str, limits: ClusterLimits = SMALL, rejoin: float | None = None
) -> tuple[MasterServer, list[SlaveThread]]:
    master = MasterServer(address, 2, limits=limits, agreed=AGREED)
    return master, [SlaveThread(master.endpoint, rejoin=rejoin) for _ in range(2)]


@pytest.mark.parametrize("scheme", ["memory", "flaky"])
@pytest.mark.usefixtures("flaky")
def test_the_loops_of_master_and_slave_run_over_any_transport(scheme: str) -> None:
    master, slaves = a_cluster(f"{scheme}://{next(names)}")
    with master:
        for digest in ("a", "b"):
            session = make_session(2, 4, digest)
            result = master.render(session)
            check_picture(session, result.layers)
            assert result.dropped == {}
    assert [slave.end() for slave in slaves] == [None, None]


def test_a_transport_sees_every_message(flaky: FlakyTransport) -> None:
    master, slaves = a_cluster(f"flaky://{next(names)}")
    with master:
        master.render(make_session(2, 2))
    assert [slave.end() for slave in slaves] == [None, None]
    to_master = [type(message) for role, message in flaky.sent if role is Role.MASTER]
    to_peers = [type(message) for role, message in flaky.sent if role is Role.SLAVE]
    assert to_master.count(protocol.Hello) == to_master.count(protocol.Goodbye) == 2
    assert to_master[0] is protocol.Hello
    assert to_master[-1] is protocol.Goodbye
    assert set(to_peers[:1]) == {protocol.PeerHello}
    assert to_peers.count(protocol.PeerHello) == 2


def breaking(role: Role, kind: type, times: int) -> Callable[[Role, protocol.Message], bool]:
    """Whether the way of a message breaks: so many times, for some."""
    left = [times]

    def breaks(to: Role, message: protocol.Message) -> bool:
        hit = to is role and isinstance(message, kind) and left[0] > 0
        left[0] -= hit
        return hit

    return breaks


def test_a_broken_way_between_slaves_is_mended(flaky: FlakyTransport) -> None:
    flaky.breaks = breaking(Role.SLAVE, protocol.PeerBatches, 1)
    master, slaves = a_cluster(f"flaky://{next(names)}")
    with master:
        session = make_session(2, 2)
        check_picture(session, master.render(session).layers)
    assert [slave.end() for slave in slaves] == [None, None]


def test_a_way_between_slaves_that_breaks_again_and_again_ends_the_render(flaky: FlakyTransport) -> None:
    flaky.breaks = lambda role, message: role is Role.SLAVE and isinstance(message, protocol.PeerBatches)
    master, slaves = a_cluster(f"flaky://{next(names)}", limits=replace(SMALL, peer_gone_s=0.02))
    with master, pytest.raises(ClusterError, match=r"no task was done since then: the connection from slave .* broke"):
        master.render(make_session(2, 2))
    assert [type(slave.end()) for slave in slaves] == [ClusterEndedError] * 2


def test_a_slave_whose_link_is_slower_than_its_peers_joins_like_others(flaky: FlakyTransport) -> None:
    """Its peers greet it before its own Welcome has come."""
    flaky.delay_s = lambda role, network: 0.4 if role is Role.MASTER and network == 3 else 0.0
    own = flaky.open(None)
    address = f"flaky://{next(names)}"
    with MasterServer(address, 2, limits=SMALL, agreed=AGREED) as master:
        first = SlaveThread(address)
        soon(lambda: flaky.sent, own)
        second = SlaveThread(address)
        session = make_session(2, 2)
        check_picture(session, master.render(session).layers)
    own.close()
    assert [first.end(), second.end()] == [None, None]


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:0", "memory://a-busy-master"])
def test_a_master_that_is_slow_to_answer_loses_no_slave(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A slave that asked again over another connection was taken for one that was lost and came back."""
    handle = MasterShell.handle

    def slow(shell: MasterShell, event: events.Event) -> None:
        if isinstance(event, events.SlaveSaid) and isinstance(event.message, protocol.Hello):
            time.sleep(0.5)
        handle(shell, event)

    monkeypatch.setattr(MasterShell, "handle", slow)
    with MasterServer(address, 2, limits=SMALL, agreed=AGREED) as master:
        slaves = [SlaveThread(master.endpoint, limits=ClusterLimits(join_first_s=0.05)) for _ in range(2)]
        session = make_session(2, 2)
        result = master.render(session)
        check_picture(session, result.layers)
        assert (result.lost, result.dropped) == ((), {})
    assert [slave.end() for slave in slaves] == [None, None]


def test_slaves_that_cannot_reach_each_other_end_the_render(flaky: FlakyTransport) -> None:
    flaky.loses = lambda role, message: role is Role.SLAVE  # noqa: ARG005
    address = f"flaky://{next(names)}"
    with MasterServer(address, 2, limits=SMALL, agreed=AGREED) as master:
        slaves = [SlaveThread(address, limits=ClusterLimits(dead_s=0.3)) for _ in range(2)]
        with pytest.raises(
            ClusterError, match=r"slave \d \(.*\) cannot reach slave \d \(.*\) at flaky://.*: no answer"
        ):
            master.render(make_session(2, 2))
    assert [type(slave.end()) for slave in slaves] == [ClusterEndedError] * 2


def test_a_slave_whose_way_to_the_master_breaks_costs_nothing_but_time(flaky: FlakyTransport) -> None:
    flaky.breaks = breaking(Role.MASTER, protocol.MapsBuilt, 1)
    master, slaves = a_cluster(f"flaky://{next(names)}", rejoin=2.0)
    with master:
        session = make_session(2, 2)
        result = master.render(session)
        check_picture(session, result.layers)
        assert len(result.lost) == 1
    # It tries to join again; this render may be over before it has.
    ended = [slave.end() for slave in slaves]
    assert None in ended
    assert all(error is None or "lost the master" in str(error) for error in ended)


def test_an_address_says_which_transport(flaky: FlakyTransport) -> None:
    assert transport_of("flaky://x") is flaky
    assert transport_of("memory://x") is transport_of("memory://y")
    assert isinstance(transport_of("tcp://127.0.0.1:1"), ZeroMQTransport)
    for wrong in ("carrier pigeon", "udp://127.0.0.1:1", ""):
        with pytest.raises(SettingsError, match="expected tcp://HOST:PORT"):
            transport_of(wrong)
    with pytest.raises(ValueError, match="have a transport already"):
        register("tcp", MemoryTransport)


def test_nobody_listens_under_an_unknown_name() -> None:
    network = MemoryTransport().open(None)
    connection = network.connect("memory://nowhere", Role.MASTER, FROM_MASTER)
    assert not connection.send(protocol.Heartbeat())
    assert not connection.broke()
    with pytest.raises(SettingsError, match="expected memory://NAME"):
        network.listen("memory://", Role.MASTER, FROM_SLAVE)
