"""Hashes that are remembered are those that Warp works out; where they are not, Warp does so as ever."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import warp as wp

from wdpm.kernels import made_for, module_hashes
from wdpm.kernels.cached import is_compiled, seems_compiled
from wdpm.kernels.camera.rays import make_camera_rays
from wdpm.kernels.compile import COMMON
from wdpm.kernels.features import Features
from wdpm.kernels.module_hashes import CPU_BLOCK, FOLDER, KEPT, Hashes, forget, hashes, state_of_sources
from wdpm.kernels.variants import make_variants
from wdpm.kernels.warp_versions import is_tried


def module_of(addend: int) -> wp.Module:
    """A module with a kernel of its own."""

    @wp.kernel(module="unique", enable_backward=False)
    def add_some(values: wp.array[wp.int32]) -> None:
        values[wp.tid()] += wp.static(addend)

    return add_some.module


def known_after(module: wp.Module, file: Path) -> Hashes:
    """What another process would know once this one has written down the hash of a module."""
    first = Hashes(file)
    first.add_variant("some", module.name)
    module.get_module_hash(CPU_BLOCK)
    first.add(module)
    first.write()
    return Hashes(file)


def told(module: wp.Module, known: Hashes) -> bool:
    """Whether Warp, as in a process of its own, is told the hash of a module."""
    module.hashers.pop(CPU_BLOCK, None)
    known.recall(module)
    return forget(module)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "hashes" / "of-this-state.json"


def test_what_is_remembered_of_a_scenes_kernels_is_what_warp_works_out(file: Path) -> None:
    modules = [wp.get_module(each.__name__) for each in COMMON] + make_variants(Features(traced=True)).modules()
    first, names, symbols = Hashes(file), {}, {}
    for module in modules:
        forget(module)
        first.add_variant(module.name, module.name)
        names[module.name] = module.get_module_identifier(CPU_BLOCK)
        symbols[module.name] = {key: kernel.get_mangled_name() for key, kernel in module.kernels.items()}
        first.add(module)
    first.write()
    known = Hashes(file)
    for module in modules:
        module.hashers.pop(CPU_BLOCK)
        known.recall(module)
        assert module.get_module_identifier(CPU_BLOCK) == names[module.name]
        assert {key: kernel.get_mangled_name() for key, kernel in module.kernels.items()} == symbols[module.name]
        assert forget(module), f"{module.name} was hashed again"


def test_a_variant_is_named_alike_when_its_name_is_remembered(
    empty_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(made_for, "_made", {})
    features = Features(lens=True)
    fresh = make_camera_rays.__wrapped__(features)
    hashes().write()
    assert list((empty_cache / FOLDER).glob("*.json"))
    again = make_camera_rays.__wrapped__(features)
    assert again.start_paths is fresh.start_paths, "the same code is compiled once"
    other = make_camera_rays.__wrapped__(Features())
    assert other.visit_camera_rays.module.name != fresh.visit_camera_rays.module.name


def test_a_remembered_hash_is_for_these_options_only(file: Path) -> None:
    module = module_of(41)
    known = known_after(module, file)
    assert told(module, known)
    wp.set_module_options({"fuse_fp": False}, module)
    assert not told(module, known)


def test_a_module_with_other_kernels_is_hashed(file: Path) -> None:
    module = module_of(42)
    known = known_after(module, file)

    @wp.kernel(module=module, enable_backward=False)
    def another(values: wp.array[wp.int32]) -> None:
        values[wp.tid()] = 0

    assert another.key in module.kernels
    assert not told(module, known)


def test_a_module_of_other_sources_is_not_remembered(file: Path) -> None:
    module = module_of(43)
    module.get_module_hash(CPU_BLOCK)
    known = Hashes(file)
    known.add(module)
    known.write()
    assert not file.exists()


@pytest.mark.parametrize(
    "contents", ["", "{", "[]", '{"modules": 1}', '{"modules": {"NAME": {"hash": 5}}}', "\x00\xff"]
)
def test_a_spoilt_file_changes_nothing(file: Path, contents: str) -> None:
    module = module_of(44)
    name = module.get_module_identifier(CPU_BLOCK)
    file.parent.mkdir()
    file.write_text(contents.replace("NAME", module.name))
    assert not told(module, Hashes(file))
    assert module.get_module_identifier(CPU_BLOCK) == name
    assert told(module, known_after(module, file)), "it is written anew"


def test_what_is_remembered_but_not_in_the_cache_is_worked_out(empty_cache: Path) -> None:
    module = module_of(45)
    hashes().add_variant("some", module.name)
    wp.force_load("cpu", [module])
    hashes().add(module)
    hashes().write()
    (entry,) = (empty_cache / FOLDER).glob("*.json")
    spoilt = json.loads(entry.read_text())
    spoilt["modules"][module.name]["hash"] = "00" * 32
    entry.write_text(json.dumps(spoilt))
    module_hashes._hashes_in.cache_clear()
    module.execs.clear()
    module.hashers.pop(CPU_BLOCK)
    assert is_compiled(module), "by its true hash"
    assert not forget(module)


@pytest.mark.usefixtures("empty_cache")
def test_that_a_module_is_not_compiled_is_worked_out_once() -> None:
    module = module_of(50)
    hashes().add_variant("some", module.name)
    assert not seems_compiled(module)
    hashes().write()
    module_hashes._hashes_in.cache_clear()
    module.hashers.pop(CPU_BLOCK, None)
    assert not seems_compiled(module)
    assert CPU_BLOCK not in module.hashers, "nothing was hashed, and nobody builds on what is only remembered"
    wp.force_load("cpu", [module])
    module.execs.clear()
    assert seems_compiled(module)


def test_for_what_is_not_remembered_a_module_is_hashed_after_all(file: Path) -> None:
    """So a module that another process removes from the cache meanwhile is compiled."""
    module = module_of(46)
    kernels = [kernel.key for kernel in module.kernels.values()]
    known = known_after(module, file)
    module.hashers.pop(CPU_BLOCK)
    known.recall(module)
    assert [kernel.key for kernel in module.hashers[CPU_BLOCK].get_unique_kernels()] == kernels


IN_A_PROCESS = """
import sys
from pathlib import Path
import numpy as np
import warp as wp
from wdpm.kernels.cached import use_cache_folder
from wdpm.kernels.compile import compile_for_cpu
from wdpm.kernels.launch import Launcher
from wdpm.kernels.rays import overlap
from wdpm.kernels.module_hashes import forget
use_cache_folder(Path(sys.argv[1]))
module = wp.get_module(overlap.__name__)
compiled = compile_for_cpu([module])
corners = np.float32([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[5, 0, 0], [6, 0, 0], [5, 1, 0]]])
low, high = np.full((1, 3), -1.0), np.full((1, 3), 2.0)
found = overlap.triangles_in_boxes(corners, low, high, Launcher(threads=1))
print("RESULT", compiled, found.tolist(), forget(module))
"""


def test_a_module_that_was_told_its_hash_is_launched(tmp_path: Path) -> None:
    """In processes of their own, as every start is: nothing has hashed the kernels in the second."""
    command = [sys.executable, "-c", IN_A_PROCESS, str(tmp_path)]
    said = [subprocess.run(command, capture_output=True, text=True, check=True).stdout for _ in range(2)]
    results = [line for each in said for line in each.splitlines() if line.startswith("RESULT")]
    assert results == ["RESULT 1 [[True], [False]] False", "RESULT 0 [[True], [False]] True"]


def test_this_warp_can_be_told_hashes() -> None:
    """With a newer one wdpm works as well, and starts more slowly, until someone has tried."""
    assert is_tried()


def test_a_warp_that_was_not_tried_works_hashes_out(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = module_of(48)
    known = known_after(module, file)
    assert told(module, known)
    monkeypatch.setattr(wp, "__version__", "9.0.0")
    assert not told(module, known)
    known.add(module_of(49))
    assert is_compiled(module) is False
    assert module.get_module_identifier(CPU_BLOCK).startswith(f"wp_{module.name}_")


@pytest.mark.parametrize("changed", ["hashers", "resolve_options", "_get_live_kernels"])
def test_with_a_warp_of_another_inside_nothing_is_remembered(file: Path, changed: str) -> None:
    """Each is something of Warp's that is not public."""

    class Other:
        """A module as a later Warp might have it."""

        def __init__(self, module: wp.Module) -> None:
            self.name, self._module = module.name, module

        def __getattr__(self, name: str) -> object:
            if name == changed:
                raise AttributeError(name)
            return getattr(self._module, name)

    module = module_of(47)
    known = Hashes(file)
    known.add_variant("some", module.name)
    module.get_module_hash(CPU_BLOCK)
    known.add(Other(module))
    known.recall(Other(module))
    known.write()
    assert json.loads(file.read_text())["modules"] == {}


def test_every_source_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sources = [tmp_path / "a.py", tmp_path / "b.py"]
    monkeypatch.setattr(module_hashes, "_sources", lambda _: map(str, sources))
    states = set()
    for texts in (("x = 1", "y = 2"), ("x = 1", "y = 3"), ("x = 1y", " = 2"), ("x = 1", "y = 2 ")):
        for path, text in zip(sources, texts, strict=True):
            path.write_text(text)
        states.add(state_of_sources.__wrapped__())
    assert len(states) == 4


def test_the_sources_are_those_of_all_kernels() -> None:
    files = {Path(path).resolve() for package in module_hashes.PACKAGES for path in module_hashes._sources(package)}
    for each in COMMON:
        assert Path(str(each.__file__)).resolve() in files
    assert len(files) > 100


def test_old_states_are_forgotten(tmp_path: Path) -> None:
    for number in range(KEPT + 3):
        known = Hashes(tmp_path / f"{number}.json")
        known.add_variant("some", "name")
        known.write()
    assert len(list(tmp_path.glob("*.json"))) == KEPT
