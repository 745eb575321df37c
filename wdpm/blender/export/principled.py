"""Blender's Principled BSDF as ours, which is Disney's in the form of Mitsuba 3, with a Lambertian base.

They differ in how the base shares light with the gloss above it. Blender's base gets what the whole gloss lets through
of the light of a direction; ours what facets between two directions do not reflect. So that both reflect the same share
of light that comes from all directions, the base colour is multiplied by `base_share`.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.blender.export.sockets import Output
from wdpm.blender.export.values import Value, Values
from wdpm.scenes.model.bsdfs import HARDLY_ANY, Bsdf, Dielectric, Principled
from wdpm.scenes.model.textures import Number

SMOOTH = 0.03
"""Roughness below which clear glass refracts in single directions: its blur is a fifth of a degree."""

_IGNORED = {
    "Subsurface Weight": "subsurface scattering",
    "Thin Film Thickness": "the thin film",
    "Diffuse Roughness": "diffuse roughness",
    "Anisotropic Rotation": "rotation of the anisotropy",
}
"""Sockets of which anything but 0 is ignored."""


@dataclass(frozen=True, eq=False)
class PrincipledSurface:
    """What a Principled BSDF node says.

    Attributes:
        opacity: 1 where it hides what is behind.
        emission: radiance, or None.
    """

    bsdf: Bsdf
    opacity: Number
    emission: Value | None


def read_principled(node: Output, values: Values) -> PrincipledSurface:
    """Reads the node; what of it is not supported is noted."""
    for name, what in _IGNORED.items():
        if node.has(name) and not values.read(node.input(name)).is_constant(0.0):
            values.note(f"{what} of Principled BSDF is ignored")
    opacity = values.read(node.input("Alpha")).number()
    emission = values.read(node.input("Emission Color"))
    strength = values.read(node.input("Emission Strength"))
    if strength.image is not None:
        values.note("an image of Emission Strength is not supported: its mean is used")
    glow = emission.mapped(lambda array: array * strength.mean[0])
    return PrincipledSurface(_scattering(node, values), opacity, glow if glow.array.max(initial=0.0) > 0.0 else None)


def _scattering(node: Output, values: Values) -> Bsdf:
    colour = values.read(node.input("Base Color"))
    rough = values.read(node.input("Roughness"))
    metallic = values.read(node.input("Metallic"))
    glass = values.read(node.input("Transmission Weight"))
    eta = _eta(node, values)
    if glass.is_constant(1.0) and metallic.is_constant(0.0) and rough.image is None and rough.array[0] < SMOOTH:
        return Dielectric(eta, specular_transmittance=colour.mapped(lambda c: np.sqrt(np.maximum(c, 0.0))).color(1.0))
    share = 1.0
    if not metallic.is_constant(1.0) and not glass.is_constant(1.0):
        body = (1.0 - metallic.mean[0]) * (1.0 - glass.mean[0])
        share = 1.0 - body * (1.0 - base_share(round(rough.mean[0], 3), round(eta, 4)))
    if not values.read(node.input("Specular Tint")).is_constant(1.0):
        values.note("Specular Tint of Principled BSDF is ignored")
    coat = values.read(node.input("Coat Weight")).number()
    if coat != 0.0:
        values.note("the coat of Principled BSDF is Disney's, weaker, most so at grazing angles, and without a tint")
    sheen = values.read(node.input("Sheen Weight")).number()
    if sheen != 0.0:
        values.note("the sheen of Principled BSDF is Disney's, without roughness and tint")
    gloss = values.read(node.input("Coat Roughness")).mean[0]
    return Principled(
        base_color=colour.mapped(lambda c: c * share).color(1.0),
        roughness=rough.number(),
        anisotropic=values.read(node.input("Anisotropic")).number(),
        metallic=metallic.number(),
        spec_trans=glass.number(),
        eta=eta if eta < 1.0 else max(eta, HARDLY_ANY),  # Cycles' metals do not ask for it
        sheen=sheen,
        clearcoat=coat,
        clearcoat_gloss=min(max((0.1 - gloss * gloss) / (0.1 - 0.001), 0.0), 1.0),
        layered=True,
    )


def _eta(node: Output, values: Values) -> float:
    """The index of refraction, with what Specular IOR Level does to the reflection at normal incidence."""
    index = values.read(node.input("IOR"))
    level = values.read(node.input("Specular IOR Level"))
    for name, value in (("IOR", index), ("Specular IOR Level", level)):
        if value.image is not None:
            values.note(f"an image of {name} is not supported: its mean is used")
    eta, factor = max(index.mean[0], 1e-3), 2.0 * max(level.mean[0], 0.0)
    if factor == 1.0:
        return eta
    root = min(math.sqrt(factor) * abs(eta - 1.0) / (eta + 1.0), 0.999)
    return (1.0 + root) / (1.0 - root) if eta >= 1.0 else (1.0 - root) / (1.0 + root)


@functools.cache
def base_share(roughness: float, eta: float) -> float:
    """What the base colour has to be multiplied by to reflect as much as Blender's.

    With a white base, of light that comes from all directions, Blender's base reflects 1 - F, F what the gloss
    reflects; ours the mean over both hemispheres of what facets between two directions do not reflect.
    """
    cosines = (np.arange(32) + 0.5) / 32.0
    turns = (np.arange(32) + 0.5) * (math.pi / 32.0)
    to, off, turn = np.meshgrid(cosines, cosines, turns, indexing="ij")
    between = to * off + np.sqrt((1.0 - to**2) * (1.0 - off**2)) * np.cos(turn)
    through = 1.0 - _reflectance(np.sqrt(0.5 * (1.0 + between)), eta)
    reflected = float((through * to * off).mean() / (to * off).mean())
    gloss = _mean_reflectance(eta) * (1.0 - 0.38 * roughness - 0.25 * roughness**2)  # fitted to Cycles
    return (1.0 - gloss) / reflected


def _mean_reflectance(eta: float) -> float:
    """Of an interface, for light from all directions outside."""
    cosine = (np.arange(256, dtype=np.float64) + 0.5) / 256.0
    return float((_reflectance(cosine, eta) * cosine).mean() / cosine.mean())


def _reflectance(cosine: NDArray[np.float64], eta: float) -> NDArray[np.float64]:
    """Of an interface, for light from outside (Fresnel's equations, unpolarised).

    Args:
        cosine: between the light and the normal, above 0.
    """
    inside = np.sqrt(np.maximum(1.0 - (1.0 - cosine**2) / eta**2, 0.0))
    across = (cosine - eta * inside) / (cosine + eta * inside)
    along = (eta * cosine - inside) / (eta * cosine + inside)
    return np.where(inside > 0.0, 0.5 * (across**2 + along**2), 1.0)
