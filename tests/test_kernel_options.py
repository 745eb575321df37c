"""Every file with Warp code sets the options that the exactness contract asks for.

Warp applies those of the file that a kernel is in to all functions that it calls.
"""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest
import warp as wp

import wdpm

FOLDER = Path(wdpm.__path__[0]) / "kernels"
FILES = sorted(path.stem for path in FOLDER.glob("*.py") if "@wp." in path.read_text())


def test_there_are_kernel_files() -> None:
    assert {"bvh", "gather", "photon_paths", "camera_samples"} <= set(FILES)


@pytest.mark.parametrize("name", FILES)
def test_no_contraction_and_no_backward_pass(name: str) -> None:
    module = importlib.import_module(f"wdpm.kernels.{name}")
    options = wp.get_module_options(module)
    assert options["fuse_fp"] is False
    assert options["enable_backward"] is False


def test_all_files_with_kernels_are_compiled_ahead() -> None:
    from wdpm.kernels.compile import MODULES

    ahead = {module.__name__.rpartition(".")[2] for module in MODULES}
    assert {path.stem for path in FOLDER.glob("*.py") if "@wp.kernel" in path.read_text()} <= ahead
