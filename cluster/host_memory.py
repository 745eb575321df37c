"""Main memory: of this machine and of slaves, and what this process has used."""

from __future__ import annotations

import ctypes
import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

try:
    import resource  # now: where a process has no file left to open it cannot be loaded when all is rendered
except ModuleNotFoundError:  # POSIX alone has it
    resource = None  # type: ignore[assignment]

SHARE_OF_MEMORY = 0.5
"""Of a machine's memory that its slaves may fill with the scene, its photons and copies of them."""

PROCESS_BYTES = 600 << 20
"""What a slave is left before it holds anything: for the interpreter, Warp, compiled kernels, batches in flight, and
for compiling."""

LARGE_BLOCK = 32 << 20
"""Blocks from this size on are the system's [bytes]; glibc takes no more."""

KEPT_AT_MOST = 256 << 20
"""What a heap keeps free at its end [bytes]: well within what a slave's process is reckoned to take (plan.copies)."""

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8  # malloc.h


@dataclass(frozen=True)
class SlaveMemory:
    """What a slave says of its machine.

    Attributes:
        host: name of the machine, which several slaves may share.
        bytes: memory of the machine ...
        own: ... or what the slave may use of it, if somebody said so; 0 otherwise.
    """

    host: str
    bytes: int
    own: int = 0


def rooms_of(slaves: Sequence[SlaveMemory]) -> list[float]:
    """What each slave has room for, besides its process [bytes]; below 0 where that has none."""
    neighbours = Counter(slave.host for slave in slaves)
    return [(slave.own or SHARE_OF_MEMORY * slave.bytes / neighbours[slave.host]) - PROCESS_BYTES for slave in slaves]


def machine_memory() -> int:
    """Main memory of this machine, or what this process's container or job may use of it [bytes]."""
    return min([_installed_memory(), *_control_group_limits(Path("/proc/self/cgroup"), Path("/sys/fs/cgroup"))])


def _control_group_limits(membership: Path, mounted: Path) -> list[int]:
    """Limits of the control groups (cgroups(7)) of this process and those around them, of both versions; Linux alone.

    A container mostly sees its own group as the root of all; what it cannot read does not limit it.
    """
    limits = []
    for line in membership.read_text().splitlines() if membership.is_file() else ():
        _, controllers, path = line.split(":", 2)
        if controllers == "":
            root, name = mounted, "memory.max"
        elif "memory" in controllers.split(","):
            root, name = mounted / "memory", "memory.limit_in_bytes"
        else:
            continue
        group = root / path.lstrip("/")
        for folder in (group, *group.parents):
            limit = folder / name
            if folder.is_relative_to(root) and limit.is_file() and (text := limit.read_text().strip()).isdigit():
                limits.append(int(text))
    return limits


def _installed_memory() -> int:
    if hasattr(os, "sysconf"):
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    import psutil  # Windows, where it is a requirement

    return int(psutil.virtual_memory().total)


def peak_memory() -> int:
    """Most memory that this process has had in use [bytes]."""
    if resource is None:
        import psutil

        return int(psutil.Process().memory_info().peak_wset)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def memory_in_use() -> int:
    """Memory of this process that is in main memory now [bytes]; where no file of the system tells, most that was."""
    resident = Path("/proc/self/statm")
    return int(resident.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if resident.is_file() else peak_memory()


def return_free_memory() -> bool:
    """Have the allocator give back to the system what is free. A moment for it: a scene is gone, an image is done.

    Of what threads have used in turn, glibc keeps pages between others that are in use: a slave of many renders would
    hold some megabytes more with each (`make soak`). Elsewhere than on Linux nothing is done.

    Returns:
        Whether the allocator says that it has given something back.
    """
    if sys.platform == "linux" and (trim := getattr(ctypes.CDLL(None), "malloc_trim", None)) is not None:
        return bool(trim(0))
    return False


def keep_free_memory() -> bool:
    """Have the allocator keep what a thread has freed, for the next launch, which takes as much: glibc alone.

    By itself it gives back to the system what is free at the end of a thread's heap, and whatever is larger than some
    megabytes, so that each launch is given fresh pages, which the system fills with zeros: a tenth of the time of
    buckets. `return_free_memory` gives back all that, once a session has ended.

    Returns:
        Whether the allocator has been told.
    """
    set_option = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if set_option is None:
        return False
    # The heap of a thread of its own is made of parts, which go back to the system one by one whatever it is told.
    settings = {_M_ARENA_MAX: 1, _M_MMAP_THRESHOLD: LARGE_BLOCK, _M_TRIM_THRESHOLD: KEPT_AT_MOST}
    return all(set_option(setting, value) for setting, value in settings.items())


class PrivateMemory:
    """Memory that this process shares with no other: of a forked one, what it has written. Linux alone.

    The system counts pages one by one, milliseconds for some hundred megabytes, so it is asked for a five hundredth of
    the time at most.
    """

    def __init__(self) -> None:
        self._bytes = 0
        self._again = 0.0

    def bytes(self) -> int:
        """As much as when it was last asked for [bytes]."""
        began = time.monotonic()
        if began >= self._again:
            with open("/proc/self/smaps_rollup") as rollup:
                lines = [line.split() for line in rollup]
            self._bytes = sum(
                int(words[1]) * 1024 for words in lines if words[0] in ("Private_Clean:", "Private_Dirty:")
            )
            ended = time.monotonic()
            self._again = ended + 500.0 * (ended - began)
        return self._bytes
