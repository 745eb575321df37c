"""A slave's process computes in long slices, and is nobody else's business otherwise."""

from __future__ import annotations

import ctypes
import errno
import os
import subprocess
import sys

import pytest

from wdpm.cluster.slave import time_slices
from wdpm.cluster.slave.time_slices import ask_for_long_slices

pytestmark = pytest.mark.processes

LINUX = sys.platform == "linux" and time_slices.platform.machine() in time_slices._SCHED_SETATTR


REFUSED = "ctypes.CDLL = lambda _: types.SimpleNamespace(syscall=lambda *_: -1)"
"""What a container does whose filter of system calls does not know this one."""


def nobody_may_ask() -> bool:
    """Whether a filter of system calls refuses this one, whatever it asks: Linux calls it invalid."""
    library = ctypes.CDLL(None, use_errno=True)
    call = time_slices._SCHED_SETATTR[time_slices.platform.machine()]
    library.syscall(ctypes.c_long(call), ctypes.c_int(0), None, ctypes.c_uint(0))
    return ctypes.get_errno() != errno.EINVAL


def printed_after(preparation: str) -> list[str]:
    """Whether a new process is given long slices, how it is scheduled then, a thread of it, and how nice it is."""
    code = f"""
import ctypes, os, threading, types
from wdpm.cluster.slave.time_slices import ask_for_long_slices
os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # tests before this one may have been a slave
{preparation}
print(ask_for_long_slices(), os.sched_getscheduler(0))
thread = threading.Thread(target=lambda: print(os.sched_getscheduler(0)))
thread.start()
thread.join()
print(os.getpriority(os.PRIO_PROCESS, 0))
"""
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return done.stdout.split()


@pytest.mark.skipif(not LINUX, reason="only Linux is asked, and on machines whose system calls are known")
def test_a_slave_computes_in_long_slices_and_is_as_nice_as_before() -> None:
    if nobody_may_ask():
        pytest.skip("a container's filter of system calls refuses this one")
    batch = str(os.SCHED_BATCH)
    nicer = min(19, os.getpriority(os.PRIO_PROCESS, 0) + 3)  # 19: no process is nicer
    assert printed_after("os.nice(3)") == ["True", batch, batch, str(nicer)]


@pytest.mark.skipif(not LINUX, reason="only Linux is asked, and on machines whose system calls are known")
def test_where_a_container_forbids_to_ask_a_slave_goes_on_as_it_is() -> None:
    other = str(os.SCHED_OTHER)
    assert printed_after(REFUSED) == ["False", other, other, str(os.getpriority(os.PRIO_PROCESS, 0))]


@pytest.mark.skipif(not LINUX, reason="only Linux is asked, and on machines whose system calls are known")
def test_what_somebody_has_chosen_is_left() -> None:
    idle = str(os.SCHED_IDLE)
    assert printed_after("os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))")[:3] == ["False", idle, idle]


def test_elsewhere_nothing_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time_slices.sys, "platform", "darwin")
    assert not ask_for_long_slices()
    monkeypatch.undo()
    monkeypatch.setattr(time_slices.platform, "machine", lambda: "vax")
    assert not ask_for_long_slices()
