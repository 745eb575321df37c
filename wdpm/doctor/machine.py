"""Facts about the machine: processor, memory, processes, room for temporary files, this machine's own network."""

from __future__ import annotations

import os
import platform
import shutil
import sys
import tempfile
from pathlib import Path

from wdpm.cluster.host_memory import machine_memory
from wdpm.cluster.transport.probe import is_free, loopback_trouble
from wdpm.cluster.work.processes.sibling import can_fork_siblings
from wdpm.devices import available_cores
from wdpm.doctor.facts import Fact, State
from wdpm.report.tables import format_bytes

OLDEST = (3, 11)
LITTLE_MEMORY = 2 << 30
LITTLE_ROOM = 1 << 30
FEW_FILES = 256
MASTER_PORT = 7117  # of the documentation's examples

CGROUP = Path("/sys/fs/cgroup")
MEMINFO = Path("/proc/meminfo")


def python() -> Fact:
    """The interpreter."""
    version = platform.python_version()
    found = f"{platform.python_implementation()} {version}, {sys.maxsize.bit_length() + 1} bits, {sys.executable}"
    if sys.version_info < OLDEST:
        return Fact("Python", found, State.WRONG, "install Python 3.11 or newer")
    if sys.maxsize < 1 << 32:
        return Fact("Python", found, State.WRONG, "install a Python of 64 bits: Warp has no other")
    return Fact("Python", found)


def system() -> Fact:
    """The operating system."""
    found = f"{platform.system()} {platform.release()} on {platform.machine()}"
    if sys.platform == "linux":
        return Fact("system", found)
    return Fact("system", found, State.NOTE, "what other systems than Linux lack: docs/install.md")


def cores(cgroup: Path = CGROUP) -> Fact:
    """Cores that may be used, and whether a container allows less time than they have."""
    usable, there = available_cores(), os.cpu_count() or 1
    found = f"{usable} of {there} usable" if usable < there else f"{there}"
    figures = {"usable": usable, "there": there}
    quota = _cpu_quota(cgroup)
    if quota is not None and quota < usable:
        least = max(1, int(quota))
        return Fact(
            "cores", f"{found}, but time of {quota:.1f} allowed", State.NOTE, f"give --threads {least}", figures
        )
    return Fact("cores", found, figures=figures)


def memory(cgroup: Path = CGROUP, meminfo: Path = MEMINFO) -> Fact:
    """Main memory, and how much of it is free."""
    total = machine_memory()
    limit = _number(cgroup / "memory.max")
    free = _available(meminfo)
    if limit is not None and limit < total:
        used = _number(cgroup / "memory.current") or 0
        total, free = limit, min(free if free is not None else limit, limit - used)
    if total is None:
        return Fact("memory", "not known on this system")
    found = format_bytes(total) if free is None else f"{format_bytes(total)}, {format_bytes(free)} of it free"
    figures = {"bytes": total, "free": free}
    if (total if free is None else free) < LITTLE_MEMORY:
        advice = "close other programs, or render small scenes: kernels alone take some hundred megabytes to compile"
        return Fact("memory", found, State.NOTE, advice, figures)
    return Fact("memory", found, figures=figures)


def processes() -> Fact:
    """How all cores are used."""
    if sys.platform == "linux":
        together = (
            "which fork each other" if can_fork_siblings() else "one after another, as the system has no call for more,"
        )
        return Fact("processes", f"tasks go to processes forked from one, {together} and share its memory")
    return Fact("processes", "no fork that is safe here: threads share launches; --slaves starts processes", State.NOTE)


def temporary_files() -> Fact:
    """Room for the scene of a master, which lies in a file while slaves fetch it."""
    folder = Path(tempfile.gettempdir())
    try:
        with tempfile.TemporaryFile():
            free = shutil.disk_usage(folder).free
    except OSError as error:
        return Fact("temporary files", f"{folder}: {error.strerror}", State.WRONG, "set TMPDIR to a folder to write to")
    found = f"{folder}, {format_bytes(free)} free"
    if free < LITTLE_ROOM:
        return Fact("temporary files", found, State.NOTE, "make room, or set TMPDIR: large scenes are spooled there")
    return Fact("temporary files", found, figures={"free": free})


def open_files() -> Fact | None:
    """How many files and sockets a process may have open; None where the system does not say."""
    try:
        import resource
    except ImportError:
        return None
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if 0 <= soft < FEW_FILES:
        return Fact("open files", f"{soft} a process", State.NOTE, f"ulimit -n {min(hard, 4096) if hard > 0 else 4096}")
    return Fact("open files", f"{soft:,} a process" if soft >= 0 else "no limit")


def network() -> Fact:
    """Whether processes of this machine reach each other, as slaves and their master do."""
    trouble = loopback_trouble()
    if trouble is not None:
        advice = "let programs listen at 127.0.0.1: --slaves and --view need it (a firewall, or a sandbox, forbids it)"
        return Fact("ports", trouble, State.WRONG, advice)
    if not is_free(MASTER_PORT):
        found = f"127.0.0.1 works; {MASTER_PORT} is taken"
        return Fact("ports", found, State.NOTE, "give `wdpm master --bind` another port, or end what listens there")
    return Fact("ports", f"127.0.0.1 works; {MASTER_PORT} is free")


def _cpu_quota(cgroup: Path) -> float | None:
    """Cores' worth of time that a container may use; None for all."""
    try:
        quota, period = (cgroup / "cpu.max").read_text().split()
        return None if quota == "max" else int(quota) / int(period)
    except (OSError, ValueError):
        return None


def _number(path: Path) -> int | None:
    try:
        return int(path.read_text())
    except (OSError, ValueError):
        return None


def _available(meminfo: Path) -> int | None:
    """Memory that programs could still take [bytes]; None where the system does not say."""
    try:
        lines = dict(line.split(":", 1) for line in meminfo.read_text().splitlines())
        return int(lines["MemAvailable"].split()[0]) * 1024
    except (OSError, ValueError, KeyError):
        return None
