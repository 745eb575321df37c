"""Every file with Warp code sets the options that the exactness contract asks for.

Warp applies those of the module that a kernel is in to all functions that it calls: a file's, or, for kernels that a
factory makes for a set of features, those of the kernel's own module.
"""

from __future__ import annotations

import importlib
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
import warp as wp

import wdpm
from wdpm.kernels.camera.replayed_vertices import make_replay_vertices
from wdpm.kernels.features import ALL, Features
from wdpm.kernels.variants import Variants, make_variants

FOLDER = Path(wdpm.__path__[0]) / "kernels"
SOURCES = {".".join(path.relative_to(FOLDER).with_suffix("").parts): path for path in sorted(FOLDER.rglob("*.py"))}
FILES = [name for name, path in SOURCES.items() if "@wp." in path.read_text()]

FOR_REPLAYS = {"replay_vertices": make_replay_vertices}
"""Kernels that no render needs, and the factories that make them."""

KERNEL = re.compile(r"^( *)@wp\.kernel(.*)$", re.MULTILINE)


def kernels_of(features: Features) -> dict[str, wp.Kernel]:
    """The kernels that features pick, by name."""
    return make_variants(features).kernels()


def options_of(kernel: wp.Kernel) -> dict[str, Any]:
    """What a kernel is compiled with: its own options, then those of its module."""
    return {**kernel.module.options, **kernel.options}


def test_there_are_kernel_files() -> None:
    assert {"rays.bvh", "photons.gather", "photons.paths", "camera.shading", "photons.beam"} <= set(FILES)


@pytest.mark.parametrize("name", FILES)
def test_no_contraction_and_no_backward_pass(name: str) -> None:
    module = importlib.import_module(f"wdpm.kernels.{name}")
    options = wp.get_module_options(module)
    assert options["fuse_fp"] is False
    assert options["enable_backward"] is False


@pytest.mark.parametrize("features", [ALL, Features(), Features(traced=True)], ids=["all", "none", "traced"])
def test_no_contraction_and_no_backward_pass_in_kernels_of_features(features: Features) -> None:
    for name, kernel in kernels_of(features).items():
        options = options_of(kernel)
        assert options["fuse_fp"] is False, name
        assert options["enable_backward"] is False, name
        assert options["fast_math"] is False, name


def test_these_are_all_kernels_of_features() -> None:
    """Some kernels are for scenes without effects only, some for those without media."""
    some = [kernels_of(features).keys() for features in (ALL, Features(), Features(traced=True))]
    assert set().union(*some) == {field.name for field in fields(Variants)}


def test_kernels_of_factories_are_modules_of_their_own() -> None:
    """A kernel inside a factory that shared its file's module would be compiled anew with every further variant."""
    for path in FOLDER.rglob("*.py"):
        for indent, arguments in KERNEL.findall(path.read_text()):
            assert not indent or path.name == "made_for.py", (
                f"{path.name}: {arguments}: @made_for(features) in its place"
            )


def test_variants_have_every_kernel_that_a_factory_makes() -> None:
    made = "".join(path.read_text() for path in FOLDER.rglob("*.py"))
    names = set(re.findall(r"^ +@made_for\(.*\n +def (\w+)\(", made, re.MULTILINE))
    assert names - set(FOR_REPLAYS) == {field.name for field in fields(Variants)}


@pytest.mark.parametrize("name", FOR_REPLAYS)
def test_no_contraction_and_no_backward_pass_in_kernels_for_replays(name: str) -> None:
    options = options_of(FOR_REPLAYS[name](ALL))
    assert options["fuse_fp"] is False
    assert options["enable_backward"] is False
    assert options["fast_math"] is False


def test_the_same_features_share_their_kernels() -> None:
    assert make_variants(ALL) is make_variants(ALL)
    alike = [make_variants(Features(points=on)) for on in (False, True)]
    assert alike[0].trace_photons is alike[1].trace_photons  # lights do not matter on the way


def test_all_files_with_kernels_are_compiled_ahead() -> None:
    from wdpm.kernels.compile import MODULES

    ahead = {module.__name__.removeprefix("wdpm.kernels.") for module in MODULES}
    of_files = {
        name for name, path in SOURCES.items() if any(not indent for indent, _ in KERNEL.findall(path.read_text()))
    }
    assert of_files <= ahead
