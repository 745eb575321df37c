"""`wdpm doctor`: what it finds here, and that it finds what is wrong."""

from __future__ import annotations

import importlib
import json
import os
import re
import shutil
import socket
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
import warp as wp

from wdpm.cli import main
from wdpm.cluster.transport.probe import is_free, loopback_trouble
from wdpm.doctor import kernels, machine, preparation, software
from wdpm.doctor.examine import examine, lines_of
from wdpm.doctor.facts import Fact, State
from wdpm.doctor.software import Requirement, requirements_of

GB = 1 << 30

pytestmark = pytest.mark.processes  # others write to the kernel cache, and have ports and memory, meanwhile


def test_nothing_is_wrong_where_tests_run(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["doctor"]) == 0
    out = capsys.readouterr().out
    for about in ("Python", "cores", "memory", "ports", "numpy", "kernel cache", "GPU"):
        assert f"  {about} " in out
    assert out.endswith("nothing is wrong\n")


def test_json_is_for_programs(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["doctor", "--json"]) == 0
    facts = {fact["about"]: fact for fact in json.loads(capsys.readouterr().out)}
    assert facts["cores"]["figures"]["usable"] >= 1
    assert facts["kernel cache"]["figures"]["modules"] >= 0
    assert {fact["state"] for fact in facts.values()} <= {"ok", "note"}


def test_preparing_compiles_what_is_missing_and_says_for_how_long_first(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def compile_all(modules: Any, told: Any) -> int:
        assert modules == ["one", "two"]
        done = told(2)
        assert "2 modules of kernels are compiled, for some " in capsys.readouterr().err
        done()
        done()
        return 2

    monkeypatch.setattr(preparation, "kernels_for_all_scenes", lambda: ["one", "two"])
    monkeypatch.setattr(preparation, "compile_for_cpu", compile_all)
    assert main.main(["doctor", "--prepare"]) == 0
    captured = capsys.readouterr()
    assert re.search(r"compile: done in [\d.]+ s\n$", captured.err)
    assert captured.out.endswith("nothing is wrong\n")


def test_a_cache_without_kernels_for_all_effects_is_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernels, "is_compiled", lambda module: "trace_photons" not in module.name)
    lacking = kernels.kernel_cache()
    assert lacking.state is State.NOTE
    assert lacking.advice is not None
    assert "wdpm doctor --prepare" in lacking.advice
    assert lacking.figures["missing"] >= 1
    monkeypatch.setattr(kernels, "is_compiled", lambda _: True)
    assert kernels.kernel_cache().state is State.FINE


def test_what_is_wrong_is_the_exit_code(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("wdpm.doctor.examine.examine", lambda: [Fact("x", "is broken", State.WRONG, "mend it")])
    assert main.main(["doctor"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["wrong", "x", "is", "broken"]
    assert lines[1].strip() == "-> mend it"
    assert lines[-1] == "1 of these must be put right"


def test_requirements_are_read_as_metadata_has_them() -> None:
    lines = ["numpy>=1.26", "pyzmq >= 26", "bpy<4.6,>=4.5; extra == 'blender'", 'rich; extra == "view"', "x[y]>=2"]
    assert requirements_of(lines) == [
        Requirement("numpy", "1.26", None),
        Requirement("pyzmq", "26", None),
        Requirement("bpy", "4.5", "blender"),
        Requirement("rich", None, "view"),
        Requirement("x", "2", None),
    ]


def test_packages_that_are_old_or_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    there = {"wdpm": "0.1.0", "numpy": "1.9.2", "pyzmq": "26.0rc1"}

    def version(package: str) -> str:
        if package not in there:
            raise metadata.PackageNotFoundError(package)
        return there[package]

    wanted = ["numpy>=1.26", "pyzmq>=26", "rich>=13", "aiohttp>=3; extra == 'view'", "pytest; extra == 'test'"]
    monkeypatch.setattr(metadata, "version", version)
    monkeypatch.setattr(metadata, "requires", lambda _: wanted)
    facts = {fact.about: fact for fact in software.packages()}
    assert facts["numpy"].found == "1.9.2, older than 1.26"
    assert facts["numpy"].advice == "pip install --upgrade 'numpy>=1.26'"
    assert facts["pyzmq"].state is State.FINE
    assert facts["rich"].state is State.WRONG
    assert facts["extra view"].state is State.NOTE
    assert facts["extra view"].advice == "pip install 'wdpm[view]', if you want it"
    assert "extra test" not in facts
    there.clear()
    assert [fact.state for fact in software.packages()] == [State.NOTE]


def test_requirements_that_are_not_for_this_system_are_not_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metadata, "requires", lambda _: ["nothing-there>=1; sys_platform == 'no such system'"])
    assert [fact.about for fact in software.packages()] == ["wdpm"]


def test_a_container_that_allows_less_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "available_cores", lambda: 8)
    assert machine.cores(tmp_path).state is State.FINE
    (tmp_path / "cpu.max").write_text("250000 100000\n")
    fact = machine.cores(tmp_path)
    assert (fact.state, fact.advice) == (State.NOTE, "give --threads 2")
    (tmp_path / "cpu.max").write_text("max 100000\n")
    assert machine.cores(tmp_path).state is State.FINE


def test_little_memory_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "machine_memory", lambda: 64 * GB)
    meminfo = tmp_path / "meminfo"
    meminfo.write_text(f"MemTotal: {64 * GB // 1024} kB\nMemAvailable: {8 * GB // 1024} kB\n")
    fact = machine.memory(tmp_path, meminfo)
    assert (fact.state, fact.found) == (State.FINE, "64.0 GB, 8.0 GB of it free")
    (tmp_path / "memory.max").write_text(str(4 * GB))
    (tmp_path / "memory.current").write_text(str(3 * GB))
    fact = machine.memory(tmp_path, meminfo)
    assert (fact.state, fact.figures) == (State.NOTE, {"bytes": 4 * GB, "free": GB})
    assert machine.memory(tmp_path / "none", tmp_path / "none").found == "64.0 GB"


def test_ports_that_cannot_be_used(monkeypatch: pytest.MonkeyPatch) -> None:
    assert loopback_trouble() is None
    with socket.create_server(("127.0.0.1", 0)) as listener:
        assert not is_free(listener.getsockname()[1])
        monkeypatch.setattr(machine, "MASTER_PORT", listener.getsockname()[1])
        assert machine.network().state is State.NOTE

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(socket, "create_server", refuse)
    fact = machine.network()
    assert (fact.state, fact.found) == (State.WRONG, "127.0.0.1 cannot be used: operation not permitted")


def test_a_cache_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kernels.quiet_warp()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path / "none"))
    fact = kernels.kernel_cache()
    assert fact.state is State.WRONG
    assert "WARP_CACHE_PATH" in (fact.advice or "")
    (tmp_path / "module").mkdir()
    (tmp_path / "module" / "m.o").write_bytes(b"x" * 2048)
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    fact = kernels.kernel_cache()
    assert fact.figures is not None
    assert (fact.figures["modules"], fact.figures["bytes"]) == (1, 2048)


def test_a_cache_that_others_write_meanwhile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders and files that go between one look and the next: one line, and no traceback."""
    for name in ("kept", "renamed"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "m.o").write_bytes(b"x" * 2048)
    (tmp_path / "kept" / "gone.o").symlink_to(tmp_path / "renamed" / "m.o")
    look = os.scandir

    def scandir(path: Any) -> Any:
        if str(path) == str(tmp_path / "renamed"):
            shutil.rmtree(path)
        return look(path)

    monkeypatch.setattr(os, "scandir", scandir)
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    fact = kernels.kernel_cache()
    assert fact.figures is not None
    assert (fact.figures["modules"], fact.figures["bytes"]) == (2, 2048)


def test_no_room_for_temporary_files(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tempfile.TemporaryFile", fail)
    assert machine.temporary_files().state is State.WRONG


def test_few_open_files_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    resource = importlib.import_module("resource")
    monkeypatch.setattr(resource, "getrlimit", lambda _: (64, 1024))
    fact = machine.open_files()
    assert fact is not None
    assert (fact.state, fact.advice) == (State.NOTE, "ulimit -n 1024")
    monkeypatch.setitem(sys.modules, "resource", None)
    assert machine.open_files() is None


def test_lines_are_lines() -> None:
    assert all("\n" not in line for line in lines_of(examine()))
