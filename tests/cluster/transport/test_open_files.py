"""How many files and sockets a process may open is known before a render, not when ZeroMQ ends it."""

from __future__ import annotations

import errno
import sys
import threading
from collections.abc import Iterator

import pytest
import zmq
from fake_worker import make_session
from free_ports import free_port
from slave_threads import SMALL, SlaveThread, check_picture
from slow_slaves import AGREED

from wdpm.cluster.limits import MOST_SLAVES
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.transport import open_files
from wdpm.cluster.transport.zeromq import network
from wdpm.cluster.transport.zeromq.sockets import make_socket
from wdpm.scenes.errors import MachineError, SettingsError
from wdpm.serving import serve

if sys.platform == "win32":
    pytest.skip("Windows has no such limit", allow_module_level=True)

import resource


class Limit:
    """A soft and a hard limit, in place of this process's."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, soft: int, hard: int) -> None:
        self.soft, self.hard = soft, hard
        monkeypatch.setattr(resource, "getrlimit", lambda _: (self.soft, self.hard))
        monkeypatch.setattr(resource, "setrlimit", self._set)

    def _set(self, _: int, limits: tuple[int, int]) -> None:
        assert limits[1] == self.hard
        assert limits[0] <= self.hard or self.hard == resource.RLIM_INFINITY
        self.soft = limits[0]


@pytest.mark.parametrize("hard", [4096, resource.RLIM_INFINITY])
def test_a_limit_that_may_be_raised_is(monkeypatch: pytest.MonkeyPatch, hard: int) -> None:
    limit = Limit(monkeypatch, 1024, hard)
    open_files.require(8)
    assert limit.soft == 1024
    open_files.require(MOST_SLAVES)
    assert limit.soft == open_files.needed(MOST_SLAVES)


def test_no_limit_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    Limit(monkeypatch, resource.RLIM_INFINITY, resource.RLIM_INFINITY)
    assert open_files.allow(MOST_SLAVES) is None
    open_files.require(MOST_SLAVES)


def test_a_slave_goes_as_far_as_it_may(monkeypatch: pytest.MonkeyPatch) -> None:
    Limit(monkeypatch, 64, 500)
    assert open_files.allow(MOST_SLAVES) == 500


def test_a_slave_that_may_open_too_few_does_not_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    Limit(monkeypatch, 40, 40)
    with pytest.raises(MachineError, match=r"may open 40 files .* talk to a master: .*ulimit -n 1064"):
        serve("tcp://127.0.0.1:7117", None, patience=0.1)


def test_a_slave_connects_with_no_more_others_than_it_may(monkeypatch: pytest.MonkeyPatch) -> None:
    Limit(monkeypatch, 50, 50)
    open_files.require_as_slave(peers=1)
    with pytest.raises(MachineError, match=r"may open 50 files .* talk to 2 other slaves: "):
        open_files.require_as_slave(peers=2)


def test_a_master_that_may_open_too_few_does_not_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    Limit(monkeypatch, 64, 64)
    with pytest.raises(SettingsError, match=r"20 slaves: .* may open 64 .* up to 120: .*ulimit -n 120"):
        MasterServer("memory://master", 20)


@pytest.fixture
def master() -> Iterator[MasterServer]:
    with MasterServer("tcp://127.0.0.1:0", 3, limits=SMALL, agreed=AGREED) as server:
        yield server


def loses_a_slave(master: MasterServer, slaves: list[SlaveThread], said: str) -> None:
    """The first slave leaves, says why, and is done without."""
    session = make_session(3, 4, team_size=3)
    result = master.render(session)
    check_picture(session, result.layers)
    assert len(result.lost) == 1
    assert said in str(slaves[0].end())


@pytest.mark.sockets
@pytest.mark.processes
def test_a_slave_that_may_open_too_few_is_done_without(monkeypatch: pytest.MonkeyPatch, master: MasterServer) -> None:
    """None of the others, whom it cannot talk to, is to blame."""
    slaves = [SlaveThread(master.endpoint) for _ in range(3)]
    master.slaves()
    allow = open_files.allow

    def allowed(count: int) -> int | None:
        return open_files.needed(1) if threading.current_thread() is slaves[0] else allow(count)

    monkeypatch.setattr(open_files, "allow", allowed)
    loses_a_slave(master, slaves, "too few to talk to 1 other slave")


@pytest.mark.sockets
@pytest.mark.processes
def test_a_slave_that_cannot_open_one_more_is_done_without(
    monkeypatch: pytest.MonkeyPatch, master: MasterServer
) -> None:
    slaves = [SlaveThread(master.endpoint) for _ in range(3)]
    master.slaves()

    def opened(context: zmq.Context[zmq.Socket[bytes]], kind: int) -> zmq.Socket[bytes]:
        if threading.current_thread() is slaves[0]:
            raise zmq.ZMQError(errno.EMFILE)
        return make_socket(context, kind)

    monkeypatch.setattr(network, "make_socket", opened)
    loses_a_slave(master, slaves, "no more connections can be opened")


@pytest.mark.sockets
@pytest.mark.processes
def test_a_slave_that_cannot_connect_anew_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[zmq.Socket[bytes]] = []

    def once(context: zmq.Context[zmq.Socket[bytes]], kind: int) -> zmq.Socket[bytes]:
        if kind == zmq.DEALER and opened:
            raise zmq.ZMQError(errno.EMFILE)
        made = make_socket(context, kind)
        opened.extend([made] if kind == zmq.DEALER else [])
        return made

    monkeypatch.setattr(network, "make_socket", once)
    assert "no more connections can be opened" in str(SlaveThread(f"tcp://127.0.0.1:{free_port()}").end())
