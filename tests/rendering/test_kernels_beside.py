"""The process that compiles a scene's kernels beside its render, and after it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from patience import wait_until

from wdpm.kernels.features import Features
from wdpm.rendering import compile_beside, kernels_beside
from wdpm.rendering.compiling import Compiling
from wdpm.rendering.kernels_beside import HEAD_START_S, LEFT, KernelsBeside
from wdpm.rendering.record_file import FileLock

pytestmark = pytest.mark.processes


class Beside(KernelsBeside):
    """With a clock that is set, and the notes that it gave."""

    def __init__(self, when: Compiling = Compiling.BESIDE) -> None:
        super().__init__(when, lambda: self.now)
        self.now = 1000.0
        self.told: list[str] = []

    def want(self) -> None:
        self.compile([Features()], self.told.append)

    def want_and_begin(self) -> None:
        """As a render does that goes on for long."""
        self.want()
        self.now += HEAD_START_S
        self.before_pass()


def modules_in(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.name.startswith("wp_")]


def half_made(folder: Path) -> list[str]:
    return [name for name in modules_in(folder) if re.search(r"_p\d+_t\d+$", name)]


def has_module(folder: Path) -> bool:
    return len(modules_in(folder)) > len(half_made(folder))


def end_what_is_left() -> None:
    for process in kernels_beside._left:
        process.kill()
        process.wait()
    kernels_beside._left.clear()


@pytest.fixture(autouse=True)
def nothing_left() -> Iterator[None]:
    """Neither by renders of tests before, nor by these."""
    end_what_is_left()
    yield
    end_what_is_left()


def test_it_compiles_until_it_is_stopped_and_leaves_nothing_half_made(empty_cache: Path) -> None:
    beside = Beside()
    beside.want_and_begin()
    wait_until(lambda: has_module(empty_cache), "a module")
    beside.stop()
    beside.stop()
    assert modules_in(empty_cache)
    assert not half_made(empty_cache)
    assert all(any((empty_cache / name).glob("*.o")) for name in modules_in(empty_cache))
    assert beside.told == []


def test_a_render_that_is_soon_over_has_no_compiler_beside_it(empty_cache: Path) -> None:
    beside = Beside()
    beside.want()
    beside.now += HEAD_START_S - 1.0
    beside.before_pass()
    assert beside.running is False
    beside.stop()
    assert modules_in(empty_cache) == []


def test_after_the_render_it_goes_on_alone(empty_cache: Path) -> None:
    beside = Beside()
    beside.want()
    beside.leave()
    assert beside.running is False
    assert beside.told == [LEFT]
    wait_until(lambda: has_module(empty_cache), "a module")
    (process,) = kernels_beside._left
    assert process.exit_code is None
    beside.leave()
    assert len(kernels_beside._left) == 1


@pytest.mark.usefixtures("empty_cache")
def test_one_that_was_begun_beside_a_render_goes_on_after_it() -> None:
    beside = Beside()
    beside.want_and_begin()
    assert beside.running
    beside.leave()
    (process,) = kernels_beside._left
    assert process.exit_code is None


@pytest.mark.usefixtures("empty_cache")
def test_it_ends_when_its_starter_says_nothing_and_goes() -> None:
    beside = Beside()
    beside.want_and_begin()
    process = beside._process
    assert process is not None
    process.let_go()
    process.wait()
    assert process.exit_code == 0
    beside.stop()


def test_one_compiles_at_a_time_and_others_are_tried_again(empty_cache: Path) -> None:
    lock = FileLock(empty_cache / compile_beside.LOCK)
    beside = Beside()
    beside.want_and_begin()
    process = beside._process
    assert process is not None
    process.wait()
    assert process.exit_code == compile_beside.BUSY
    lock.release()
    beside.before_pass()
    assert beside._process is not process
    assert beside.running
    beside.stop()


def test_what_takes_too_long_ends_and_takes_away_what_is_half_made(
    empty_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = empty_cache / f"wp_module_p{os.getpid()}_t1"
    mine.mkdir()
    codes: list[int] = []
    monkeypatch.setattr(os, "_exit", codes.append)
    compile_beside._end()
    assert codes == [1]
    assert not mine.exists()


@pytest.mark.parametrize("when", [Compiling.FIRST, Compiling.NO])
def test_there_is_none_unless_it_is_wanted(empty_cache: Path, when: Compiling) -> None:
    beside = Beside(when)
    beside.want_and_begin()
    assert beside.running is False
    beside.leave()
    assert modules_in(empty_cache) == []
    assert beside.told == []


def test_there_is_none_where_nothing_is_missing() -> None:
    beside = Beside()
    beside.compile([], beside.told.append)
    beside.now += HEAD_START_S
    beside.before_pass()
    beside.leave()
    assert beside.running is False
    assert beside.told == []
