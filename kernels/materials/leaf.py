"""What kernels do for a kind of leaf, as a set of functions that its module makes for some features.

bsdf.py says what each function takes and gives; all leaves' take the same, so that one can be chosen by kind.
"""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp


@dataclass(frozen=True, eq=False)
class DiffusePart:
    """Functions of a leaf's diffuse part.

    Attributes:
        has_diffuse: `(b) -> bool`, whether a leaf of the kind has one.
        eval_diffuse: for directions in front of the surface; it is not asked about others.
        probability_diffuse: likewise for w_from.
        is_even: `(b) -> bool`, whether irradiance, and how much it grazes, tell what it reflects (LeafKind.even).
        reflectance: `(b, w_from) -> vec3`, what it reflects towards w_from, in front of the surface, of light that
            arrives alike from all sides, over the radiance of that.
        grazing_gain: `(b, w_from) -> float`, by what share of this it reflects more for each unit by which light grazes
            more than that (kernels.maths.schlick); None where it makes no difference.
    """

    has_diffuse: wp.Function
    eval_diffuse: wp.Function
    probability_diffuse: wp.Function
    is_even: wp.Function
    reflectance: wp.Function
    grazing_gain: wp.Function | None = None


@dataclass(frozen=True, eq=False)
class GlossyPart:
    """Functions of a leaf's glossy part; without `eval_glossy` and `pdf_glossy` where all its directions are delta."""

    sample_glossy: wp.Function
    eval_glossy: wp.Function | None = None
    pdf_glossy: wp.Function | None = None


@dataclass(frozen=True, eq=False)
class LeafCode:
    """A kind of leaf, compiled for some features.

    Attributes:
        kind: its number, scenes.model.leaf_kind.
        read: `(materials, textures, node, uv, color) -> Bsdf`, its parameters at a point.
        diffuse, glossy: its parts, None where it has none.
        straight: `(materials, textures, node, uv, color, cos_theta) -> vec3`, what of light goes straight through (as
            LeafKind.straight says that some does); None where all does, or none.
    """

    kind: int
    read: wp.Function
    diffuse: DiffusePart | None = None
    glossy: GlossyPart | None = None
    straight: wp.Function | None = None
