"""How long a slave is let compute before another process has its turn, where there are more of them than cores.

What a slave has in a processor's caches, the interpreter above all, is gone when others have had the core: a turn of
sixty photons takes 0.3 ms where a process is alone, and 0.8 ms in one of eight slaves on two cores. Linux gives some
3 ms at a time, and takes the core away sooner if another wakes up.
"""

from __future__ import annotations

import ctypes
import os
import platform
import sys
from typing import Final

SLICE_S: Final = 0.05
"""What is asked for [s]. Of twenty slaves on a core each may wait two seconds for its turn: heartbeats allow it."""

_SCHED_SETATTR: Final = {"x86_64": 314, "aarch64": 274}
"""Number of the system call by that name, by machine: the C library has no function for it before glibc 2.41."""


class _Attributes(ctypes.Structure):
    """What that call takes, as its first version has it."""

    _fields_ = (
        ("size", ctypes.c_uint32),
        ("policy", ctypes.c_uint32),
        ("flags", ctypes.c_uint64),
        ("nice", ctypes.c_int32),
        ("priority", ctypes.c_uint32),
        ("runtime", ctypes.c_uint64),
        ("deadline", ctypes.c_uint64),
        ("period", ctypes.c_uint64),
    )


def ask_for_long_slices() -> bool:
    """Have the system let this thread, and threads that it starts, compute for longer at a time: Linux alone.

    Its weight among others stays what it is, and who wakes up for a moment comes first, as slices of others are short.
    Kernels before 6.12 have slices of one length: there it only takes no core away when it wakes up itself. Where
    somebody has chosen how the process is scheduled, that is left as it is.

    Returns:
        Whether the system has agreed.
    """
    call = _SCHED_SETATTR.get(platform.machine()) if sys.platform == "linux" else None
    if call is None or os.sched_getscheduler(0) != os.SCHED_OTHER:
        return False
    wanted = _Attributes(
        size=ctypes.sizeof(_Attributes),
        policy=os.SCHED_BATCH,
        nice=os.getpriority(os.PRIO_PROCESS, 0),
        runtime=round(SLICE_S * 1e9),
    )
    flags = ctypes.c_uint(0)
    return bool(ctypes.CDLL(None).syscall(ctypes.c_long(call), ctypes.c_int(0), ctypes.byref(wanted), flags) == 0)
