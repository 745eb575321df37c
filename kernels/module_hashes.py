"""Hashes of Warp's modules, remembered for one state of the sources: to work them out takes longer than a small render.

Warp names what it has compiled by a hash over the syntax trees of all functions that a module calls, and works that out
in every process anew: 0.4 s of one core for the kernels of a simple scene. The hash is the same as long as the sources
are, and Warp and its options. So it is kept in a file beside what Warp has compiled, named by a digest of the sources
and of Warp's version; another state of the sources looks for another file. A file that is missing, spoilt or lacks a
module only means that Warp works the hash out as ever.

Warp has no public way to be told a hash: it is put where Warp keeps those that it has worked out. So that is done for
versions of Warp only with which tests have seen it (warp_versions.py); with others nothing is remembered.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import json
import os
import sys
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import warp as wp

from wdpm.kernels.warp_versions import is_tried

SET_BY_HASHING = ("kernel_dim", "tid_extent_limit_candidate")
"""Numbers that Warp finds in a kernel's code while it hashes that, and wants for a launch."""

FOLDER = "wdpm-hashes"
"""In Warp's cache; the names of the folders that Warp makes there begin with "wp_"."""

OF_SOURCES = "wdpm.kernels."
"""Modules of the files whose state is known are named so; modules of others' kernels are not remembered."""

PACKAGES = ("wdpm.kernels", "wdpm.scenes")
"""Whose sources tell what kernels do: their own, and what those import."""

KEPT = 8
"""States of the sources that are remembered: checkouts and installations that share a cache."""

CPU_BLOCK = 1
"""Threads of a block on the CPU: Warp hashes and compiles a module for each size of block."""

FAILS_LIKE = (AttributeError, KeyError, TypeError, ValueError)
"""What a Warp with another inside would raise, and a file with other contents."""

_lock = threading.RLock()


class _Hasher:
    """Stands for Warp's own object that has hashed a module; for what else that knows, the module is hashed after all.

    Attributes:
        kernel_hashes: of the module's kernels.
    """

    def __init__(self, module: wp.Module, digest: bytes, kernel_hashes: Mapping[wp.Kernel, bytes]) -> None:
        self._module = module
        self._digest = digest
        self.kernel_hashes = kernel_hashes

    def get_hash(self) -> bytes:
        """The hash of the module."""
        return self._digest

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        forget(self._module)
        self._module.get_module_hash(CPU_BLOCK)
        return getattr(self._module.hashers[CPU_BLOCK], name)


class Hashes:
    """What is remembered for one state of the sources.

    Args:
        file: where it is kept.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._known: dict[str, dict[str, Any]] = _read(file)
        self._new = False

    def variant(self, key: str) -> str | None:
        """The name that Warp gives the module of a kernel that a factory makes."""
        name = self._known["variants"].get(key)
        return name if isinstance(name, str) else None

    def add_variant(self, key: str, name: str) -> None:
        """Remember that."""
        self._add("variants", key, name)

    def recall(self, module: wp.Module) -> None:
        """Tell Warp the hash of a module, if it is remembered and Warp does not know it."""
        entry = self._known["modules"].get(module.name)
        if entry is not None and is_tried():
            with _lock, contextlib.suppress(*FAILS_LIKE):
                if CPU_BLOCK not in module.hashers:
                    _set_hashes(module, entry)

    def add(self, module: wp.Module) -> None:
        """Remember the hash of a module of these sources, which Warp has worked out, if Warp can be told it again."""
        of_sources = module.name.startswith(OF_SOURCES) or module.name in self._known["variants"].values()
        if not of_sources or not is_tried():
            return
        with _lock, contextlib.suppress(*FAILS_LIKE):
            if isinstance(module.hashers[CPU_BLOCK], _Hasher):
                return
            entry = _entry(module)
            if self._known["modules"].get(module.name) != entry and _takes(module, entry):
                self._add("modules", module.name, entry)

    def _add(self, what: str, key: str, value: Any) -> None:
        self._known[what][key] = value
        self._new = True

    def write(self) -> None:
        """Write what is new, with what other processes have written since; in one step, so nobody reads half of it.

        A folder that cannot be written to only means that the next process works the hashes out as well.
        """
        if not self._new:
            return
        with contextlib.suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True)
            others = _read(self._file)
            both = {what: {**others[what], **known} for what, known in self._known.items()}
            part = self._file.with_suffix(f".{os.getpid()}.part")
            try:
                part.write_text(json.dumps(both))
                part.replace(self._file)
            finally:
                part.unlink(missing_ok=True)
            _remove_oldest(self._file.parent)
        self._new = False


def _read(file: Path) -> dict[str, dict[str, Any]]:
    """What a file says; nothing where there is none, or another's."""
    try:
        known = json.loads(file.read_text())
    except (OSError, ValueError):
        known = None
    if not isinstance(known, dict):
        known = {}
    return {what: part if isinstance(part := known.get(what), dict) else {} for what in ("modules", "variants")}


def _remove_oldest(folder: Path) -> None:
    files = sorted(folder.glob("*.json"), key=_last_written, reverse=True)
    for file in files[KEPT:]:
        file.unlink(missing_ok=True)


def _last_written(file: Path) -> float:
    """When [s]; long ago for a file that another process has removed just now."""
    try:
        return file.stat().st_mtime
    except FileNotFoundError:
        return 0.0


def _entry(module: wp.Module) -> dict[str, Any]:
    """What is remembered of a module that Warp has hashed."""
    hasher = module.hashers[CPU_BLOCK]
    kernels = {
        kernel.key: {
            "hash": digest.hex(),
            "grid_stride": kernel.grid_stride,
            "adj": {name: getattr(kernel.adj, name) for name in SET_BY_HASHING},
        }
        for kernel, digest in hasher.kernel_hashes.items()
    }
    if len(kernels) != len(hasher.kernel_hashes) or module.has_unresolved_static_expressions:
        raise ValueError(f"{module.name} has kernels of the same name, or such as are complete when it is compiled")
    options = _digest_of(_options_of(module))
    return {"hash": hasher.get_hash().hex(), "options": options, "kernels": kernels}


def _options_of(module: wp.Module) -> Any:
    return module.resolve_options(wp.config, block_dim=CPU_BLOCK)


def _digest_of(options: Mapping[str, Any]) -> str:
    return hashlib.sha256(repr(sorted(options.items())).encode()).hexdigest()


def _set_hashes(module: wp.Module, entry: Mapping[str, Any]) -> None:
    """Put an entry where Warp looks for what it has worked out; do nothing if it is of another module of that name."""
    options = _options_of(module)
    kernels = {kernel.key: kernel for kernel in module._get_live_kernels()}
    stored = entry["kernels"]
    known = {kernel: bytes.fromhex(stored[key]["hash"]) for key, kernel in kernels.items()}
    if stored.keys() != kernels.keys() or entry["options"] != _digest_of(options):
        return
    for key, kernel in kernels.items():
        kernel.hash, kernel.grid_stride = known[kernel], stored[key]["grid_stride"]
        for name in SET_BY_HASHING:
            setattr(kernel.adj, name, stored[key]["adj"][name])
    module.hashers[CPU_BLOCK] = _Hasher(module, bytes.fromhex(entry["hash"]), known)
    module.resolved_options[CPU_BLOCK] = options


def _takes(module: wp.Module, entry: Mapping[str, Any]) -> bool:
    """Whether Warp, told what it has worked out, names the module and its kernels as before."""
    name = module.get_module_identifier(CPU_BLOCK)
    symbols = [kernel.get_mangled_name() for kernel in module._get_live_kernels()]
    worked_out = module.hashers[CPU_BLOCK]
    try:
        _set_hashes(module, entry)
        is_set = isinstance(module.hashers.get(CPU_BLOCK), _Hasher)
        alike = module.get_module_identifier(CPU_BLOCK) == name
        return is_set and alike and [kernel.get_mangled_name() for kernel in module._get_live_kernels()] == symbols
    finally:
        module.hashers[CPU_BLOCK] = worked_out


def forget(module: wp.Module) -> bool:
    """Have Warp work a module's hash out, if it was told it; whether it was."""
    with _lock:
        was_set = isinstance(module.hashers.get(CPU_BLOCK), _Hasher)
        if was_set:
            del module.hashers[CPU_BLOCK]
        return was_set


def hashes() -> Hashes:
    """What is remembered in Warp's cache of these sources."""
    wp.init()
    return _hashes_in(str(wp.config.kernel_cache_dir))


@functools.cache
def _hashes_in(folder: str) -> Hashes:
    return Hashes(Path(folder) / FOLDER / f"{state_of_sources()[:32]}.json")


@functools.cache
def state_of_sources() -> str:
    """Names all that hashes of kernels depend on: sources of kernels and of what these import, Warp, and Python."""
    sha = hashlib.sha256(f"{wp.__version__} {sys.version}".encode())
    for path in (path for package in PACKAGES for path in _sources(package)):
        with open(path, "rb") as file:
            source = file.read()
        sha.update(f"{os.path.basename(path)} {len(source)} ".encode() + source)
    return sha.hexdigest()


def _sources(package: str) -> Iterator[str]:
    spec = importlib.util.find_spec(package)
    for folder in (spec.submodule_search_locations or ()) if spec is not None else ():
        for place, folders, files in os.walk(folder):
            folders.sort()
            yield from (os.path.join(place, name) for name in sorted(files) if name.endswith(".py"))
