"""Facts about what computes: Warp, its cache of compiled kernels, GPUs."""

from __future__ import annotations

import os
import shutil
import stat
from pathlib import Path

import warp as wp

from wdpm.doctor.facts import Fact, State
from wdpm.kernels.cached import is_compiled
from wdpm.kernels.compile import kernels_for_all_scenes
from wdpm.quiet import quiet_warp
from wdpm.report.tables import format_bytes

LITTLE_ROOM = 1 << 30


def kernel_cache() -> Fact:
    """Where compiled kernels are kept, how many there are, and whether there is room for more."""
    quiet_warp()
    folder = Path(wp.config.kernel_cache_dir or "")
    advice = "set WARP_CACHE_PATH to a folder that you can write to: kernels would be compiled in each process"
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        return Fact("kernel cache", f"{folder}: cannot be written to", State.WRONG, advice)
    modules = [path for path in folder.iterdir() if path.is_dir()]
    size = _size_of(folder)
    free = shutil.disk_usage(folder).free
    found = f"{folder}, {len(modules):,} modules, {format_bytes(size)}; {format_bytes(free)} free"
    figures = {"folder": str(folder), "modules": len(modules), "bytes": size, "free": free}
    if free < LITTLE_ROOM:
        return Fact("kernel cache", found, State.NOTE, "make room: a scene's kernels take some ten megabytes", figures)
    missing = sum(not is_compiled(module) for module in kernels_for_all_scenes())
    if missing:
        advice = f"wdpm doctor --prepare compiles {missing} modules, so that no render waits for a compiler"
        return Fact("kernel cache", found, State.NOTE, advice, {**figures, "missing": missing})
    return Fact("kernel cache", f"{found}; kernels for all effects are compiled", figures={**figures, "missing": 0})


def _size_of(folder: Path) -> int:
    """Bytes of all files below a folder.

    Other processes compile meanwhile: their folders are renamed, and files removed, between one look and the next.
    What has gone counts nothing (os.walk passes by a folder that it can't read).
    """
    return sum(_size_if_there(Path(place, name)) for place, _, names in os.walk(folder) for name in names)


def _size_if_there(file: Path) -> int:
    try:
        found = file.stat()
    except FileNotFoundError:
        return 0
    return found.st_size if stat.S_ISREG(found.st_mode) else 0


def gpus() -> Fact:
    """GPUs that kernels could run on."""
    quiet_warp()
    devices = wp.get_cuda_devices() if wp.is_cuda_available() else []
    if not devices:
        return Fact("GPU", "none with a CUDA driver: all is computed on the CPU", State.NOTE)
    names = ", ".join(f"{device.alias}: {device.name}, {format_bytes(device.total_memory)}" for device in devices)
    return Fact("GPU", names, advice="give --device cuda:0 to use it (docs/gpu.md)")
