"""Scattering of light at surfaces, as trees: leaves that scatter, and nodes that choose between or bend others.

Names, meanings and defaults are those of Mitsuba 3's plugins.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from enum import Enum
from typing import ClassVar

from wdpm.scenes.model.leaf_kind import LeafKind, always, in_order
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Color, Number, Texture, VertexColors

__all__ = [
    "Blend",
    "Bsdf",
    "BumpMap",
    "Conductor",
    "Dielectric",
    "Diffuse",
    "Distribution",
    "Mask",
    "NormalMap",
    "Null",
    "Plastic",
    "Principled",
    "RoughPane",
    "ThinDielectric",
    "Translucent",
    "TwoSided",
]

BLACK = (0.0, 0.0, 0.0)
WHITE = (1.0, 1.0, 1.0)
GREY = (0.5, 0.5, 0.5)

HARDLY_ANY = 1.001
"""Index of refraction of a `Principled` that reflects next to nothing as a dielectric, and all it has as a metal."""


class Distribution(Enum):
    """Of the normals of microfacets."""

    BECKMANN = "beckmann"
    GGX = "ggx"


@dataclass(frozen=True, eq=False)
class Bsdf:
    """A scattering function: a leaf, or a node with others inside. What it says of itself leaves out those inside."""

    @property
    def lets_through(self) -> bool:
        """Whether any light gets to the other side."""
        return False

    @property
    def is_solid(self) -> bool:
        """Whether light is refracted into what it covers."""
        return False

    @property
    def follows_uvs(self) -> bool:
        """Whether its looks depend on the direction of the tangents."""
        return False

    @property
    def is_smooth(self) -> bool:
        """Whether light is reflected or refracted in single directions."""
        return False


@dataclass(frozen=True, eq=False)
class Leaf(Bsdf):
    """A scattering function with none inside. KIND says how it is written down and what it calls for."""

    KIND: ClassVar[LeafKind]


@dataclass(frozen=True, eq=False)
class Diffuse(Leaf):
    """Lambertian reflection; the back is black.

    Attributes:
        reflectance: albedo in [0, 1].
    """

    KIND = LeafKind(
        1, "diffuse", in_order("reflectance"), gathers=lambda row: row.may_shine("reflectance"), glossy=False
    )

    reflectance: Color = GREY


@dataclass(frozen=True, eq=False)
class Conductor(Leaf):
    """A metal: smooth where alpha is 0 (`conductor`), else rough (`roughconductor`).

    Attributes:
        eta, k: real and imaginary index of refraction; (0, 0, 0) and (1, 1, 1) reflect everything.
        alpha_u, alpha_v: roughness along the tangents.
    """

    KIND = LeafKind(
        2,
        "conductor",
        in_order("specular_reflectance", "eta", "k", "alpha_u", "alpha_v"),
        feature="conductor",
        rough=("alpha_u", "alpha_v"),
        tells_tangents=lambda row: row.differ("alpha_u", "alpha_v"),
    )

    eta: Color = BLACK
    k: Color = WHITE
    specular_reflectance: Color = WHITE
    alpha_u: Number = 0.0
    alpha_v: Number = 0.0
    distribution: Distribution = Distribution.BECKMANN

    @property
    def follows_uvs(self) -> bool:
        return self.alpha_u is not self.alpha_v and self.alpha_u != self.alpha_v

    @property
    def is_smooth(self) -> bool:
        return self.alpha_u == 0 and self.alpha_v == 0


@dataclass(frozen=True, eq=False)
class Dielectric(Leaf):
    """Glass and the like: smooth where alpha is 0 (`dielectric`), else rough (`roughdielectric`).

    Attributes:
        eta: index of refraction inside over that outside.
    """

    KIND = LeafKind(
        3,
        "dielectric",
        in_order("specular_reflectance", "specular_transmittance", "eta", "alpha_u", "alpha_v"),
        feature="dielectric",
        rough=("alpha_u", "alpha_v"),
        transmits=always,
        tells_tangents=lambda row: row.differ("alpha_u", "alpha_v"),
    )

    eta: float = 1.5046 / 1.000277
    specular_reflectance: Color = WHITE
    specular_transmittance: Color = WHITE
    alpha_u: Number = 0.0
    alpha_v: Number = 0.0
    distribution: Distribution = Distribution.BECKMANN

    @property
    def lets_through(self) -> bool:
        return True

    @property
    def is_solid(self) -> bool:
        return True

    @property
    def follows_uvs(self) -> bool:
        return self.alpha_u is not self.alpha_v and self.alpha_u != self.alpha_v

    @property
    def is_smooth(self) -> bool:
        return self.alpha_u == 0 and self.alpha_v == 0


@dataclass(frozen=True, eq=False)
class ThinDielectric(Leaf):
    """A pane whose two sides are one surface (`thindielectric`)."""

    KIND = LeafKind(
        4,
        "thin dielectric",
        in_order("specular_reflectance", "specular_transmittance", "eta"),
        feature="thin_dielectric",
        transmits=always,
        straight=True,
    )

    eta: float = 1.5046 / 1.000277
    specular_reflectance: Color = WHITE
    specular_transmittance: Color = WHITE

    @property
    def lets_through(self) -> bool:
        return True

    @property
    def is_smooth(self) -> bool:
        return True


@dataclass(frozen=True, eq=False)
class Plastic(Leaf):
    """A diffuse base under a dielectric coat: smooth where alpha is 0 (`plastic`), else rough (`roughplastic`)."""

    KIND = LeafKind(
        5,
        "plastic",
        in_order("specular_reflectance", "diffuse_reflectance", "eta", "alpha", "", "nonlinear"),  # then its coat
        feature="plastic",
        gathers=lambda row: row.may_shine("diffuse_reflectance"),
        lambertian=False,
        even=lambda row: row.number("eta") > 1,  # else it reflects all light from beyond some angle
        rough=("alpha",),
    )

    diffuse_reflectance: Color = GREY
    specular_reflectance: Color = WHITE
    eta: float = 1.49 / 1.000277
    nonlinear: bool = False
    alpha: float = 0.0
    distribution: Distribution = Distribution.BECKMANN

    @property
    def is_smooth(self) -> bool:
        return self.alpha == 0


@dataclass(frozen=True, eq=False)
class Principled(Leaf):
    """Disney's material as Mitsuba 3's `principled` has it, or with the diffuse part that glTF and Blender mean.

    Attributes:
        eta: index of refraction inside over that outside; what `specular` stands for is turned into it by the loader.
            At 1 itself not even a metal reflects, which is Mitsuba's way: others take `HARDLY_ANY`.
        layered: whether the diffuse part is a Lambertian surface beneath the gloss, lit by what that does not reflect
            (glTF 2.0, appendix B); else it is Disney's, which is brighter at grazing angles where the surface is rough.
    """

    KIND = LeafKind(
        6,
        "principled",
        in_order(
            "base_color",
            "roughness",
            "eta",
            "anisotropic",
            "metallic",
            "spec_trans",
            "spec_tint",
            "sheen",
            "sheen_tint",
            "flatness",
            "clearcoat",
            "clearcoat_gloss",
            "layered",
        ),
        feature="principled",
        gathers=lambda row: not row.is_one("metallic") and not row.is_one("spec_trans"),
        lambertian=False,
        even=lambda row: row.is_one("layered") and row.is_zero("sheen"),
        always_rough=True,
        transmits=lambda row: row.number("spec_trans") > 0.0,
        tells_tangents=lambda row: row.number("anisotropic") != 0.0,
    )
    distribution: ClassVar[Distribution] = Distribution.GGX

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
    layered: bool = False

    @property
    def lets_through(self) -> bool:
        return self.spec_trans != 0

    @property
    def is_solid(self) -> bool:
        return self.spec_trans != 0

    @property
    def follows_uvs(self) -> bool:
        return self.anisotropic != 0


@dataclass(frozen=True, eq=False)
class Translucent(Leaf):
    """A sheet that light leaves at the other side in all directions alike, from both sides (0.6's `difftrans`)."""

    KIND = LeafKind(
        8,
        "translucent",
        in_order("transmittance"),
        feature="translucent",
        gathers=lambda row: row.may_shine("transmittance"),
        glossy=False,
        through=True,
        transmits=always,
    )

    transmittance: Color = GREY

    @property
    def lets_through(self) -> bool:
        return True


@dataclass(frozen=True, eq=False)
class RoughPane(Leaf):
    """A pane of microfacets, alike from both sides, that bends nothing: the specular part of `principledthin`.

    Attributes:
        base_color: factor of what is let through.
        eta: index of refraction of the sheet over that around it.
        blur: roughness of what is let through over that of what is reflected; 0 for Disney's, 0.65 eta - 0.35.
    """

    KIND = LeafKind(
        9,
        "rough pane",
        in_order("base_color", "roughness", "eta", "anisotropic", "spec_tint", "blur"),
        feature="rough_pane",
        always_rough=True,
        transmits=always,
        tells_tangents=lambda row: row.number("anisotropic") != 0.0,
    )

    base_color: Color = GREY
    roughness: Number = 0.5
    eta: Number = 1.5
    anisotropic: Number = 0.0
    spec_tint: Number = 0.0
    blur: float = 0.0

    @property
    def lets_through(self) -> bool:
        return True

    @property
    def follows_uvs(self) -> bool:
        return self.anisotropic != 0


@dataclass(frozen=True, eq=False)
class Null(Leaf):
    """Lets all light pass: the boundary of a medium."""

    KIND = LeafKind(7, "null", {}, feature="passing", glossy=False, transmits=always, straight=True)

    @property
    def lets_through(self) -> bool:
        return True


@dataclass(frozen=True, eq=False)
class TwoSided(Bsdf):
    """The nested material on the front and, seen from behind, on the back (or another one there)."""

    front: Bsdf
    back: Bsdf | None = None


@dataclass(frozen=True, eq=False)
class Mask(Bsdf):
    """Lets light pass where `opacity` is below 1.

    Attributes:
        cutoff: opacity from which on nothing passes, and below which all does (glTF); 0 for none.
    """

    nested: Bsdf
    opacity: Number = 0.5
    cutoff: float = 0.0

    @property
    def lets_through(self) -> bool:
        return True


@dataclass(frozen=True, eq=False)
class Blend(Bsdf):
    """A share `weight` of `second`, the rest of `first`."""

    first: Bsdf
    second: Bsdf
    weight: Number = 0.5


@dataclass(frozen=True, eq=False)
class BumpMap(Bsdf):
    """Bends the shading normal along the slope of a height texture."""

    nested: Bsdf
    height: Texture
    scale: float = 1.0

    @property
    def follows_uvs(self) -> bool:
        return True


@dataclass(frozen=True, eq=False)
class NormalMap(Bsdf):
    """Replaces the shading normal by that of a texture, in the tangents' frame: (r, g, b) * 2 - 1.

    Attributes:
        along_v: which way green leans: 1 to where v grows, -1 to where it falls. 0 for a quarter turn to the left of
            where u grows, as Mitsuba has it, which is another way where a texture lies mirrored on the surface.
    """

    nested: Bsdf
    normals: Texture
    along_v: float = 0.0

    @property
    def follows_uvs(self) -> bool:
        return True


LEAVES: tuple[type[Leaf], ...] = tuple(sorted(Leaf.__subclasses__(), key=lambda leaf: leaf.KIND.number))
"""All leaves, by the numbers of their kinds."""


def nested(bsdf: Bsdf) -> tuple[Bsdf, ...]:
    """The scattering functions directly inside one."""
    values = [getattr(bsdf, part.name) for part in fields(bsdf)]
    return tuple(value for value in values if isinstance(value, Bsdf))


def walk(bsdf: Bsdf) -> Iterator[Bsdf]:
    """A scattering function and all that is inside it, from the outside in."""
    yield bsdf
    for inner in nested(bsdf):
        yield from walk(inner)


def is_smooth_anywhere(bsdf: Bsdf) -> bool:
    """Whether some part of it reflects or refracts light in single directions."""
    return any(node.is_smooth for node in walk(bsdf))


def textures_of(bsdf: Bsdf) -> tuple[Texture, ...]:
    """All textures that a scattering function reads, in the order of its tree."""
    values = [getattr(node, part.name) for node in walk(bsdf) for part in fields(node)]
    return tuple(value for value in values if isinstance(value, Texture))


def uses_uvs(bsdf: Bsdf) -> bool:
    """Whether its looks depend on texture coordinates: by a texture, or by tangents that follow them."""
    if any(isinstance(texture, Bitmap | Checkerboard) for texture in textures_of(bsdf)):
        return True
    return any(node.follows_uvs for node in walk(bsdf))


def transmits(bsdf: Bsdf) -> bool:
    """Whether any light goes through to the other side."""
    return any(node.lets_through for node in walk(bsdf))


def vertex_attributes(*values: Bsdf | Color | None) -> set[str]:
    """Names of the vertex attributes that scattering functions, colours or textures read."""
    textures = [texture for value in values if isinstance(value, Bsdf) for texture in textures_of(value)]
    textures += [value for value in values if isinstance(value, Texture)]
    return {texture.name for texture in textures if isinstance(texture, VertexColors)}
