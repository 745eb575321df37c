"""Machines that let a command write nowhere but where its image goes: a read-only disk, or a full one."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import warp as wp

from wdpm import serving
from wdpm.cli import compare
from wdpm.cli.main import main
from wdpm.kernels import compile as module
from wdpm.kernels.camera import filter_weights
from wdpm.scenes.errors import MachineError, SettingsError

RENDER = ["render", "cornell-box", "--size", "8x8", "--spp", "1", "--integrator", "path", "--threads", "1", "-q"]


def refusing(number: int, path: Path | None = None) -> Any:
    """What the system does."""

    def refuse(*_: Any, **__: Any) -> None:
        raise OSError(number, os.strerror(number), *([] if path is None else [str(path)]))

    return refuse


@pytest.mark.parametrize(
    ("owner", "name", "number", "words"),
    [
        (
            tempfile,
            "TemporaryFile",
            errno.ENOENT,
            "no temporary file can be written (No such file or directory); set TMPDIR",
        ),
        (wp, "init", errno.EROFS, "compiled kernels cannot be kept in .: Read-only file system; set WARP_CACHE_PATH"),
    ],
    ids=["temporary files", "kernel cache"],
)
def test_nowhere_to_write_is_one_line(
    owner: Any,
    name: str,
    number: int,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(owner, name, refusing(number, Path() if name == "init" else None))
        assert main([*RENDER, "-o", str(tmp_path / "a.exr")]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert words in line


def test_libraries_that_cannot_be_loaded_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As where `ulimit -v` leaves too few addresses for them."""

    def init() -> None:
        raise RuntimeError("Failed to load the shared library") from OSError("warp.so: failed to map segment")

    with monkeypatch.context() as patched:
        patched.setattr(wp, "init", init)
        assert main([*RENDER, "-o", str(tmp_path / "a.exr")]) == 2
    assert capsys.readouterr().err == "wdpm: error: Warp cannot be loaded: warp.so: failed to map segment\n"


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        MemoryError("Unable to allocate 8 EiB"),
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        RuntimeError("Failed to allocate 5 bytes on device 'cpu'"),
        RuntimeError("can't start new thread"),
    ],
    ids=lambda error: str(error) or "unsaid",
)
def test_no_memory_is_one_line(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(_: object) -> int:
        raise error

    monkeypatch.setattr(compare, "run", run)
    assert main(["compare", "a", "b"]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith("wdpm: error: not enough memory: ")
    monkeypatch.setattr(compare, "run", refusing(errno.EIO))
    with pytest.raises(OSError, match="Input/output error"):
        main(["compare", "a", "b"])


def test_a_cache_that_takes_no_kernel_is_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(module, "is_compiled", lambda _: False)
    monkeypatch.setattr(wp, "force_load", refusing(errno.ENOSPC, tmp_path))
    with pytest.raises(SettingsError, match=r"cannot be kept in .*: No space left on device; set WARP_CACHE_PATH"):
        module.compile_for_cpu([wp.get_module(filter_weights.__name__)])


@pytest.mark.parametrize(("total", "compiles"), [(1 << 40, False), (0, True)], ids=["full", "unknown"])
def test_nothing_is_compiled_where_the_disk_is_full(
    total: int, compiles: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """LLVM would end the process, with a line of its own; some file systems do not know what is free."""
    compiled: list[object] = []
    monkeypatch.setattr(module, "is_compiled", lambda _: False)
    monkeypatch.setattr(wp, "force_load", lambda _, modules: compiled.extend(modules))
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(total=total, free=0))
    expected = pytest.raises(SettingsError, match=r"cannot be kept in .*: No space left on device; set WARP_CACHE_PATH")
    with contextlib.nullcontext() if compiles else expected:
        module.compile_for_cpu([wp.get_module(filter_weights.__name__)])
    assert bool(compiled) == compiles


@pytest.mark.parametrize(
    "error",
    [RuntimeError("Failed to load the shared library"), SettingsError("no temporary file can be written")],
    ids=["libraries", "temporary files"],
)
def test_a_slave_that_cannot_load_what_computes_is_not_fit(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    """It leaves, and others go on: a fault of what is rendered would end the render."""

    def fails() -> None:
        raise error

    monkeypatch.setattr(serving, "quiet_warp", fails)
    with pytest.raises(MachineError, match=f"it is not fit to compute: {error}"):
        serving._prepare("cpu")
