"""What a machine has to compute with: devices, as --device names them, cores and memory."""

from __future__ import annotations

import math
import os
from numbers import Integral

from wdpm.cluster.host_memory import PROCESS_BYTES, machine_memory
from wdpm.scenes.errors import SettingsError


def check_device(name: str) -> None:
    """Raise SettingsError unless Warp can compute on a device here.

    Warp is not imported for "cpu", which is everywhere: it takes half a second.

    Args:
        name: "cpu", "cuda" or "cuda:0".
    """
    if name == "cpu":
        return
    if not isinstance(name, str):
        raise SettingsError(f'device is {name!r}; expected "cpu" or a CUDA device, like "cuda:0"')
    import warp as wp

    wp.init()
    try:
        wp.get_device(name)
    except (ValueError, RuntimeError):
        here = ", ".join(device.alias for device in wp.get_devices())
        why = "" if wp.is_cuda_available() else " (no GPU with a CUDA driver was found)"
        raise SettingsError(f"there is no device {name!r} on this machine{why}; it has {here}") from None


def available_cores() -> int:
    """Cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def check_count(name: str, value: object, least: int = 1) -> None:
    """Raise SettingsError unless cores or slaves are counted by a whole number of at least so many.

    Args:
        value: as somebody gave it in Python.
    """
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise SettingsError(f"{name} is {value!r}; expected a whole number")
    if value < least:
        raise SettingsError(f"{name} is {value}; expected at least {least}")


MOST_THREADS = 256
"""On a machine with fewer cores. Each may be a process of its own: a number with a digit too many would drown it."""


def check_threads(threads: int | None) -> None:
    """Raise SettingsError unless this machine can be asked to use so many cores; None stands for all there are."""
    if threads is None:
        return
    check_count("threads", threads)
    cores = os.cpu_count() or 1
    most = max(MOST_THREADS, cores)
    if threads > most:
        raise SettingsError(f"threads is {threads}; this machine has {cores} cores: give at most {most}")


def check_memory(memory: int | None, slaves: int = 1) -> None:
    """Raise SettingsError where slaves of this machine may take more memory than it has: it would swap, or kill them.

    Or where they may take so little that they would die before they could say so.

    Args:
        memory: that each may take [bytes]; None if nobody said.
    """
    if memory is None:
        return
    if not isinstance(memory, Integral):
        raise SettingsError(f"memory is {memory!r}; expected bytes, like 4 * 2**30")
    if memory <= PROCESS_BYTES:
        raise SettingsError(
            f"--memory is {memory / 2**20:.0f} MiB; a slave takes {PROCESS_BYTES / 2**20:.0f} MiB before it holds "
            "anything of the scene: give it more"
        )
    there = machine_memory()
    if memory * slaves > there:
        most = math.floor(10 * there / slaves / 2**30) / 10
        each = f" for each of {slaves} slaves" if slaves > 1 else ""
        raise SettingsError(
            f"--memory is {memory / 2**30:.1f} GiB{each}; this machine, or the container or job, has "
            f"{there / 2**30:.1f} GiB in all: give {'each ' if slaves > 1 else ''}at most {most}G"
        )
