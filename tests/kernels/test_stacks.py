"""Stacks that a system bounds: raised where that may be, one line where not. Without that, renders crash."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

resource = pytest.importorskip("resource")

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(sys.platform != "linux", reason="other systems have other least stacks"),
]

RENDER = """
import resource, sys
resource.setrlimit(resource.RLIMIT_STACK, ({soft} << 10, {hard}))
import os
os.execv(sys.executable, [sys.executable, "-m", "wdpm", *sys.argv[1:]])
"""


def render(soft: int, hard: str, output: Path, *more: str) -> subprocess.CompletedProcess[str]:
    """A render in a process whose stacks are bounded [KiB]."""
    words = ["render", "cornell-box", "--size", "16x16", "--spp", "2", "--photons", "2000", "-q", "-o", str(output)]
    code = RENDER.format(soft=soft, hard=hard)
    return subprocess.run([sys.executable, "-c", code, *words, *more], capture_output=True, text=True, check=False)


def test_a_stack_that_cannot_be_raised_is_one_line(tmp_path: Path) -> None:
    done = render(256, "256 << 10", tmp_path / "box.exr")
    assert done.returncode == 2, done.stderr
    assert done.stderr == (
        "wdpm: error: the stacks of this process may have 256 KiB, and kernels need 1024: raise that limit "
        "(ulimit -s 8192)\n"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("more", [(), ("--slaves", "2")], ids=["one process", "slaves"])
def test_a_soft_limit_is_raised(more: tuple[str, ...], tmp_path: Path) -> None:
    done = render(256, "resource.getrlimit(resource.RLIMIT_STACK)[1]", tmp_path / "box.exr", *more)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "box.exr").exists()
