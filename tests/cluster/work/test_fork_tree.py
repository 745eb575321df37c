"""Processes forked as a tree: all are children of the first, are there before their streams end, and none is left."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import platform
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from patience import wait_until

from wdpm.cluster.work.processes import fork_tree as module
from wdpm.cluster.work.processes import sibling
from wdpm.cluster.work.processes.fork_tree import Forked, fork_tree
from wdpm.cluster.work.processes.forked_tasks import can_fork
from wdpm.cluster.work.processes.sibling import can_fork_siblings

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(not can_fork("cpu"), reason="processes are forked on Linux alone"),
]
OLDER = pytest.mark.skipif(platform.machine() not in sibling._CLONE, reason="its arguments are not known here")
BY_SIBLINGS = pytest.mark.skipif(not can_fork_siblings(), reason="clone3 is not allowed here")


def tell(stream: socket.socket) -> None:
    """Who one is, whose child, and the signal that one does not heed; then wait for the end of the stream."""
    ignores = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    with contextlib.suppress(OSError):  # it has ended already
        stream.sendall(f"{os.getpid()} {os.getppid()} {ignores}".encode())
        stream.recv(1)


def ended(forked: list[Forked]) -> list[int]:
    """Let processes end, and wait for them in the order of the list; their exit codes."""
    for each in forked:
        each.stream.close()
    return [os.waitstatus_to_exitcode(os.waitpid(each.pid, 0)[1]) for each in forked if each.pid]


def without_siblings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "can_fork_siblings", lambda: False)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 16])
@pytest.mark.parametrize(
    "call", [pytest.param("clone3", marks=BY_SIBLINGS), pytest.param("clone", marks=OLDER), "fork"]
)
def test_all_are_children_of_the_first(count: int, call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if call == "clone":
        monkeypatch.setattr(sibling, "_allows_clone3", lambda: False)
    elif call == "fork":
        without_siblings(monkeypatch)
    forked = fork_tree(count, tell)
    said = [each.stream.recv(100).decode() for each in forked]
    assert said == [f"{each.pid} {os.getpid()} True" for each in forked]
    assert len({each.pid for each in forked}) == count
    assert ended(forked) == [0] * count


@BY_SIBLINGS
def test_the_first_process_forks_a_few_of_many(monkeypatch: pytest.MonkeyPatch) -> None:
    forks, fork = [], os.fork

    def noted() -> int:
        forks.append(0)
        return fork()

    monkeypatch.setattr(os, "fork", noted)
    forked = fork_tree(16, tell)
    assert len(forks) == 5
    assert ended(forked) == [0] * 16


def test_a_stream_ends_with_its_process_whoever_else_lives() -> None:
    """So no other process has an end of it."""
    forked = fork_tree(7, tell)
    for each in forked:
        each.stream.recv(100)
    for each in forked:
        os.kill(each.pid, signal.SIGKILL)
        each.stream.settimeout(60)
        assert each.stream.recv(1) == b""
    assert ended(forked) == [-signal.SIGKILL] * 7


def test_processes_end_when_the_first_ones_ends_of_their_streams_do() -> None:
    """Those of processes that were forked before, too: each closes them."""
    before = fork_tree(2, tell)
    after = fork_tree(3, tell, [each.stream for each in before])
    for each in (*before, *after):
        each.stream.recv(100)
    assert ended(before) == [0, 0]
    assert ended(after) == [0, 0, 0]


def refuse(*_: int) -> int:
    raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")


@BY_SIBLINGS
def test_streams_of_those_that_do_not_come_about_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "fork_sibling", refuse)
    forked = fork_tree(7, tell)
    there = [bool(each.stream.recv(100)) for each in forked]
    assert sum(there) == 3  # by the first process: half, half of what is left, the last
    assert [bool(each.pid) for each in forked] == there
    assert ended(forked) == [0] * 3


@pytest.mark.parametrize("allowed", [0, 1, 2])
def test_a_system_that_allows_few_or_none(allowed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    without_siblings(monkeypatch)
    forks, fork = [], os.fork

    def few() -> int:
        forks.append(0)
        return fork() if len(forks) <= allowed else refuse()

    monkeypatch.setattr(os, "fork", few)
    open_before = len(os.listdir("/proc/self/fd"))
    if allowed:
        forked = fork_tree(4, tell)
        assert len(forked) == allowed
        assert ended(forked) == [0] * allowed
    else:
        with pytest.raises(BlockingIOError):
            fork_tree(4, tell)
    assert len(os.listdir("/proc/self/fd")) == open_before


def test_what_a_process_raises_is_told_and_is_its_exit_code(capfd: pytest.CaptureFixture[str]) -> None:
    def fail(_: socket.socket) -> None:
        raise ZeroDivisionError("by nothing")

    assert ended(fork_tree(3, fail)) == [1, 1, 1]
    assert capfd.readouterr().err.count("ZeroDivisionError: by nothing") == 3


@pytest.mark.parametrize(
    ("answer", "fault", "may"), [(-1, errno.EINVAL, True), (-1, errno.ENOSYS, False), (-1, errno.EPERM, False)]
)
def test_whether_a_system_allows_it_is_asked(
    answer: int, fault: int, may: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def call(*_: object) -> int:
        ctypes.set_errno(fault)
        return answer

    monkeypatch.setattr(sibling, "_system_call", call)
    monkeypatch.setattr(sibling, "_allows_clone3", sibling._allows_clone3.__wrapped__)
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")  # where the older call is not known
    assert can_fork_siblings.__wrapped__() is may
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    assert can_fork_siblings.__wrapped__()


def test_a_kernel_that_does_not_tell_where_numbers_of_threads_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sibling, "_tid_address", lambda: 0)
    assert not can_fork_siblings.__wrapped__()


PYTHON_IN_A_SIBLING = """
import os, signal, threading
from wdpm.cluster.work.processes.fork_tree import fork_tree
hooks = []
os.register_at_fork(after_in_child=lambda: hooks.append(os.getpid()))

def work(stream):
    done = threading.Event()
    thread = threading.Thread(target=done.set)  # the interpreter's lock, and its locks of threads, are in order
    thread.start()
    thread.join(60)
    right = done.is_set() and threading.get_native_id() == os.getpid() and hooks[-1] == os.getpid()
    stream.sendall(b"right" if right and threading.main_thread() is threading.current_thread() else b"wrong")
    stream.recv(1)
    signal.raise_signal(signal.SIGTERM)  # the C library knows the thread's number

forked = fork_tree(4, work)
print([each.stream.recv(100).decode() for each in forked])
for each in forked:
    each.stream.close()
print([os.waitstatus_to_exitcode(os.waitpid(each.pid, 0)[1]) for each in forked])
"""


@pytest.mark.parametrize("older", [False, pytest.param(True, marks=OLDER)])
@pytest.mark.parametrize("on_a_thread", [False, True])
def test_python_and_the_c_library_are_in_order_there(on_a_thread: bool, older: bool, tmp_path: Path) -> None:
    code = PYTHON_IN_A_SIBLING
    if older:
        code = f"from wdpm.cluster.work.processes import sibling\nsibling._allows_clone3 = lambda: False\n{code}"
    if on_a_thread:
        code = f"import threading\nthread = threading.Thread(target=lambda: exec({code!r}, {{}}))\nthread.start()\n"
        code += "thread.join()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, timeout=120)
    expected = f"{['right'] * 4}\n{[-signal.SIGTERM] * 4}\n"
    assert done.stdout == expected, done.stderr


def test_all_end_when_the_first_is_killed(tmp_path: Path) -> None:
    """Even those that do nothing but wait, since their streams end."""
    code = (
        "import os, signal, time\nfrom wdpm.cluster.work.processes.fork_tree import fork_tree\n"
        "forked = fork_tree(7, lambda stream: (stream.sendall(b'.'), stream.recv(1)))\n"
        "[each.stream.recv(1) for each in forked]\n"
        "print(*[each.pid for each in forked], flush=True)\nos.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, timeout=120)
    pids = [int(pid) for pid in done.stdout.split()]
    assert len(pids) == 7, done.stderr

    def is_there(pid: int) -> bool:
        return Path(f"/proc/{pid}").exists()

    wait_until(lambda: not any(map(is_there, pids)), "their end")
