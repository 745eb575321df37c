"""What the statements of an MTL material stand for: a scattering function that conserves energy.

The format ("MTL material format", Wavefront 1995) describes looks, not physics, and files in the wild fill it in
freely. The rules here are few, and every one has a reason:

* **Highlights.** Ks over Kd is a mixture of a Lambertian surface and a GGX metal that reflects Ks, chosen by
  max(Ks) / (max(Ks) + max(Kd)). Where Kd and Ks together reflect more than they receive both are lowered by the same
  factor, as Mitsuba 0.6's `phong` does. Blinn's exponent Ns is the roughness sqrt(2 / (Ns + 2)) ("Microfacet Models for
  Refraction through Rough Surfaces", Walter et al. 2007, section 5.2). `illum 0` and `illum 1` have no highlight.
* **Mirrors.** `illum 3`, `5` and `8` trace reflections: the highlight is then a mirror where Kd is black, where Ns is
  1000 (the top of the format's scale) or more, or where Ns is not given.
* **Glass.** `illum 6` and `7` refract: a smooth dielectric of index Ni. So do `4` and `9` unless d says that the
  surface is partly opaque, and any surface that is see-through (d < 1) with a black Kd and an index above 1. What is
  not refracted is reflected by Fresnel's equations, so Ks and Kd have no part in it.
* **Tf** tints what glass lets through. Its hue counts, not its magnitude: files have 1 on opaque materials and 0.1 on
  clear glass. What differs from the plain reading is said in a warning.
* **d, Tr, map_d** elsewhere are the share of light that passes straight through.
* **Pr, Pm, Ps, Pc, Pcr** (the widespread extension for physically based materials) make it a `principled` material.

Every surface but glass looks the same from both sides.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from wdpm.scenes.model.bsdfs import (
    BLACK,
    WHITE,
    Bsdf,
    BumpMap,
    Dielectric,
    Diffuse,
    Distribution,
    Mask,
    NormalMap,
    Principled,
    TwoSided,
)
from wdpm.scenes.model.highlights import capped, highlight_over, largest
from wdpm.scenes.model.textures import RGB, Bitmap, Color, Number

NO_HIGHLIGHT: Final = (0, 1)
MIRRORS: Final = (3, 5, 8)
REFRACTING: Final = (6, 7)
GLASSY: Final = (4, 9)
ILLUM_MODELS: Final = range(11)
MIRROR_EXPONENT: Final = 1000.0
DEFAULT_INDEX: Final = 1.5


@dataclass(frozen=True, eq=False)
class Pbr:
    """The extension for physically based materials.

    Attributes:
        roughness, metallic, sheen, clearcoat, clearcoat_roughness: Pr, Pm, Ps, Pc and Pcr, 0 to 1.
    """

    roughness: Number = 0.5
    metallic: Number = 0.0
    sheen: float = 0.0
    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.0


@dataclass(frozen=True, eq=False)
class Looks:
    """The statements of a material.

    Attributes:
        diffuse: Kd times map_Kd.
        specular: Ks.
        exponent: Ns, or None.
        index: Ni, or None.
        opacity: d times map_d; 1 is opaque.
        transmission_filter: Tf.
        illum: illumination model, or None.
        height, height_scale: bump map and its -bm.
        normals: normal map, or None.
        pbr: None without any such statement.
    """

    diffuse: Color = (0.5, 0.5, 0.5)
    specular: RGB = BLACK
    exponent: float | None = None
    index: float | None = None
    opacity: Number = 1.0
    transmission_filter: RGB = WHITE
    illum: int | None = None
    height: Bitmap | None = None
    height_scale: float = 1.0
    normals: Bitmap | None = None
    pbr: Pbr | None = None


Warn = Callable[[str, str], None]
"""Called with the keyword of a statement and what became of it."""


def scattering(looks: Looks, warn: Warn) -> Bsdf:
    """The scattering function that a material's statements stand for."""
    if _is_glass(looks):
        return _bent(looks, _glass(looks, warn))
    surface = TwoSided(_bent(looks, _opaque(looks, warn)))
    return surface if looks.opacity == 1.0 else Mask(surface, looks.opacity)


def _is_glass(looks: Looks) -> bool:
    index = looks.index if looks.index is not None else DEFAULT_INDEX
    if index <= 1.0:
        return False
    if looks.illum in REFRACTING:
        return True
    if isinstance(looks.opacity, Bitmap):
        return False
    if looks.illum in GLASSY:
        return looks.opacity in (0.0, 1.0)
    return looks.opacity != 1.0 and looks.index is not None and looks.diffuse == BLACK


def _glass(looks: Looks, warn: Warn) -> Dielectric:
    if looks.index is None:
        warn("illum", f"refracts, but Ni is not given: {DEFAULT_INDEX:g} is used")
    hue, strength = looks.transmission_filter, max(looks.transmission_filter)
    if strength > 0.0:
        hue = hue[0] / strength, hue[1] / strength, hue[2] / strength
    else:
        hue = WHITE
    if strength != 1.0:
        warn("Tf", "dims what glass lets through: only its hue is used")
    if largest(looks.diffuse) > 0.1:
        warn("Kd", "has no part in glass, and is ignored")
    return Dielectric(DEFAULT_INDEX if looks.index is None else looks.index, WHITE, hue)


def _opaque(looks: Looks, warn: Warn) -> Bsdf:
    if looks.illum in (*REFRACTING, *GLASSY) and looks.opacity == 1.0:
        warn("illum", "asks for glass, but Ni is not above 1: treated as opaque")
    if looks.pbr is not None:
        return _principled(looks, looks.pbr)
    specular = BLACK if looks.illum in NO_HIGHLIGHT else looks.specular
    if max(specular) == 0.0:
        return Diffuse(_lowered(looks.diffuse, "Kd", warn))
    alpha = _roughness(looks)
    surface, total = highlight_over(looks.diffuse, specular, (alpha, alpha), Distribution.GGX)
    if total > 1.0:
        warn("Ks", f"reflects more than it receives together with Kd: both are divided by {total:.3g}")
    return surface


def _roughness(looks: Looks) -> float:
    """Of the highlight; 0 is a mirror."""
    exponent = looks.exponent
    if looks.illum in MIRRORS and (exponent is None or exponent >= MIRROR_EXPONENT or looks.diffuse == BLACK):
        return 0.0
    return math.sqrt(2.0 / ((0.0 if exponent is None else exponent) + 2.0))


def _principled(looks: Looks, pbr: Pbr) -> Principled:
    return Principled(
        base_color=capped(looks.diffuse),
        roughness=pbr.roughness,
        metallic=pbr.metallic,
        eta=looks.index if looks.index is not None and looks.index > 1.0 else DEFAULT_INDEX,
        sheen=pbr.sheen,
        clearcoat=pbr.clearcoat,
        clearcoat_gloss=1.0 - pbr.clearcoat_roughness,
    )


def _bent(looks: Looks, bsdf: Bsdf) -> Bsdf:
    if looks.normals is not None:
        bsdf = NormalMap(bsdf, looks.normals, along_v=1.0)
    return bsdf if looks.height is None else BumpMap(bsdf, looks.height, looks.height_scale)


def _lowered(colour: Color, keyword: str, warn: Warn) -> Color:
    if largest(colour) > 1.0:
        warn(keyword, "is above 1: lowered to 1")
    return capped(colour)
