"""What only Linux, or only POSIX has is not needed to render: as much of other systems as can be tried on this one."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from patience import WAIT_S

from wdpm.cluster import host_memory
from wdpm.cluster.transport.parent_watch import life_line
from wdpm.images.image import load
from wdpm.scenes.errors import SettingsError
from wdpm.serving import limit_memory

BARE = """
import os, signal, socket, sys, types
import warp  # brings what it needs itself
import wdpm.bench, numpy, subprocess, tempfile, multiprocessing, asyncio  # so does the standard library
for name in ("resource", "fcntl", "termios", "pwd", "grp"):
    sys.modules[name] = None
for name in ("fork", "forkpty", "sysconf", "sched_getaffinity", "getuid", "kill", "set_blocking"):
    delattr(os, name)
for name in ("pthread_kill", "SIGKILL", "SIGHUP"):
    delattr(signal, name)
psutil = types.ModuleType("psutil")
psutil.virtual_memory = lambda: types.SimpleNamespace(total=8 << 30)
psutil.Process = lambda: types.SimpleNamespace(memory_info=lambda: types.SimpleNamespace(peak_wset=1 << 20))
sys.modules["psutil"] = psutil
from wdpm.cli.main import main
code = main(sys.argv[1:])
assert "wdpm.cluster.work.processes.forked_tasks" in sys.modules or "render" not in sys.argv
sys.exit(code)
"""
"""A system without fork and its like; psutil is what Windows has in their place."""

RENDER = ["render", "cornell-box", "--size", "24x24", "--photons", "2k", "--spp", "4", "-q"]


def run_bare(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", BARE, *arguments], capture_output=True, text=True, check=False)


def test_a_picture_without_fork_is_the_same(tmp_path: Path) -> None:
    from wdpm.cli import main

    bare, here = tmp_path / "bare.exr", tmp_path / "here.exr"
    done = run_bare(*RENDER, "-o", str(bare))
    assert (done.returncode, done.stderr) == (0, "")
    assert main.main([*RENDER, "-o", str(here)]) == 0
    assert load(bare).digest() == load(here).digest()


def test_the_doctor_says_what_is_not_there() -> None:
    done = run_bare("doctor")
    assert done.returncode == 0, done.stderr
    assert "memory" in done.stdout
    assert "open files" not in done.stdout


def test_memory_that_cannot_be_limited_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "resource", None)
    with pytest.raises(SettingsError, match="--memory: this system cannot limit"):
        limit_memory(1 << 40)


def test_memory_is_what_the_system_says() -> None:
    assert host_memory.machine_memory() > 1 << 28
    assert 1 << 20 < host_memory.peak_memory() < host_memory.machine_memory()


@pytest.mark.parametrize("sockets_alone", [False, True])
def test_a_life_line_can_be_watched(sockets_alone: bool) -> None:
    import select

    reading, writing = os.pipe()
    with os.fdopen(reading, "rb") as pipe:
        descriptor = life_line(pipe, sockets_alone=sockets_alone)
        assert select.select([descriptor], [], [], 0.05)[0] == []
        os.close(writing)
        assert select.select([descriptor], [], [], WAIT_S)[0] == [descriptor]
        if sockets_alone:
            os.close(descriptor)
            for thread in threading.enumerate():
                if thread.name == "life line":
                    thread.join(WAIT_S)
                    assert not thread.is_alive()
