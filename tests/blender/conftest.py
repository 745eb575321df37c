"""What runs inside Blender runs in processes of its own: its module cannot be left in good order."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]


@pytest.fixture(scope="session")
def in_blender() -> Callable[..., str]:
    """Runs a program of this folder with Blender's module; returns what it printed. Skips where there is no Blender."""
    if importlib.util.find_spec("bpy") is None:
        pytest.skip("bpy is not installed: make test-blender")

    def run(program: str, *arguments: object, **environment: str) -> str:
        command = [sys.executable, str(HERE / program), *map(str, arguments)]
        # Blender holds a process that fails on its way out, so time is short and the output is kept.
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=1500,
            check=False,
            env={**os.environ, **environment, "PYTHONPATH": str(ROOT)},
        )
        assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
        return done.stdout

    return run
