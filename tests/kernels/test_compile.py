"""Kernels are compiled before they are needed: which are, side by side, into Warp's cache."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
import warp as wp

from wdpm.kernels import stand_ins
from wdpm.kernels.cached import is_compiled, remove_half_made
from wdpm.kernels.compile import COMMON, _load, compile_for_cpu, kernels_for_all_scenes
from wdpm.kernels.features import ALL, Features
from wdpm.kernels.variants import CAN_DO_WITHOUT, make_variants


def small_module(addend: int) -> wp.Module:
    """A module with a kernel of its own."""

    @wp.kernel(module="unique", enable_backward=False)
    def add(values: wp.array[wp.int32]) -> None:
        values[wp.tid()] += wp.static(addend)

    return add.module


@pytest.mark.parametrize("threads", [1, 3])
def test_missing_modules_are_compiled_into_the_cache(empty_cache: Path, threads: int) -> None:
    modules = [small_module(1000 * threads + number) for number in range(3)]
    told: list[int] = []
    done: list[str] = []

    def tell(count: int) -> Callable[[], None]:
        told.append(count)
        return lambda: done.append("one")

    assert not any(is_compiled(module) for module in modules)
    assert compile_for_cpu(modules, tell, threads) == 3
    assert (told, done) == ([3], ["one"] * 3)
    assert all(is_compiled(module) for module in modules)
    kept = sorted(path.name for path in empty_cache.iterdir() if path.name.startswith("wp_"))
    assert kept == sorted(module.get_module_identifier(1) for module in modules)
    assert compile_for_cpu(modules, tell, threads) == 0
    assert told == [3], "nobody is told of a wait where there is none"


def test_another_process_finds_in_the_cache_what_this_one_compiled(empty_cache: Path) -> None:
    module = small_module(7)
    compile_for_cpu([module])
    module.execs.clear()  # as in a process that has loaded nothing
    assert is_compiled(module)
    for compiled in (empty_cache / module.get_module_identifier(1)).glob("*.o"):
        compiled.unlink()
    assert not is_compiled(module)


@pytest.mark.parametrize("ending", [".o", ".meta"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_what_lies_cut_off_in_the_cache_is_compiled_anew(ending: str, share: float, empty_cache: Path) -> None:
    """As after a machine lost its power; others that are whole are loaded."""
    number = round(10 * share) + 100 * len(ending)  # another each time: Warp has one module for equal kernels
    broken, whole = small_module(number), small_module(number + 1)
    compile_for_cpu([broken, whole])
    for file in (empty_cache / broken.get_module_identifier(1)).glob(f"*{ending}"):
        file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    for module in (broken, whole):
        module.execs.clear()
    told: list[int] = []
    _load("cpu", [broken, whole], lambda count: lambda: told.append(count))
    assert told == [1], "who waits is told so, of the broken one alone"
    values = wp.zeros(3, dtype=wp.int32, device="cpu")
    for module in (broken, whole):
        (kernel,) = module.kernels.values()
        wp.launch(kernel, dim=3, inputs=[values], device="cpu")
    assert values.numpy().tolist() == [2 * number + 1] * 3


def test_what_a_killed_compiler_left_is_removed_and_nothing_else(empty_cache: Path) -> None:
    kept = ["wp_add_0123456", f"wp_add_0123456_p{os.getpid()}1_t7", "lto"]
    for name in [*kept, f"wp_add_0123456_p{os.getpid()}_t7"]:
        (empty_cache / name).mkdir()
    remove_half_made(os.getpid())
    assert sorted(path.name for path in empty_cache.iterdir()) == sorted(kept)


def test_kernels_for_all_scenes_serve_any() -> None:
    """Each of a scene's own kernels has one of its name among them, that is compiled for no fewer effects."""
    names = {module.name for module in kernels_for_all_scenes()}
    assert {module.__name__ for module in COMMON} <= names
    every = stand_ins.stand_ins().kernels()
    for features in (Features(), Features(traced=True), ALL, Features(media=True, passing=True), Features(bent=True)):
        assert make_variants(features).kernels().keys() - CAN_DO_WITHOUT <= every.keys()
    assert {kernel.module.name for kernel in every.values()} <= names


def test_the_kernel_of_paths_that_end_at_once_has_all_effects_with_which_they_do() -> None:
    ending = stand_ins.ENDING
    assert not ending.goes_on
    left_out = set(ALL.names()) - set(ending.names())
    assert all(Features(**{name: True}).goes_on for name in left_out)
