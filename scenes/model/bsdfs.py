"""Scattering of light at surfaces, as trees: leaves that scatter, and nodes that choose between or bend others.

Names, meanings and defaults are those of Mitsuba 3's plugins.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from enum import Enum

from wdpm.scenes.model.textures import Bitmap, Checkerboard, Color, Number, Texture, VertexColors

BLACK = (0.0, 0.0, 0.0)
WHITE = (1.0, 1.0, 1.0)
GREY = (0.5, 0.5, 0.5)


class Distribution(Enum):
    """Of the normals of microfacets."""

    BECKMANN = "beckmann"
    GGX = "ggx"


@dataclass(frozen=True, eq=False)
class Diffuse:
    """Lambertian reflection; the back is black.

    Attributes:
        reflectance: albedo in [0, 1].
    """

    reflectance: Color = GREY


@dataclass(frozen=True, eq=False)
class Conductor:
    """A metal: smooth where alpha is 0 (`conductor`), else rough (`roughconductor`).

    Attributes:
        eta, k: real and imaginary index of refraction; (0, 0, 0) and (1, 1, 1) reflect everything.
        alpha_u, alpha_v: roughness along the tangents.
    """

    eta: Color = BLACK
    k: Color = WHITE
    specular_reflectance: Color = WHITE
    alpha_u: Number = 0.0
    alpha_v: Number = 0.0
    distribution: Distribution = Distribution.BECKMANN


@dataclass(frozen=True, eq=False)
class Dielectric:
    """Glass and the like: smooth where alpha is 0 (`dielectric`), else rough (`roughdielectric`).

    Attributes:
        eta: index of refraction inside over that outside.
    """

    eta: float = 1.5046 / 1.000277
    specular_reflectance: Color = WHITE
    specular_transmittance: Color = WHITE
    alpha_u: Number = 0.0
    alpha_v: Number = 0.0
    distribution: Distribution = Distribution.BECKMANN


@dataclass(frozen=True, eq=False)
class ThinDielectric:
    """A pane whose two sides are one surface (`thindielectric`)."""

    eta: float = 1.5046 / 1.000277
    specular_reflectance: Color = WHITE
    specular_transmittance: Color = WHITE


@dataclass(frozen=True, eq=False)
class Plastic:
    """A diffuse base under a dielectric coat: smooth where alpha is 0 (`plastic`), else rough (`roughplastic`)."""

    diffuse_reflectance: Color = GREY
    specular_reflectance: Color = WHITE
    eta: float = 1.49 / 1.000277
    nonlinear: bool = False
    alpha: float = 0.0
    distribution: Distribution = Distribution.BECKMANN


@dataclass(frozen=True, eq=False)
class Principled:
    """Disney's material as Mitsuba 3's `principled` has it; glTF's metallic-roughness is a part of it.

    Attributes:
        eta: index of refraction inside over that outside; what `specular` stands for is turned into it by the loader.
    """

    base_color: Color = GREY
    roughness: Number = 0.5
    anisotropic: Number = 0.0
    metallic: Number = 0.0
    spec_trans: Number = 0.0
    eta: float = 1.5
    spec_tint: Number = 0.0
    sheen: Number = 0.0
    sheen_tint: Number = 0.0
    flatness: Number = 0.0
    clearcoat: Number = 0.0
    clearcoat_gloss: Number = 0.0


@dataclass(frozen=True, eq=False)
class Null:
    """Lets all light pass: the boundary of a medium."""


@dataclass(frozen=True, eq=False)
class TwoSided:
    """The nested material on the front and, seen from behind, on the back (or another one there)."""

    front: Bsdf
    back: Bsdf | None = None


@dataclass(frozen=True, eq=False)
class Mask:
    """Lets light pass where `opacity` is below 1."""

    nested: Bsdf
    opacity: Number = 0.5


@dataclass(frozen=True, eq=False)
class Blend:
    """A share `weight` of `second`, the rest of `first`."""

    first: Bsdf
    second: Bsdf
    weight: Number = 0.5


@dataclass(frozen=True, eq=False)
class BumpMap:
    """Bends the shading normal along the slope of a height texture."""

    nested: Bsdf
    height: Texture
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class NormalMap:
    """Replaces the shading normal by that of a texture, in the tangents' frame: (r, g, b) * 2 - 1."""

    nested: Bsdf
    normals: Texture


Leaf = Diffuse | Conductor | Dielectric | ThinDielectric | Plastic | Principled | Null
Bsdf = Leaf | TwoSided | Mask | Blend | BumpMap | NormalMap


def nested(bsdf: Bsdf) -> tuple[Bsdf, ...]:
    """The scattering functions directly inside one."""
    values = [getattr(bsdf, part.name) for part in fields(bsdf)]
    return tuple(value for value in values if isinstance(value, Bsdf))


def walk(bsdf: Bsdf) -> Iterator[Bsdf]:
    """A scattering function and all that is inside it, from the outside in."""
    yield bsdf
    for inner in nested(bsdf):
        yield from walk(inner)


def textures_of(bsdf: Bsdf) -> tuple[Texture, ...]:
    """All textures that a scattering function reads, in the order of its tree."""
    values = [getattr(node, part.name) for node in walk(bsdf) for part in fields(node)]
    return tuple(value for value in values if isinstance(value, Texture))


def uses_uvs(bsdf: Bsdf) -> bool:
    """Whether its looks depend on texture coordinates: by a texture, or by tangents that follow them."""
    if any(isinstance(texture, Bitmap | Checkerboard) for texture in textures_of(bsdf)):
        return True
    return any(_has_tangents(node) for node in walk(bsdf))


def _has_tangents(node: Bsdf) -> bool:
    if isinstance(node, Conductor | Dielectric):
        return node.alpha_u is not node.alpha_v and node.alpha_u != node.alpha_v
    if isinstance(node, Principled):
        return node.anisotropic != 0
    return isinstance(node, BumpMap | NormalMap)


def transmits(bsdf: Bsdf) -> bool:
    """Whether any light goes through to the other side."""
    for node in walk(bsdf):
        if isinstance(node, Dielectric | ThinDielectric | Null | Mask):
            return True
        if isinstance(node, Principled) and node.spec_trans != 0:
            return True
    return False


def vertex_attributes(*values: Bsdf | Color | None) -> set[str]:
    """Names of the vertex attributes that scattering functions, colours or textures read."""
    textures = [texture for value in values if isinstance(value, Bsdf) for texture in textures_of(value)]
    textures += [value for value in values if isinstance(value, Texture)]
    return {texture.name for texture in textures if isinstance(texture, VertexColors)}
