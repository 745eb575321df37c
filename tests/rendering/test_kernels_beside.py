"""The process that compiles a scene's kernels beside its render."""

from __future__ import annotations

from pathlib import Path

import pytest
from patience import wait_until

from wdpm.kernels.features import Features
from wdpm.rendering.compiling import Compiling
from wdpm.rendering.kernels_beside import KernelsBeside

pytestmark = pytest.mark.processes


def modules_in(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.name.startswith("wp_")]


def test_it_compiles_until_it_is_stopped_and_leaves_nothing_half_made(empty_cache: Path) -> None:
    beside = KernelsBeside(Compiling.BESIDE)
    beside.compile([Features()])
    wait_until(lambda: any("_p" not in name for name in modules_in(empty_cache)), "a module")
    beside.stop()
    beside.stop()
    made = modules_in(empty_cache)
    assert made
    assert not [name for name in made if "_t" in name.rpartition("_p")[2]]
    assert all(any((empty_cache / name).glob("*.o")) for name in made)


@pytest.mark.parametrize("when", [Compiling.FIRST, Compiling.NO])
def test_there_is_none_unless_it_is_wanted(empty_cache: Path, when: Compiling) -> None:
    beside = KernelsBeside(when)
    beside.compile([Features()])
    assert beside.running is False
    beside.stop()
    assert modules_in(empty_cache) == []


def test_there_is_none_where_nothing_is_missing() -> None:
    beside = KernelsBeside(Compiling.BESIDE)
    beside.compile([])
    assert beside.running is False
