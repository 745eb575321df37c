"""Kernels with all effects, which stand in for a scene's own while those are not compiled.

A kernel that is compiled for just the effects of a scene is the fastest, but the first scene with a mix of effects
would wait for a compiler. The same kernel with all effects gives the same bits (docs/exactness.md), serves every scene,
and is compiled once.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

from wdpm.kernels.cached import seems_compiled
from wdpm.kernels.camera.shading import make_shading
from wdpm.kernels.features import ALL, Features
from wdpm.kernels.variants import CAN_DO_WITHOUT, Variants, make_variants
from wdpm.scenes.model.bsdfs import LEAVES

ENDING = replace(
    ALL,
    traced=False,
    passing=False,
    **{leaf.KIND.feature: False for leaf in LEAVES if leaf.KIND.glossy and leaf.KIND.feature is not None},
)
"""All effects with which camera paths end at their first surface: for the kernel that no other scene has."""

SHADING = frozenset({"shade_camera_hits", "shade_vertices", "path_misses", "gather_glossy"})
"""Kernels that write or read arrays which are made for some effects only. They are a scene's own or stand in, but all
alike: what one has not written, another must not read."""


@dataclass(frozen=True)
class Chosen:
    """The kernels that a scene is rendered with.

    Attributes:
        outputs: what kernels that shade were compiled for, and so write: arrays are made for that.
        standing_in: names of the scene's own kernels for which others stand in, or do their work.
    """

    variants: Variants
    outputs: Features
    standing_in: frozenset[str] = frozenset()


@functools.cache
def stand_ins() -> Variants:
    """Every kernel with all effects."""
    return replace(make_variants(ALL), shade_camera_hits=make_shading(ENDING).shade_camera_hits)


def own_kernels(features: Features) -> Chosen:
    """Kernels for just these features, compiled or not."""
    return Chosen(make_variants(features), features)


def compiled_kernels(features: Features) -> Chosen:
    """Kernels for these features; where some are not compiled, and with all effects they are, those in their place.

    What is compiled neither way is a scene's own, and has to be waited for: so are those then that it could do without.
    """
    own = make_variants(features)
    kernels = own.kernels()
    lacking = {name for name, kernel in kernels.items() if not seems_compiled(kernel.module)}
    if not lacking:
        return Chosen(own, features)
    every = stand_ins().kernels()
    groups = [SHADING & kernels.keys(), *({name} for name in kernels.keys() - SHADING - CAN_DO_WITHOUT)]
    standing_in = frozenset(
        name
        for group in groups
        if group & lacking and all(seems_compiled(every[name].module) for name in group)
        for name in group
    )
    without = CAN_DO_WITHOUT & lacking
    if lacking - without - standing_in:
        without = frozenset()
    if not standing_in | without:
        return Chosen(own, features)
    variants = replace(own, **{name: every[name] for name in standing_in}, **dict.fromkeys(without))
    return Chosen(variants, ALL if standing_in & SHADING else features, standing_in | without)
