"""Links that are slow, late, cut or dead: a living master or slave is never taken for a dead one."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple

import pytest
from fake_worker import arrays, make_session, make_view, triangles
from slave_threads import SlaveThread, check_picture
from slow_slaves import AGREED, slow_slave
from tcp_proxy import TcpProxy

from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.local_slaves import LocalSlaves
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.transport.keys import Keys
from wdpm.cluster.transport.transport import Role
from wdpm.cluster.transport.zeromq import sockets
from wdpm.cluster.transport.zeromq.network import ZeroMQTransport
from wdpm.cluster.transport.zeromq.run_keys import RunKeys, slave_keys

pytestmark = pytest.mark.sockets

IMPATIENT = ClusterLimits(heartbeat_s=0.1, late_s=0.5, dead_s=1.0, photon_task_paths=500)
BIG = 13_000
"""Triangles of a cell: 1.8 MB."""
SLOW = 1_000_000.0
"""Bytes a second."""


def big_session(slaves: int) -> Any:
    """A session with one cell that takes far more than `dead_s` over a slow link."""
    cells = slaves if slaves > 1 else 2
    session = make_session(slaves, cells)
    big = triangles(BIG)
    return type(session)(**{**vars(session), "partition": lambda cell: big if cell == 0 else triangles(3, BIG + cell)})


class At(NamedTuple):
    """What happens when a phase begins."""

    phase: str
    action: Callable[[], None]


class Notes:
    """Keeps what a person is told, and does something when a phase begins."""

    def __init__(self, at: At | None = None) -> None:
        self.lines: list[str] = []
        self._at = at

    def start(self, phase: str, total: int | None = None) -> None:  # noqa: ARG002 - a Progress
        if self._at is not None and self._at.phase == phase:
            self._at.action()

    def advance(self, amount: int = 1) -> None: ...

    def note(self, text: str) -> None:
        self.lines.append(text)


@contextmanager
def one_slave_over(
    link_of: Callable[[str], TcpProxy], limits: ClusterLimits = IMPATIENT, keys: Sequence[Keys | None] = (None, None)
) -> Iterator[tuple[MasterServer, TcpProxy]]:
    """A master, and a slave that reaches it over a link and is told that all is rendered."""
    with (
        MasterServer("tcp://127.0.0.1:0", 1, limits=limits, agreed=AGREED, security=keys[0]) as master,
        link_of(master.endpoint) as link,
    ):
        slave = SlaveThread(link.endpoint, security=keys[1], limits=limits)
        yield master, link
        master.close()  # while the link stands
        assert slave.end() is None


@pytest.mark.parametrize("with_keys", [False, True], ids=["open", "keys"])
def test_heartbeats_do_not_wait_behind_bulk_data(with_keys: bool) -> None:
    run = RunKeys()
    keys = (run.master, slave_keys(run.for_slave())) if with_keys else (None, None)
    notes = Notes()
    with one_slave_over(lambda target: TcpProxy(target, bytes_per_s=SLOW), keys=keys) as (master, link):
        session = big_session(1)
        began = time.monotonic()
        check_picture(session, master.render(session, notes).layers)
        assert time.monotonic() - began > 1.5, "the link was not slow"
        assert link.opened == 2
    assert not any("silent" in line for line in notes.lines)


def test_fifty_milliseconds_of_delay() -> None:
    with one_slave_over(lambda target: TcpProxy(target, delay_s=0.05)) as (master, _):
        session = make_session(1, 2)
        check_picture(session, master.render(session).layers)


def test_only_heartbeats_go_over_the_lane() -> None:
    """A lane that carries nothing ends no render, and holds back nothing that counts."""
    with one_slave_over(lambda target: TcpProxy(target, frozen=frozenset({1}))) as (master, link):
        for digest in ("a", "b"):
            session = make_session(1, 2, digest, view=make_view(128, 128))
            check_picture(session, master.render(session).layers)
        assert link.opened == 2


def test_a_connection_that_was_cut_is_noticed_at_once() -> None:
    """The slave joins again over the same link, and the render goes on."""
    with one_slave_over(TcpProxy) as (master, link):
        notes = Notes(At("render", link.cut))
        session = make_session(1, 2)
        began = time.monotonic()
        check_picture(session, master.render(session, notes).layers)
        assert time.monotonic() - began < 20.0
    assert any("is lost" in line for line in notes.lines)


def test_a_stopped_slave_is_waited_for_and_told_of() -> None:
    limits = ClusterLimits(heartbeat_s=0.1, late_s=0.8, dead_s=30.0, photon_task_paths=500)
    slaves = LocalSlaves()
    with ExitStack() as stack:
        stack.callback(slaves.stop)
        master = stack.enter_context(
            MasterServer("tcp://127.0.0.1:0", 2, limits=limits, agreed=AGREED, watch=slaves.ended)
        )
        slaves.start(2, slow_slave(0.02, "life-line"), master.endpoint)
        victim = slaves.processes[1]

        def stop() -> None:
            os.kill(victim, signal.SIGSTOP)
            threading.Timer(1.5, os.kill, (victim, signal.SIGCONT)).start()

        notes = Notes(At("render", stop))
        session = make_session(2, 4, view=make_view(160, 160))
        check_picture(session, master.render(session, notes).layers)
    assert sum("has been silent for" in line for line in notes.lines) == 1
    assert any(line.endswith("is back") for line in notes.lines)


def test_a_link_that_takes_no_byte_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half-open: nobody hangs up, and nothing is carried. The system itself has to give up."""
    monkeypatch.setattr(sockets, "DEAD_S", 1.0)
    here, there = ZeroMQTransport().open(None), ZeroMQTransport().open(None)
    listener = here.listen("tcp://127.0.0.1:0", Role.SLAVE, packing.by_name(protocol.FromPeer))
    with TcpProxy(listener.endpoint) as link:
        connection = there.connect(link.endpoint, Role.SLAVE, {})
        assert connection.send(protocol.PeerHello("cluster", 0))
        while listener.receive() is None:
            here.wait(0.1)
        link.freeze()
        big = Batch(Kind.LIT, 1, 0, 0, 1, arrays(Kind.LIT, 1_000_000))
        assert connection.send(protocol.PeerBatch(1, big))
        began = time.monotonic()
        while not connection.broke():
            there.wait(0.1)
            assert time.monotonic() - began < 20.0
    assert time.monotonic() - began > 0.9
    there.close()
    here.close()
