"""Processes that are forked from a server: their input and output, how they end, and what ends with what."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NamedTuple

import pytest
from patience import WAIT_S, wait_until

from wdpm.cluster.master import local_slaves
from wdpm.cluster.master.local_slaves import LocalSlaves
from wdpm.cluster.transport import fork_server
from wdpm.cluster.transport.fork_server import ENDED_UNTOLD, Forked, ForkServer, can_serve
from wdpm.scenes.errors import ClusterError

pytestmark = [
    pytest.mark.sockets,
    pytest.mark.processes,
    pytest.mark.skipif(not can_serve(), reason="this system forks no slaves"),
]

PROGRAM = """
import os, signal, sys
from wdpm.cluster.transport.fork_server import serve_forks
loaded = os.getpid()
if serve_forks():
    line = sys.stdin.readline()
    print(line.strip(), loaded == os.getppid(), os.getsid(0) == os.getpid(), flush=True)
    if "kill" in line:
        os.kill(os.getpid(), signal.SIGKILL)
    sys.stdin.read()
    raise SystemExit(7)
print("over", flush=True)
"""
"""A server whose processes print what they are told, and end when their input does."""

NEVER = "import sys; sys.exit('no such device')"
"""A server that ends before it has forked anything."""


STILL = "import os, signal; os.kill(os.getpid(), signal.SIGSTOP)"
"""A server that stands still before it has forked anything."""


class Told(NamedTuple):
    """A process, the writing end of its input, and what it prints."""

    process: Forked
    line: IO[bytes]
    log: IO[bytes]

    def said(self) -> str:
        """All that it has printed."""
        return os.pread(self.log.fileno(), 4096, 0).decode()


class Server(NamedTuple):
    server: ForkServer
    process: subprocess.Popen[str]
    stack: contextlib.ExitStack

    def fork(self, text: str) -> Told:
        """A process that is told this."""
        there, here = os.pipe()
        line = self.stack.enter_context(os.fdopen(here, "wb", buffering=0))
        log = self.stack.enter_context(tempfile.TemporaryFile())  # noqa: SIM115
        process = self.server.fork(there, log.fileno())
        os.close(there)
        with contextlib.suppress(BrokenPipeError):  # there is no such process
            line.write(f"{text}\n".encode())
        return Told(process, line, log)


@contextlib.contextmanager
def serving(program: str = PROGRAM) -> Iterator[Server]:
    """A fork server of a program."""
    with contextlib.ExitStack() as stack:
        ours, theirs = fork_server.pair()
        with theirs:
            words = [sys.executable, "-c", program]
            process = subprocess.Popen(
                words, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
            )
        server = ForkServer(ours, process.pid, lambda: process.wait(WAIT_S))
        try:
            yield Server(server, process, stack)
        finally:
            stack.close()
            process.kill()
            process.wait()
            server.stop()
            assert process.stdout is not None
            process.stdout.close()


@contextlib.contextmanager
def no_more_files() -> Iterator[None]:
    """What this process would open is refused, whatever it has open."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    tempfile.gettempdir()  # which is found out by a file
    resource.setrlimit(resource.RLIMIT_NOFILE, (1, before[1]))  # not 0, as one may be waited for
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def is_at_work(process: int) -> bool:
    """Whether there is such a process, which has not ended: whoever has taken it on may not have waited for it yet."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2][0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def handles_here() -> int:
    """How many processes this one has handles of: other files that it has open may be closed by a collector."""
    found = 0
    for number in os.listdir("/proc/self/fd"):
        with contextlib.suppress(FileNotFoundError):
            found += "pidfd" in os.readlink(f"/proc/self/fd/{number}")
    return found


def test_each_has_its_own_input_and_output_and_is_heard_of_when_it_ends() -> None:
    with serving() as server:
        anna, bert = server.fork("anna"), server.fork("bert")
        assert len({anna.process.pid, bert.process.pid, server.process.pid}) == 3
        wait_until(anna.said)
        wait_until(bert.said)
        assert [anna.said(), bert.said()] == ["anna True True\n", "bert True True\n"]
        assert anna.process.poll() is None
        assert anna.process.wait(0.01) is None
        anna.line.close()
        assert anna.process.wait(WAIT_S) == 7
        assert bert.process.poll() is None
        bert.process.kill()
        assert bert.process.wait() == -signal.SIGKILL
        carl = server.fork("kill")
        assert carl.process.wait() == -signal.SIGKILL
        anna.process.kill()  # it has ended: nobody else is killed in its place
        assert anna.process.poll() == 7


def test_the_server_ends_when_its_owner_is_gone_and_all_have_ended() -> None:
    with serving() as server:
        anna = server.fork("anna")
        wait_until(anna.said)
        server.server._line.close()
        assert server.process.poll() is None
        anna.line.close()
        said, _ = server.process.communicate(timeout=WAIT_S)
        assert (said, server.process.returncode) == ("over\n", 0)


def test_those_of_a_server_that_is_killed_go_on_and_are_seen_to_end() -> None:
    with serving() as server:
        anna, bert = server.fork("anna"), server.fork("bert")
        numbers = [anna.process.pid, bert.process.pid]
        wait_until(anna.said)
        server.process.kill()
        assert server.fork("carl").process.wait(WAIT_S) == -signal.SIGKILL
        assert [anna.process.poll(), bert.process.poll()] == [None, None]
        anna.line.close()
        assert anna.process.wait(WAIT_S) == ENDED_UNTOLD
        bert.process.kill()
        assert bert.process.wait(WAIT_S) == ENDED_UNTOLD
        wait_until(lambda: not any(map(is_at_work, numbers)))


def test_those_of_a_server_that_stands_still_are_seen_to_end() -> None:
    with serving() as server:
        anna = server.fork("anna")
        wait_until(anna.said)
        assert anna.process.pid != server.process.pid
        server.process.send_signal(signal.SIGSTOP)
        anna.line.close()
        wait_until(lambda: anna.process.wait(0.01) == ENDED_UNTOLD)


def test_one_that_is_killed_before_it_is_forked_is_not_waited_for() -> None:
    with serving() as server:
        anna = server.fork("anna")
        wait_until(anna.said)
        assert anna.process.poll() is None
        server.process.send_signal(signal.SIGSTOP)
        bert = server.fork("bert")
        bert.process.kill()
        assert bert.process.poll() == ENDED_UNTOLD
        held = handles_here()
        server.process.send_signal(signal.SIGCONT)
        wait_until(bert.said)
        assert bert.process.poll() == ENDED_UNTOLD
        assert handles_here() == held
        bert.line.close()
        wait_until(lambda: bert.process.poll() == 7)


def test_nothing_of_the_server_is_open_in_what_it_has_forked() -> None:
    count = "print(len(os.listdir('/proc/self/fd')), len(os.listdir('/proc/self/task')), flush=True)"
    with serving(PROGRAM.replace("    sys.stdin.read()", f"    {count}\n    sys.stdin.read()")) as server:
        said = []
        for name in ("anna", "bert"):
            told = server.fork(name)
            wait_until(lambda told=told: told.said().count("\n") == 2)
            said.append(told.said().split("\n")[1])
        assert said == ["4 1", "4 1"]  # input, output, errors, and the listing; one thread


def test_what_a_server_that_never_forked_ended_of_is_what_its_processes_did() -> None:
    with serving(NEVER) as server:
        anna = server.fork("anna").process
        assert anna.wait(WAIT_S) == 1
        assert anna.pid == server.process.pid
        assert server.fork("bert").process.wait(WAIT_S) == 1


def test_where_no_process_can_be_forked_it_ends_and_says_so() -> None:
    refuse = "import os\ndef fork(): raise BlockingIOError(11, 'Resource temporarily unavailable')\nos.fork = fork\n"
    with serving(refuse + PROGRAM) as server:
        anna = server.fork("anna")
        assert anna.process.wait(WAIT_S) == 1
        assert anna.said() == "cannot be forked: Resource temporarily unavailable\n"
        assert server.process.poll() is None


def test_one_whose_descriptor_has_no_room_is_an_error_once_and_the_next_is_not() -> None:
    with serving() as server:
        anna = server.fork("anna")
        wait_until(anna.said)
        with no_more_files(), pytest.raises(ClusterError, match=r"^cannot start a slave: Too many open files$"):
            anna.process.poll()
        assert anna.process.poll() == ENDED_UNTOLD
        anna.line.close()
        assert server.fork("bert").process.poll() is None


def test_whoever_asks_for_one_by_hand_is_told_what_it_is_in_a_line() -> None:
    command = [sys.executable, "-m", "wdpm", "slave", "tcp://127.0.0.1:1", "--fork-server"]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=WAIT_S)
    assert done.returncode == 2
    [line] = done.stderr.splitlines()
    assert line.startswith("wdpm: error: --fork-server is for the process that starts slaves")


@pytest.mark.parametrize("count", [1, 2])
def test_slaves_that_would_be_too_many_open_files_are_an_error(count: int) -> None:
    slaves = LocalSlaves()
    with no_more_files(), pytest.raises(ClusterError, match=r"^cannot start a slave: Too many open files$"):
        slaves.start(count, lambda _: [sys.executable, "-c", PROGRAM], "", forked=True)
    slaves.stop()


def test_slaves_that_are_forked_end_as_others_do() -> None:
    slaves = LocalSlaves()
    with contextlib.ExitStack() as stack:
        stack.callback(slaves.stop)
        slaves.start(3, lambda _: [sys.executable, "-c", PROGRAM], "", lambda: b"anna\n", forked=True)
        numbers = slaves.processes
        assert len(numbers) == 3
        assert list(slaves.ended()) == []
        os.kill(numbers[1], signal.SIGKILL)
        wait_until(lambda: len(slaves.processes) == 2)
        assert [(each.process, each.reason, each.left) for each in slaves.ended()] == [
            (numbers[1], "killed by SIGKILL", 2)
        ]
        assert list(slaves.ended()) == []
    assert not any(map(is_at_work, numbers))


def test_slaves_go_on_without_their_server() -> None:
    slaves = LocalSlaves()
    with contextlib.ExitStack() as stack:
        stack.callback(slaves.stop)
        slaves.start(2, lambda _: [sys.executable, "-c", PROGRAM], "", lambda: b"anna\n", forked=True)
        numbers = slaves.processes
        os.kill(int(Path(f"/proc/{numbers[0]}/stat").read_text().rpartition(") ")[2].split()[1]), signal.SIGKILL)
        assert slaves.processes == numbers
        os.kill(numbers[1], signal.SIGKILL)
        wait_until(lambda: slaves.processes == numbers[:1])
        (told,) = slaves.ended()
        assert told.process == numbers[1]
        assert told.reason.startswith("it ended, after what would have told how was killed")
    wait_until(lambda: not any(map(is_at_work, numbers)))


def test_slaves_of_a_server_that_stands_still_from_the_start_are_not_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(local_slaves, "GRACE_S", 0.2)
    slaves = LocalSlaves()
    slaves.start(2, lambda _: [sys.executable, "-c", STILL], "", lambda: b"anna\n", forked=True)
    assert list(slaves.ended()) == []
    ((server, _),) = slaves._servers
    slaves.stop()
    assert not is_at_work(server.pid)


def test_slaves_of_a_server_that_was_stopped_for_good_are_said_not_to_come(monkeypatch: pytest.MonkeyPatch) -> None:
    """In place of a wait for those who are to join."""
    monkeypatch.setattr(fork_server, "LONGEST_S", 0.2)
    slaves, told = LocalSlaves(), []
    slaves.start(2, lambda _: [sys.executable, "-c", STILL], "", lambda: b"anna\n", forked=True)
    ((server, _),) = slaves._servers
    wait_until(lambda: told.extend(slaves.ended()) or len(told) == 2)
    assert [(each.process, each.reason) for each in told] == [
        (server.pid, "it never began, as what was to fork it was stopped")
    ] * 2
    assert slaves.processes == []
    slaves.stop()
    assert not is_at_work(server.pid)


def test_a_server_that_was_stopped_for_a_while_is_not_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fork_server, "LONGEST_S", WAIT_S)
    with serving() as server:
        server.process.send_signal(signal.SIGSTOP)
        wait_until(lambda: fork_server._is_stopped(server.process.pid))
        anna = server.fork("anna")
        wait_until(lambda: anna.process.poll() is not None or server.server._stopped_s > 0.0)
        server.process.send_signal(signal.SIGCONT)
        wait_until(anna.said)
        assert anna.process.poll() is None
        assert server.server._stopped_s == 0.0
        assert not fork_server._is_stopped(server.process.pid)


def test_slaves_whose_server_cannot_start_say_why() -> None:
    slaves = LocalSlaves()
    with contextlib.ExitStack() as stack:
        stack.callback(slaves.stop)
        slaves.start(2, lambda _: [sys.executable, "-c", NEVER], "", forked=True)
        wait_until(lambda: not slaves.processes)
        assert [each.reason for each in slaves.ended()] == ["it ended with exit code 1: no such device"] * 2
    with pytest.raises(ClusterError, match="cannot start a slave"):
        slaves.start(2, lambda _: ["/no/such/program"], "", forked=True)
