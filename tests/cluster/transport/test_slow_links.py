"""Links that are slow, late, cut or dead: a living master or slave is never taken for a dead one."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple

import pytest
from fake_worker import arrays, make_session, make_view, triangles
from patience import wait_until
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

pytestmark = [pytest.mark.sockets, pytest.mark.processes]

IMPATIENT = ClusterLimits(heartbeat_s=0.1, late_s=2.0, dead_s=3.0, photon_task_paths=500)
"""No thread of a process stands still for so long while another one runs, however laden the machine."""

PATIENT = ClusterLimits(heartbeat_s=0.1, photon_task_paths=500)
"""Silence is no death in any test: what is noticed is noticed otherwise."""

BIG = 13_000
"""Triangles of a cell: 1.8 MB."""
SLOW = 450_000.0
"""Bytes a second."""


def big_session(slaves: int) -> Any:
    """A session with one cell that takes far more than `dead_s` over a slow link."""
    cells = slaves if slaves > 1 else 2
    session = make_session(slaves, cells)
    big = triangles(BIG)
    return type(session)(**{**vars(session), "partition": lambda cell: big if cell == 0 else triangles(3, BIG + cell)})


class At(NamedTuple):
    """What happens when a phase begins, or a line comes."""

    phase: str
    action: Callable[[], None]


class Notes:
    """Keeps what a person is told, and does something when a phase begins, or when a line with some words comes."""

    def __init__(self, at: At | None = None, at_line: At | None = None) -> None:
        self.lines: list[str] = []
        self._at = at
        self._at_line = at_line

    def start(self, phase: str, total: int | None = None) -> None:  # noqa: ARG002 - a Progress
        if self._at is not None and self._at.phase == phase:
            self._at.action()

    def advance(self, amount: int = 1) -> None: ...

    def note(self, text: str) -> None:
        self.lines.append(text)
        if self._at_line is not None and self._at_line.phase in text:
            self._at_line.action()


@contextmanager
def one_slave_over(
    link_of: Callable[[str], TcpProxy], limits: ClusterLimits = PATIENT, keys: Sequence[Keys | None] = (None, None)
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
    with one_slave_over(lambda target: TcpProxy(target, bytes_per_s=SLOW), IMPATIENT, keys) as (master, link):
        session = big_session(1)
        began = time.monotonic()
        result = master.render(session, notes)
        assert time.monotonic() - began > IMPATIENT.dead_s, "the link was not slow"
        check_picture(session, result.layers)
        assert link.opened == 2
    assert len(result.lost) == 0


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
        wait_until(lambda: link.opened == 2, "the lane")  # a small render may end before it is there


def test_a_connection_that_was_cut_is_noticed_at_once() -> None:
    """The slave joins again over the same link, and the render goes on."""
    with one_slave_over(TcpProxy) as (master, link):
        notes = Notes(At("render", link.cut))
        session = make_session(1, 2)
        check_picture(session, master.render(session, notes).layers)
    assert any("is lost" in line for line in notes.lines)
    assert not any("silent" in line for line in notes.lines)


def test_a_stopped_slave_is_waited_for_and_told_of() -> None:
    """It goes on as soon as its silence has been noticed."""
    limits = ClusterLimits(heartbeat_s=0.1, late_s=0.8, photon_task_paths=500)
    slaves = LocalSlaves()
    with ExitStack() as stack:
        stack.callback(slaves.stop)
        master = stack.enter_context(
            MasterServer("tcp://127.0.0.1:0", 2, limits=limits, agreed=AGREED, watch=slaves.ended)
        )
        slaves.start(2, slow_slave(0.02, "life-line"), master.endpoint)
        victim = slaves.processes[1]

        notes = Notes(
            At("render", lambda: os.kill(victim, signal.SIGSTOP)),
            At(f"process {victim}) has been silent for", lambda: os.kill(victim, signal.SIGCONT)),
        )
        session = make_session(2, 4, view=make_view(160, 160))
        result = master.render(session, notes)
        check_picture(session, result.layers)
    told = [line.partition(") ")[2] for line in notes.lines if f"process {victim})" in line]
    assert any(line.startswith("has been silent for") for line in told)
    assert "is back" in told
    assert len(result.lost) == 0


def test_a_link_that_takes_no_byte_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half-open: nobody hangs up, and nothing is carried. The system itself has to give up."""
    monkeypatch.setattr(sockets, "DEAD_S", 1.0)
    here, there = ZeroMQTransport().open(None), ZeroMQTransport().open(None)
    listener = here.listen("tcp://127.0.0.1:0", Role.SLAVE, packing.by_name(protocol.FromPeer))
    with TcpProxy(listener.endpoint) as link:
        connection = there.connect(link.endpoint, Role.SLAVE, {})
        assert connection.send(protocol.PeerHello("cluster", 0))
        wait_until(lambda: listener.receive() is not None, "a greeting", lambda: here.wait(0.1))
        link.freeze()
        big = Batch.of_task(Kind.LIT, 1, 0, 0, 1, arrays(Kind.LIT, 1_000_000))
        began = time.monotonic()
        assert connection.send(protocol.PeerBatches(1, (big,)))
        wait_until(connection.broke, "the end of the connection", lambda: there.wait(0.1))
    assert time.monotonic() - began > 0.9
    there.close()
    here.close()
