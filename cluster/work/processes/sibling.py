"""Forking a process that becomes a child of one's own parent: Linux alone, by the call clone3(2), or clone(2).

The C library has no function for that, so the system is called directly, and what `os.fork` and the C library's fork
do besides is done here: Python's own part by the functions that it offers for it; of the C library's, the number of
the thread, which it keeps. Its locks need nothing, as the caller has one thread, and that is here.
"""

from __future__ import annotations

import ctypes
import errno
import functools
import os
import platform
import sys
from typing import Any

_CLONE3 = 435
"""Number of the system call, the same on all machines."""

_CLONE = {"x86_64": 56, "aarch64": 220}
"""Number of the older one, by machine. Docker, as it comes, allows this one alone, whose arguments it can look at."""

_CLONE_PARENT = 0x00008000  # linux/sched.h
_CLONE_PARENT_SETTID = 0x00100000
_CLONE_CHILD_CLEARTID = 0x00200000
_CLONE_CHILD_SETTID = 0x01000000
_PR_GET_TID_ADDRESS = 40  # linux/prctl.h


class _CloneArguments(ctypes.Structure):
    """What clone3 takes, as its first version has it. No signal is named: a sibling has the caller's."""

    _fields_ = tuple(
        (name, ctypes.c_uint64)
        for name in ("flags", "pidfd", "child_tid", "parent_tid", "exit_signal", "stack", "stack_size", "tls")
    )


@functools.cache
def can_fork_siblings() -> bool:
    """Whether the system has what `fork_sibling` needs. It may fail even so, if its arguments are refused."""
    if sys.platform != "linux" or not _tid_address():
        return False
    return _allows_clone3() or platform.machine() in _CLONE


@functools.cache
def _allows_clone3() -> bool:
    """Some containers forbid it, and some kernels are without it."""
    nothing = _system_call(_CLONE3, ctypes.c_void_p(), ctypes.c_size_t(0))  # too little to do anything with
    return nothing < 0 and ctypes.get_errno() == errno.EINVAL


def fork_sibling(number_at: int) -> int:
    """Fork this process; the other one has the same parent, which alone can wait for it.

    For a process of one thread that has been forked from its parent and done nothing since that leaves locks behind.

    Args:
        number_at: address of 4 bytes for the process's number, which is there before the process runs. Where others
            share that memory, they see it.

    Returns:
        0 in the new process, its number in this one.

    Raises:
        OSError: there is no such process.
    """
    call = _arguments(number_at)
    ctypes.pythonapi.PyOS_BeforeFork()
    number = _system_call(*call)
    if number == 0:
        ctypes.pythonapi.PyOS_AfterFork_Child()
        return 0
    fault = ctypes.get_errno()
    ctypes.pythonapi.PyOS_AfterFork_Parent()
    if number < 0:
        raise OSError(fault, os.strerror(fault))
    return number


def _arguments(number_at: int) -> tuple[Any, ...]:
    """The system call that forks, and its arguments."""
    flags = _CLONE_PARENT | _CLONE_PARENT_SETTID | _CLONE_CHILD_SETTID | _CLONE_CHILD_CLEARTID
    address = _tid_address()
    if _allows_clone3():
        arguments = _CloneArguments(flags=flags, child_tid=address, parent_tid=number_at)
        return _CLONE3, ctypes.pointer(arguments), ctypes.c_size_t(ctypes.sizeof(arguments))
    thread, nothing = ctypes.c_void_p(address), ctypes.c_void_p()
    last = (nothing, thread) if platform.machine() == "aarch64" else (thread, nothing)
    return _CLONE[platform.machine()], ctypes.c_ulong(flags), nothing, ctypes.c_void_p(number_at), *last


def _system_call(number: int, *arguments: Any) -> int:
    """Call the system without letting go of the interpreter's lock, which the forked process would not get again."""
    call = ctypes.PyDLL(None, use_errno=True).syscall
    call.restype = ctypes.c_long
    return int(call(ctypes.c_long(number), *arguments))


def _tid_address() -> int:
    """Where the C library keeps the number of this thread; 0 if the system does not say."""
    address = ctypes.c_void_p(0)
    failed = ctypes.CDLL(None).prctl(_PR_GET_TID_ADDRESS, ctypes.byref(address), 0, 0, 0)
    return 0 if failed else address.value or 0
