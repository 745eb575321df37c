"""Devices to compute on, as --device names them: whether this machine has the one that is asked for."""

from __future__ import annotations

import os

from wdpm.scenes.errors import SettingsError


def check_device(name: str) -> None:
    """Raise SettingsError unless Warp can compute on a device here.

    Warp is not imported for "cpu", which is everywhere: it takes half a second.

    Args:
        name: "cpu", "cuda" or "cuda:0".
    """
    if name == "cpu":
        return
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
