"""Kernels compiled for CUDA, which needs no GPU: Warp's wheel has NVIDIA's compiler from CUDA C++ to PTX."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path

import warp as wp

from wdpm.bench import effects_scenes
from wdpm.bench.gpu.names import plain_name
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.work.replica import with_camera
from wdpm.kernels.compile import MODULES
from wdpm.kernels.features import Features
from wdpm.kernels.photons import kd_order, photon_map
from wdpm.kernels.rays import bvh_build
from wdpm.kernels.variants import CAN_DO_WITHOUT, Variants, make_variants, without_shortcuts
from wdpm.scenes.errors import WdpmError
from wdpm.scenes.flat.flatten import flatten

ARCHITECTURES = (80, 90)
"""Compute capabilities, as NVIDIA writes them without the point: A100, H100."""

_ENTRY = re.compile(r"^\s*(?:\.visible\s+)?\.entry\s+(\w+?)(?:_[0-9a-f]{6,})?_cuda_kernel_forward\b", re.MULTILINE)
_ROUNDED = re.compile(r"\b(?:add|sub|mul|div|rcp|sqrt)(?:\.(?!rn\b)\w+)*\.f(?:32|64)\b")
_INEXACT = re.compile(
    r"\b(?:fma|mad|ex2|lg2|sin|cos|tanh|rsqrt)(?:\.\w+)*\.f(?:32|64)\b|\b\w+(?:\.\w+)*\.(?:approx|ftz)\b"
)


@dataclass(frozen=True)
class Compiled:
    """A module of Warp, compiled for one architecture.

    Attributes:
        name: of the module.
        seconds: of one core.
        ptx: NVIDIA's portable assembly.
    """

    name: str
    architecture: int
    seconds: float
    ptx: str

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels, as they are in Python."""
        return tuple(plain_name(key) for key in _ENTRY.findall(self.ptx))


def compile_module(module: wp.Module, architecture: int, folder: Path) -> Compiled:
    """Compile one module.

    Args:
        folder: for Warp's files; a module that is there already is not compiled again.

    Raises:
        WdpmError: the compiler refused, or Warp has none on this machine.
    """
    began = time.process_time()
    try:
        (path,) = wp.compile_aot_module(module, arch=architecture, use_ptx=True, module_dir=folder)
    except Exception as error:  # Warp raises bare exceptions for all that its compiler says
        raise WdpmError(
            f"{module.name} does not compile for sm_{architecture}: {' '.join(str(error).split())}"
        ) from error
    seconds = time.process_time() - began
    ptx = path.read_bytes().rstrip(b"\0").decode()  # NVRTC's end of a string is written along
    return Compiled(module.name, architecture, seconds, ptx)


def common_modules() -> list[wp.Module]:
    """The modules of kernels that do not depend on a scene's effects; a file of functions alone has none."""
    modules = [wp.get_module(module.__name__) for module in MODULES]
    return [module for module in modules if module.kernels]


def features_of_effects() -> dict[str, Features]:
    """What kernels of each scene of `wdpm bench effects` are compiled for, with photon maps and with a cache."""
    found = {}
    for name in effects_scenes.names():
        flat = flatten(effects_scenes.scene_of(name, (16, 16)))
        for indirect in (Indirect.MAP, Indirect.CACHE):
            settings = RenderSettings(indirect=indirect)
            found[f"{name}, {indirect.value}"] = with_camera(features_of(flat, settings), flat.camera)
    return found


def modules_of(features: Iterable[Features]) -> list[wp.Module]:
    """The modules of all kernels that some sets of features pick on a GPU, each once."""
    every = [module for one in features for module in without_shortcuts(make_variants(one)).modules()]
    return list({id(module): module for module in every}.values())


def all_kernels(*, trees: bool = True) -> tuple[str, ...]:
    """Names of the kernels of renders on a GPU, sorted.

    Args:
        trees: also those that build trees, which the CPU does wherever they are used.
    """
    build = {bvh_build.__name__, kd_order.__name__, photon_map.__name__}
    modules = [module for module in common_modules() if trees or module.name not in build]
    shared = {name for module in modules for name in module.kernels}
    return tuple(sorted(shared | {field.name for field in fields(Variants)} - CAN_DO_WITHOUT))


def inexact_instructions(ptx: str) -> Counter[str]:
    """Instructions of floating point whose bits the contract of exactness does not know, and how many there are.

    Each sum, product, quotient and root must be rounded to nearest by name: without `.rn` the assembler may fuse two of
    them. Nothing may be fused, approximated, or have its subnormal numbers flushed to zero.
    """
    return Counter([*_ROUNDED.findall(ptx), *_INEXACT.findall(ptx)])
