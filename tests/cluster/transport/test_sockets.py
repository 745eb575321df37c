"""Masters and slaves over localhost: few tests, since the state machines have their own.

Slaves are threads where nothing has to die, and processes where something has.
"""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
import zmq
from fake_worker import FakeWorker, arrays, make_session, make_view
from free_ports import free_port
from patience import WAIT_S, wait_until
from slave_threads import SMALL, SlaveThread, check_picture
from slow_slaves import AGREED, PROGRAMS, slow_slave

from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.cluster_events import ClusterEvent
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import loop
from wdpm.cluster.master.local_slaves import LocalSlaves
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.outbox import Outbox
from wdpm.cluster.slave.process import run_slave
from wdpm.cluster.task import PhotonTask, Task
from wdpm.cluster.transport.zeromq.sockets import connect, make_socket, send
from wdpm.scenes.errors import ClusterEndedError, ClusterError, MachineError, SettingsError

pytestmark = [pytest.mark.sockets, pytest.mark.processes]

ANY_PORT = "tcp://127.0.0.1:0"
WAIT_MS = int(1000 * WAIT_S)


def make_master(slaves: int, **options: Any) -> MasterServer:
    return MasterServer(ANY_PORT, slaves, limits=SMALL, agreed=AGREED, **options)


def is_running(process: int) -> bool:
    """Whether a process exists and is no zombie."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


class At:
    """Does something when a phase begins."""

    def __init__(self, phase: str, action: Callable[[], None]) -> None:
        self._phase, self._action = phase, action

    def start(self, phase: str, total: int | None = None) -> None:  # noqa: ARG002 - a Progress
        if phase == self._phase:
            self._action()

    def advance(self, amount: int = 1) -> None: ...

    def note(self, text: str) -> None: ...


@pytest.mark.parametrize("count", [2, 4])
def test_sessions_over_sockets(count: int) -> None:
    with make_master(count) as master:
        slaves = [SlaveThread(master.endpoint) for _ in range(count)]
        first = make_session(count, 4)
        result = master.render(first)
        check_picture(first, result.layers)
        assert result.paths == 1000
        assert sum(values["triangles"] for values in result.statistics) == 5 + 6 + 7 + 8
        second = make_session(count, 4, view=make_view(90, 70, seed=3))
        again = master.render(second)
        check_picture(second, again.layers)
        assert again.seconds.keys() == {"render"}
        assert again.dropped == {}
    assert [slave.end() for slave in slaves] == [None] * count


class Impatient(At):
    """Has enough at the third sign of life."""

    def __init__(self) -> None:
        super().__init__("never", lambda: None)
        self.signs = 0

    def advance(self, amount: int = 1) -> None:
        assert amount == 0
        self.signs += 1
        if self.signs == 3:
            raise KeyboardInterrupt


def test_an_observer_can_end_the_wait_for_slaves() -> None:
    observer = Impatient()
    with make_master(1) as master:
        with pytest.raises(KeyboardInterrupt):
            master.render(make_session(1, 1), observer)
        with pytest.raises(ClusterError, match="has been closed"):
            master.render(make_session(1, 1))
    assert observer.signs == 3


def test_an_ended_cluster_says_so() -> None:
    with make_master(1) as master:
        slave = SlaveThread(master.endpoint)
        master.render(make_session(1, 1))
    assert slave.end() is None
    with pytest.raises(ClusterError, match="has been closed"):
        master.render(make_session(1, 1))


def test_a_slave_may_be_first() -> None:
    port = free_port()
    lines: list[str] = []
    slave = SlaveThread(
        f"tcp://127.0.0.1:{port}", tell=lines.append, limits=ClusterLimits(join_first_s=0.1, join_longest_s=0.4)
    )
    wait_until(lambda: len(lines) > 0)
    assert "no answer" in lines[0]
    with MasterServer(f"tcp://127.0.0.1:{port}", 1, limits=SMALL, agreed=AGREED) as master:
        session = make_session(1, 2)
        check_picture(session, master.render(session).layers)
    assert slave.end() is None


def test_an_unreachable_master_is_given_up() -> None:
    port = free_port()
    with pytest.raises(ClusterError, match=f"no master answered at tcp://127.0.0.1:{port} within 0.3 s"):
        run_slave(f"tcp://127.0.0.1:{port}", FakeWorker, patience=0.3, agreed=AGREED)


def test_other_versions_are_refused() -> None:
    with make_master(1) as master:
        error = SlaveThread(master.endpoint, agreed={"code": "2"}).end()
        assert "refused: versions differ (code: master 1, slave 2)" in str(error)
        slave = SlaveThread(master.endpoint)
        session = make_session(1, 1)
        check_picture(session, master.render(session).layers)
    assert slave.end() is None


def test_a_slave_that_is_late_still_hears_that_it_may_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    """ZeroMQ throws away what has not been read when a connection ends, so the master may not end it first."""
    monkeypatch.setattr(loop, "SEE_OFF_S", 2 * WAIT_S)

    def answer(dealer: zmq.Socket[bytes]) -> Any:
        assert dealer.poll(WAIT_MS)
        return packing.decode(dealer.recv_multipart(), packing.by_name(protocol.FromMaster))

    with zmq.Context() as context, make_socket(context, zmq.DEALER) as dealer, make_master(1) as master:
        connect(dealer, master.endpoint)
        send(dealer, protocol.Hello(AGREED, "host", 1, 1, 0, "tcp://127.0.0.1:9"))
        assert isinstance(answer(dealer), protocol.Welcome)
        closing = threading.Thread(target=master.close)
        closing.start()
        time.sleep(0.5)
        while isinstance(message := answer(dealer), protocol.Heartbeat):
            pass
        assert isinstance(message, protocol.Stop)
        assert closing.is_alive()
        send(dealer, protocol.Goodbye("stopped"))
        closing.join(WAIT_S)
        assert not closing.is_alive()


def test_an_occupied_port() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(ClusterError, match=f"another program uses port {port}"):
            MasterServer(f"tcp://127.0.0.1:{port}", 1, agreed=AGREED)


def test_an_address_of_another_machine() -> None:
    with pytest.raises(SettingsError, match="must be an address of this machine"):
        MasterServer("tcp://192.0.2.1:7117", 1, agreed=AGREED)


def noise(endpoint: str) -> None:
    """Bytes on the wire, frames on the wire, and messages that are nearly right."""
    host, _, port = endpoint.removeprefix("tcp://").rpartition(":")
    rng = np.random.default_rng(0)
    for _ in range(5):
        with socket.create_connection((host, int(port))) as raw:
            raw.sendall(rng.bytes(300))
    good = [bytes(frame) for frame in packing.encode(protocol.Statistics(1, {"a": 1}))]
    batch = protocol.PeerBatches(1, (Batch.of_task(Kind.LIT, 1, 0, 0, 1, arrays(Kind.LIT, 2)),))
    wrong: list[list[bytes]] = [
        [rng.bytes(40)],
        [rng.bytes(40), rng.bytes(4000)],
        [b""],
        [*good, b"one too many"],
        good,
        [bytes(frame) for frame in packing.encode(batch)],
        [msgpack.packb([packing.MAGIC, protocol.PROTOCOL, "TaskDone", [1, ["BucketRendered", [1, 2]]]])],
    ]
    with zmq.Context() as context, context.socket(zmq.DEALER) as dealer:
        dealer.linger = 0
        dealer.connect(endpoint)
        for frames in wrong:
            dealer.send_multipart(frames)
        for _ in wrong:
            assert dealer.poll(WAIT_MS)
            answer = packing.decode(dealer.recv_multipart(), packing.by_name(protocol.FromMaster))
            assert isinstance(answer, protocol.Rejected | protocol.Dismissed)


def test_noise_is_dropped_counted_and_answered() -> None:
    with make_master(1) as master:
        noise(master.endpoint)
        slave = SlaveThread(master.endpoint)
        session = make_session(1, 2)
        result = master.render(session, At("render", lambda: noise(master.endpoint)))
        check_picture(session, result.layers)
        dropped = master.dropped
    # ZeroMQ takes some of the raw bytes for a message of its first protocol, and closes the other connections itself.
    assert dropped["unreadable message"] >= 12
    assert dropped["message before Hello"] == 2
    assert slave.end() is None


def test_a_long_message_of_a_stranger_is_refused_at_once() -> None:
    """Millions of empty lists in a Hello kept the loop that beats the heart busy for seconds."""
    header = msgpack.packb([packing.MAGIC, protocol.PROTOCOL, "Hello", [[[]] * 100_000 for _ in range(13)]])
    frames = packing.encode(protocol.Hello(AGREED, "host", 1, 1, 0, "tcp://127.0.0.1:9"))
    with zmq.Context() as context, make_socket(context, zmq.DEALER) as dealer, make_master(1) as master:
        connect(dealer, master.endpoint)
        long, many = f"at most {packing.STRANGER_BYTES} are taken", "more than 1 frames before it was welcomed"
        for wrong, reason in (([header], long), ([*frames, *[b"x"] * 100], many)):
            dealer.send_multipart(wrong)
            assert dealer.poll(WAIT_MS)
            answer = packing.decode(dealer.recv_multipart(), packing.by_name(protocol.FromMaster))
            assert isinstance(answer, protocol.Rejected)
            assert reason in answer.reason
        assert master.dropped == {"unreadable message": 2}


def test_a_member_with_no_address_ends_the_render_and_stops_no_other_slave() -> None:
    garbage = "tcp://256.1.1.1:9"
    with zmq.Context() as context, make_socket(context, zmq.DEALER) as dealer, make_master(2) as master:
        connect(dealer, master.endpoint)
        send(dealer, protocol.Hello(AGREED, "host", 1, 1, 0, garbage))
        slave = SlaveThread(master.endpoint)
        reason = rf"slave \d .* cannot reach slave \d \(host, process 1\) at {garbage}: cannot connect"
        assert dealer.poll(WAIT_MS)
        with pytest.raises(ClusterError, match=reason):
            master.render(make_session(2, 2))
    assert isinstance(slave.end(), ClusterEndedError)


@pytest.mark.parametrize("error", [ClusterError("no more room"), ValueError("a fault of the program")])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_failing_worker_ends_the_render(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    class Failing(FakeWorker):
        def finish_maps(self) -> None:
            raise error

    with make_master(2) as master:
        slaves = [SlaveThread(master.endpoint, Failing) for _ in range(2)]
        with pytest.raises(ClusterError, match=rf"slave \d \(.*, process {os.getpid()}\) failed: .*{error}"):
            master.render(make_session(2, 2))
        for slave in slaves:
            slave.end()
    traceback_printed = "Traceback" in capsys.readouterr().err
    assert traceback_printed == isinstance(error, ValueError)


OF_WARP = RuntimeError("Failed to allocate 4096 bytes on device 'cpu'")


UNFIT = MachineError("compiled kernels cannot be kept")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MemoryError(), "not enough memory"),
        (OF_WARP, "not enough memory"),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), "not enough memory"),
        (RuntimeError("can't start new thread"), "not enough memory"),
        (OSError(errno.EMFILE, "Too many open files"), "no more files and sockets"),
        (zmq.ZMQError(errno.ENFILE), "no more files and sockets"),
        (UNFIT, "kernels cannot be kept"),
    ],
    ids=["numpy", "warp", "system", "thread", "files", "sockets", "kernels"],
)
@pytest.mark.parametrize("team", [1, 2])
def test_a_slave_whose_machine_is_not_fit_is_done_without(team: int, error: Exception, said: str) -> None:
    class Small(FakeWorker):
        def finish_maps(self) -> None:
            raise error

    with make_master(2) as master:
        slaves = [SlaveThread(master.endpoint, worker) for worker in (Small, FakeWorker)]
        session = make_session(2, 2, team_size=team)
        result = master.render(session)
        check_picture(session, result.layers)
        assert len(result.lost) == 1
    assert said in str(slaves[0].end())
    assert slaves[1].end() is None


def test_no_slave_has_enough_memory() -> None:
    class Small(FakeWorker):
        def finish_maps(self) -> None:
            raise MemoryError

    with MasterServer(ANY_PORT, 2, limits=replace(SMALL, rejoin_s=0.1), agreed=AGREED) as master:
        slaves = [SlaveThread(master.endpoint, Small) for _ in range(2)]
        with pytest.raises(ClusterError, match=r"it left \(it has not enough memory; use more.*no slave is left"):
            master.render(make_session(2, 2))
        for slave in slaves:
            slave.end()


@pytest.mark.parametrize("team", [1, 3])
@pytest.mark.parametrize("phase", ["photons", "render"])
def test_a_render_survives_killed_slaves(team: int, phase: str) -> None:
    slaves = LocalSlaves()
    with contextlib.ExitStack() as stack:
        stack.callback(slaves.stop)
        master = stack.enter_context(make_master(3, watch=slaves.ended))
        slaves.start(3, slow_slave(0.02, "life-line"), master.endpoint)
        processes = slaves.processes

        def kill() -> None:
            for victim in processes[:2]:
                os.kill(victim, signal.SIGKILL)

        session = make_session(3, 4, view=make_view(160, 160), team_size=team)
        result = master.render(session, At(phase, kill))
        check_picture(session, result.layers)
        assert result.paths == 1000
        assert len(result.lost) == 2
    assert not any(is_running(process) for process in processes)


def test_the_last_slave_that_is_killed_ends_the_render() -> None:
    slaves = LocalSlaves()
    with contextlib.ExitStack() as stack:
        stack.callback(slaves.stop)
        master = stack.enter_context(make_master(1, watch=slaves.ended))
        slaves.start(1, slow_slave(0.2, "life-line"), master.endpoint)
        [victim] = slaves.processes
        session = make_session(1, 2, view=make_view(640, 640))
        with pytest.raises(ClusterError, match=rf"slave 0 \(.*, process {victim}\) is lost.*no slave is left"):
            master.render(session, At("render", lambda: os.kill(victim, signal.SIGKILL)))
    assert not is_running(victim)


def test_a_slave_joins_a_render_that_runs() -> None:
    """The first one renders nothing before the second one does: the render runs for as long as that takes."""
    joined = threading.Event()

    class First(FakeWorker):
        def start(self, task: Task) -> Outbox:
            assert isinstance(task, PhotonTask) or joined.wait(WAIT_S), "the second slave was given nothing to do"
            return super().start(task)

    class Late(FakeWorker):
        def start(self, task: Task) -> Outbox:
            joined.set()
            return super().start(task)

    with make_master(1, most=2) as master:
        slaves = [SlaveThread(master.endpoint, First)]
        session = make_session(1, 2, view=make_view(320, 160), team_size=1)
        result = master.render(session, At("render", lambda: slaves.append(SlaveThread(master.endpoint, Late))))
        check_picture(session, result.layers)
        assert {each["slave"] for each in result.statistics} == {0, 1}
    assert [slave.end() for slave in slaves] == [None, None]


def test_a_slave_that_cannot_start_ends_the_render() -> None:
    slaves = LocalSlaves()
    with contextlib.ExitStack() as stack:
        stack.callback(slaves.stop)
        master = stack.enter_context(make_master(1, watch=slaves.ended))
        slaves.start(1, lambda _: [sys.executable, "-c", "raise SystemExit('no such device')"], master.endpoint)
        reason = "ended before it joined: it ended with exit code 1: no such device; no slave is left"
        with pytest.raises(ClusterError, match=reason):
            master.render(make_session(1, 1))


DYING = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
"""A program that is killed before it can join."""


@pytest.mark.parametrize("team", [1, 3])
def test_a_render_begins_without_slaves_that_were_killed_before_they_joined(team: int) -> None:
    slaves = LocalSlaves()
    with contextlib.ExitStack() as stack:
        stack.callback(slaves.stop)
        master = stack.enter_context(make_master(3, watch=slaves.ended))
        slaves.start(2, lambda _: [sys.executable, "-c", DYING], master.endpoint)
        slaves.start(1, slow_slave(0.0, "life-line"), master.endpoint)
        session = make_session(3, 4, view=make_view(64, 64), team_size=team)
        result = master.render(session)
        check_picture(session, result.layers)
        assert len(result.statistics) == 1


@pytest.mark.parametrize("team", [1, 3])
def test_a_render_survives_slaves_that_are_killed_while_the_scene_is_sent(team: int) -> None:
    slaves = LocalSlaves()
    processes: list[int] = []

    def watch(event: ClusterEvent) -> None:
        """Whoever was sent the first part of a cell has not got the cell yet: the master waits for that."""
        if event.name == "joined":
            processes.append(int(event.facts["process"]))
        if event.name == "cell sent" and len(processes) == 3:
            os.kill(processes[int(event.facts["slave"])], signal.SIGKILL)
            processes.clear()

    with contextlib.ExitStack() as stack:
        stack.callback(slaves.stop)
        master = stack.enter_context(make_master(3, watch=slaves.ended, observers=[watch]))
        slaves.start(3, slow_slave(0.0, "life-line"), master.endpoint)
        session = make_session(3, 4, view=make_view(64, 64), team_size=team)
        result = master.render(session)
        check_picture(session, result.layers)
        assert len(result.lost) == 1


def test_a_program_that_does_not_exist_cannot_be_started() -> None:
    slaves = LocalSlaves()
    with pytest.raises(ClusterError, match="cannot start a slave"):
        slaves.start(1, lambda _: ["/no/such/program"], "tcp://127.0.0.1:1")
    slaves.stop()


@contextlib.contextmanager
def master_process(*options: str) -> Iterator[tuple[subprocess.Popen[str], list[int]]]:
    """A master process in the middle of a render, and its slaves' process numbers."""
    with subprocess.Popen(
        [sys.executable, str(PROGRAMS / "master_process.py"), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdout is not None
        slaves = [int(number) for number in process.stdout.readline().split()]
        try:
            assert len(slaves) == 2
            assert process.stdout.readline() == "rendering\n"
            assert all(map(is_running, slaves))
            yield process, slaves
        finally:
            process.kill()
            for slave in filter(is_running, slaves):
                os.kill(slave, signal.SIGKILL)


# A slave on another machine waits a little whether its master comes back.
@pytest.mark.parametrize("options", [("life-line",), ("rejoin=1",)], ids=["local", "remote"])
def test_a_killed_master_leaves_no_slave(options: tuple[str, ...]) -> None:
    with master_process(*options) as (process, slaves):
        process.kill()
        wait_until(lambda: not any(map(is_running, slaves)))


def test_ctrl_c_in_the_master_leaves_no_slave() -> None:
    with master_process("life-line") as (process, slaves):
        process.send_signal(signal.SIGINT)
        assert process.wait(WAIT_S) != 0
        assert not any(map(is_running, slaves))
