"""Which modules of kernels are compiled already: in this process, or in Warp's cache on disk."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import warp as wp

from wdpm.kernels.module_hashes import CPU_BLOCK, forget, hashes
from wdpm.scenes.errors import MachineError


def is_compiled(module: wp.Module) -> bool:
    """Whether launches of a module's kernels on the CPU need no compiler."""
    if is_loaded(module):
        return True
    known = hashes()
    known.recall(module)
    there = _is_in_cache(module)
    if not there and forget(module):  # removed since: nobody may build on what is only remembered
        there = _is_in_cache(module)
    if there:
        known.add(module)
    return there


def seems_compiled(module: wp.Module) -> bool:
    """The same, by a hash that is only remembered: for who can do without the module if that is wrong.

    To work out that a module is not there takes a quarter of a second of one with many effects, in every process until
    somebody has had the time to compile it.
    """
    if is_loaded(module):
        return True
    known = hashes()
    known.recall(module)
    there = _is_in_cache(module)
    known.add(module)
    if not there:
        forget(module)
    return there


def _is_in_cache(module: wp.Module) -> bool:
    name = module.get_module_identifier(CPU_BLOCK)
    try:
        files = os.listdir(cache_folder() / name)
    except FileNotFoundError:
        return False
    return f"{name}.meta" in files and any(file.endswith(".o") for file in files)


def is_loaded(module: wp.Module) -> bool:
    """Whether this process has loaded a module for the CPU."""
    return any(context is None for context, _ in module.execs)


def cache_folder() -> Path:
    """Where Warp keeps what it has compiled; a folder of its version."""
    wp.init()
    return Path(wp.config.kernel_cache_dir)


def load_from_cache(modules: Sequence[wp.Module]) -> None:
    """Load modules that are compiled. Of those that are in the cache but not whole nothing is left in it.

    A machine that lost its power, or a disk that failed, leaves files there that are empty or cut off: without this, no
    render would work until somebody removes them.
    """
    if not modules or _loads(modules):
        return
    for module in modules:
        if not _loads([module]):
            with suppress(FileNotFoundError):  # another process has found it broken, too
                shutil.rmtree(cache_folder() / module.get_module_identifier(CPU_BLOCK))


def _loads(modules: Sequence[wp.Module]) -> bool:
    try:
        wp.force_load("cpu", list(modules), max_workers=os.cpu_count())
    except OSError:
        raise
    except Exception:  # Warp's own for an object file, JSON's for what is said of it
        return False
    return True


@contextmanager
def cache_errors_in_words() -> Iterator[None]:
    """Have a cache that takes no kernels (it is read-only, or full) be an error in one line that says what helps.

    Raises:
        MachineError: in place of OSError.
    """
    try:
        yield
    except OSError as error:
        where = error.filename or "Warp's cache folder"
        raise MachineError(
            f"compiled kernels cannot be kept in {where}: {error.strerror or error}; set WARP_CACHE_PATH to a folder "
            "that you can write to"
        ) from None


ROOM = 16 << 20
"""Bytes that must be free before a module is compiled: LLVM ends the process where a disk is full. The largest module
takes three million, and several are compiled at a time."""


def check_room() -> None:
    """Raise OSError where the cache's disk has no room for what is compiled next."""
    folder = cache_folder()
    with suppress(FileNotFoundError):
        disk = shutil.disk_usage(folder)
        if disk.total and disk.free < ROOM:  # some file systems do not know
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder))


def use_cache_folder(folder: Path) -> None:
    """Have Warp keep what it compiles there from now on."""
    wp.config.kernel_cache_dir = str(folder)


def cached_modules() -> set[str]:
    """Names of the folders of the modules that are in the cache. Other processes may add theirs at any time."""
    return set(os.listdir(cache_folder())) if cache_folder().is_dir() else set()


def remove_half_made(process: int) -> None:
    """Remove what a process that was killed while it compiled has left in the cache.

    Warp compiles in a folder that is named by process and thread, and renames it when all is done.

    Args:
        process: its number; it has ended.
    """
    for folder in cache_folder().glob(f"wp_*_p{process}_t*"):
        shutil.rmtree(folder, ignore_errors=True)
