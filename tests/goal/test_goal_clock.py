"""Processor time of a process and of those that it has forked, at work, ended, and waited for."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from wdpm.goal import clock

pytestmark = pytest.mark.processes

SPENT_S = 0.2
"""What each child takes, of what the system counts in hundredths."""

ABOUT_S = 0.05


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system forks no processes")
def test_a_child_counts_once_it_was_waited_for() -> None:
    before = clock.cpu_seconds()
    pid = os.fork()
    if pid == 0:
        began = time.process_time()
        while time.process_time() < began + SPENT_S:
            pass
        os._exit(0)
    os.waitpid(pid, 0)
    assert clock.cpu_seconds() - before >= SPENT_S - ABOUT_S


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="this system does not tell of children at work")
def test_a_child_counts_before_it_ends_and_no_more_when_it_has() -> None:
    before = clock.cpu_seconds()
    code = f"import time\nwhile time.process_time() < {SPENT_S}: pass\nprint(flush=True)\ninput()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.readline()
        at_work = clock.cpu_seconds() - before
        ended = clock._cpu_of(child.pid)
        child.communicate(b"\n")
    assert at_work >= SPENT_S - ABOUT_S
    assert ended >= SPENT_S - ABOUT_S
    assert clock.cpu_seconds() - before >= at_work - ABOUT_S
    assert child.pid not in clock._started_by("self")
    assert clock._cpu_of(child.pid) == 0.0


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="this system does not tell of children at work")
def test_processes_of_a_child_count_before_they_end_and_when_the_child_has_waited_for_them() -> None:
    work = f"import time\nwhile time.process_time() < {SPENT_S}: pass\nprint(flush=True)\ninput()"
    code = f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {work!r}])\nprint(flush=True)\ninput()"
    before = clock.cpu_seconds()
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        for _ in ("its process is at work", "that has ended"):
            child.stdout.readline()
            assert clock.cpu_seconds() - before >= SPENT_S - ABOUT_S
            child.stdin.write(b"\n")
            child.stdin.flush()
    assert clock.cpu_seconds() - before >= SPENT_S - ABOUT_S


def test_where_the_system_does_not_tell_children_count_when_they_have_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Path) -> None:
        raise OSError("no such folder")

    monkeypatch.setattr(clock.Path, "iterdir", refuse)
    assert clock._started_by("self") == []
    assert clock.cpu_seconds() >= time.process_time() - ABOUT_S


@pytest.mark.parametrize(
    ("in_a_minute", "now", "share"),
    [
        pytest.param(2.0, "3/99", 0.5, id="others were and are at work"),
        pytest.param(6.0, "1/99", 1.0, id="what was at work has ended"),
        pytest.param(0.0, "9/99", 1.0, id="others are at work for a moment"),
        pytest.param(2.0, "what?", 0.5, id="the system does not tell who is at work now"),
    ],
)
def test_cores_are_shared_with_who_was_and_is_at_work(
    in_a_minute: float, now: str, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clock, "available_cores", lambda: 2)
    monkeypatch.setattr(clock.os, "getloadavg", lambda: (in_a_minute, 0.0, 0.0))
    monkeypatch.setattr(clock.Path, "read_text", lambda _: f"{in_a_minute} 0.0 0.0 {now} 12345\n")
    assert clock.idle_share() == pytest.approx(share)
