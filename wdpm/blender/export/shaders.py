"""Shader nodes as scattering functions and emission.

What a node means: Blender's manual, "Shader Nodes"; formulas of Cycles 4.5 (intern/cycles/kernel/svm/closure.h).
Roughness is the square root of the alpha of microfacets, as in Disney's material.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wdpm.blender.export.principled import read_principled
from wdpm.blender.export.sockets import Output, Socket
from wdpm.blender.export.values import Value, Values, constant
from wdpm.scenes.model.bsdfs import (
    Blend,
    Bsdf,
    BumpMap,
    Conductor,
    Dielectric,
    Diffuse,
    Distribution,
    Mask,
    NormalMap,
    Null,
    Plastic,
    Translucent,
    TwoSided,
    transmits,
)
from wdpm.scenes.model.textures import RGB, Bitmap, Color, Number

BLACK = (0.0, 0.0, 0.0)
_FALLBACK = Diffuse((0.8, 0.8, 0.8))


@dataclass(frozen=True, eq=False)
class Look:
    """How a surface looks.

    Attributes:
        bsdf: how it scatters light; None if not at all.
        emission: radiance that it emits, or None.
    """

    bsdf: Bsdf | None = None
    emission: Value | None = None


Reader = Callable[["Shaders", Output], Look]
_READERS: dict[str, Reader] = {}


def _reads(*kinds: str) -> Callable[[Reader], Reader]:
    def add(function: Reader) -> Reader:
        _READERS.update(dict.fromkeys(kinds, function))
        return function

    return add


class Shaders:
    """Reads the shaders of one material.

    Attributes:
        values: reads what feeds their sockets.
    """

    def __init__(self, values: Values) -> None:
        self.values = values

    def read(self, socket: Socket) -> Look:
        """What feeds a socket of type shader."""
        source = socket.source
        if source is None:
            return Look()
        reader = _READERS.get(source.kind)
        if reader is None:
            self.values.note(f"{source.label} is not supported: a diffuse grey surface stands for it")
            return Look(_FALLBACK)
        return reader(self, source)

    def color(self, node: Output, name: str = "Color") -> Color:
        """A colour between 0 and 1."""
        return self.values.read(node.input(name)).color(1.0)

    def number(self, node: Output, name: str, least: float = 0.0, most: float = 1.0) -> Number:
        """A number that may be an image."""
        return self.values.read(node.input(name)).number(least, most)

    def alpha(self, node: Output) -> Number:
        """Width of microfacets: the square of the roughness."""
        return self.values.read(node.input("Roughness")).mapped(np.square).number()

    def single(self, node: Output, name: str) -> float:
        """A number that has to be the same everywhere; an image's mean, which is noted."""
        value = self.values.read(node.input(name))
        if value.image is not None:
            self.values.note(f"an image of {name} is not supported: its mean is used")
        return value.mean[0]

    def bent(self, bsdf: Bsdf, node: Output, name: str = "Normal") -> Bsdf:
        """With the normal map or bump map that feeds a node's socket."""
        if not node.has(name):
            return bsdf
        source = node.input(name).source
        if source is None:
            return bsdf
        if source.kind == "ShaderNodeNormalMap":
            return self._normal_map(bsdf, source)
        if source.kind == "ShaderNodeBump":
            return self.bent(self._bump(bsdf, source), source)
        self.values.note(f"{source.label} as a normal is not supported: the surface's own is used")
        return bsdf

    def _normal_map(self, bsdf: Bsdf, node: Output) -> Bsdf:
        if node.node.space != "TANGENT":
            self.values.note("normal maps that are not in tangent space are not supported: it is left out")
            return bsdf
        normals = self.values.read(node.input("Color"))
        strength = self.single(node, "Strength")
        if normals.image is None:
            return bsdf
        if strength != 1.0:
            vectors = (normals.array * 2.0 - 1.0 - [0.0, 0.0, 1.0]) * strength + [0.0, 0.0, 1.0]
            vectors /= np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-20)
            normals = replace(normals, array=vectors * 0.5 + 0.5)
        texture = normals.color(1.0)
        return NormalMap(bsdf, texture, along_v=1.0) if isinstance(texture, Bitmap) else bsdf

    def _bump(self, bsdf: Bsdf, node: Output) -> Bsdf:
        height = self.values.read(node.input("Height"))
        scale = self.single(node, "Strength") * self.single(node, "Distance")
        if height.image is None:
            return bsdf
        texture = height.number(most=1e6)
        return BumpMap(bsdf, texture, -scale if node.node.invert else scale) if isinstance(texture, Bitmap) else bsdf


@_reads("ShaderNodeBsdfPrincipled")
def _principled(shaders: Shaders, node: Output) -> Look:
    surface = read_principled(node, shaders.values)
    bsdf = shaders.bent(surface.bsdf, node)
    return Look(bsdf if surface.opacity == 1.0 else Mask(bsdf, surface.opacity), surface.emission)


@_reads("ShaderNodeBsdfDiffuse")
def _diffuse(shaders: Shaders, node: Output) -> Look:
    if not shaders.values.read(node.input("Roughness")).is_constant(0.0):
        shaders.values.note("the roughness of Diffuse BSDF is ignored: it is Lambertian")
    return Look(shaders.bent(Diffuse(shaders.color(node)), node))


@_reads("ShaderNodeBsdfAnisotropic", "ShaderNodeBsdfGlossy", "ShaderNodeBsdfMetallic")
def _glossy(shaders: Shaders, node: Output) -> Look:
    name = "Color" if node.has("Color") else "Base Color"
    if node.has("Anisotropy") and not shaders.values.read(node.input("Anisotropy")).is_constant(0.0):
        shaders.values.note(f"anisotropy of {node.label} is ignored")
    alpha = shaders.alpha(node)
    bsdf = Conductor(
        specular_reflectance=shaders.color(node, name), alpha_u=alpha, alpha_v=alpha, distribution=Distribution.GGX
    )
    return Look(shaders.bent(bsdf, node))


@_reads("ShaderNodeBsdfGlass", "ShaderNodeBsdfRefraction")
def _glass(shaders: Shaders, node: Output) -> Look:
    colour, alpha = shaders.color(node), shaders.alpha(node)
    reflects = BLACK if node.kind == "ShaderNodeBsdfRefraction" else colour
    eta = max(shaders.single(node, "IOR"), 1e-3)
    return Look(shaders.bent(Dielectric(eta, reflects, colour, alpha, alpha, Distribution.GGX), node))


@_reads("ShaderNodeBsdfTransparent")
def _transparent(shaders: Shaders, node: Output) -> Look:
    if not shaders.values.read(node.input("Color")).is_constant(1.0):
        shaders.values.note("the colour of Transparent BSDF is not supported: all light goes through")
    return Look(Null())


@_reads("ShaderNodeBsdfTranslucent")
def _translucent(shaders: Shaders, node: Output) -> Look:
    return Look(shaders.bent(Translucent(shaders.color(node)), node))


@_reads("ShaderNodeSubsurfaceScattering", "ShaderNodeBsdfToon", "ShaderNodeBsdfSheen")
def _like_diffuse(shaders: Shaders, node: Output) -> Look:
    shaders.values.note(f"{node.label} is not supported: a diffuse surface of its colour stands for it")
    return Look(shaders.bent(Diffuse(shaders.color(node)), node))


@_reads("ShaderNodeHoldout")
def _holdout(shaders: Shaders, node: Output) -> Look:
    shaders.values.note(f"{node.label} is not supported: a black surface stands for it")
    return Look(Diffuse(BLACK))


@_reads("ShaderNodeEmission", "ShaderNodeBackground")
def _emission(shaders: Shaders, node: Output) -> Look:
    colour = shaders.values.read(node.input("Color"))
    strength = shaders.single(node, "Strength")
    return Look(None, colour.mapped(lambda array: array * strength))


@_reads("ShaderNodeAddShader")
def _add(shaders: Shaders, node: Output) -> Look:
    first, second = shaders.read(node.input(0)), shaders.read(node.input(1))
    emission = _sum(shaders.values, first.emission, second.emission)
    if first.bsdf is None or second.bsdf is None:
        return Look(first.bsdf or second.bsdf, emission)
    shaders.values.note("Add Shader of two surfaces is not supported: half of each stands for it")
    return Look(Blend(first.bsdf, second.bsdf, 0.5), emission)


@_reads("ShaderNodeMixShader")
def _mix(shaders: Shaders, node: Output) -> Look:
    first, second = shaders.read(node.input(1)), shaders.read(node.input(2))
    factor = node.input(0).source
    if factor is not None and factor.kind in ("ShaderNodeFresnel", "ShaderNodeLayerWeight"):
        return _mix_by_angle(shaders, factor, first, second)
    weight = shaders.values.read(node.input(0)).mapped(lambda array: np.clip(array, 0.0, 1.0))
    return _blended(shaders, first, second, weight)


def _blended(shaders: Shaders, first: Look, second: Look, weight: Value) -> Look:
    """A share `weight` of the second, the rest of the first."""
    if weight.is_constant(0.0):
        return first
    if weight.is_constant(1.0):
        return second
    rest = weight.mapped(lambda array: 1.0 - array)
    emission = _sum(
        shaders.values, _scaled(shaders.values, first.emission, rest), _scaled(shaders.values, second.emission, weight)
    )
    if first.bsdf is None and second.bsdf is None:
        return Look(None, emission)
    one, other = (Diffuse(BLACK) if look.bsdf is None else look.bsdf for look in (first, second))
    if isinstance(one, Null):
        return Look(other if isinstance(other, Null) else Mask(other, weight.number()), emission)
    if isinstance(other, Null):
        return Look(Mask(one, rest.number()), emission)
    return Look(Blend(one, other, weight.number()), emission)


def _mix_by_angle(shaders: Shaders, factor: Output, first: Look, second: Look) -> Look:
    """Mixed by Fresnel's law: diffuse under gloss is plastic; for others the mean over all directions is used."""
    if factor.kind == "ShaderNodeFresnel":
        eta = max(shaders.single(factor, "IOR"), 1.001)
    else:
        eta = 1.0 / max(1.0 - shaders.single(factor, "Blend"), 1e-3)
    base, gloss = first.bsdf, second.bsdf
    if isinstance(base, Diffuse) and isinstance(gloss, Conductor) and isinstance(gloss.alpha_u, float):
        coat = Plastic(base.reflectance, gloss.specular_reflectance, eta, alpha=gloss.alpha_u)
        return Look(replace(coat, distribution=Distribution.GGX), first.emission)
    share = min(1.0, 0.05 + ((eta - 1.0) / (eta + 1.0)) ** 2)
    shaders.values.note(f"{factor.label} between these shaders is not supported: the second has {share:.0%} everywhere")
    return _blended(shaders, first, second, constant(share))


def _scaled(values: Values, emission: Value | None, share: Value) -> Value | None:
    """Emission times a share."""
    if emission is None:
        return None
    if share.image is None:
        return emission.mapped(lambda array: array * share.array)
    if emission.image is None:
        return replace(share, array=share.array * emission.array)
    values.note("an image of emission mixed by another image is not supported: the mean of the second is used")
    return emission.mapped(lambda array: array * np.array(share.mean))


def _sum(values: Values, first: Value | None, second: Value | None) -> Value | None:
    """Emission of both."""
    if first is None or second is None:
        return first if second is None else second
    if first.image is not None and second.image is not None:
        values.note("two images of emission are added: the mean of the second is used")
        return first.mapped(lambda array: array + np.array(second.mean))
    placed, other = (first, second) if first.image is not None else (second, first)
    return placed.mapped(lambda array: array + other.array)


def on_both_sides(bsdf: Bsdf) -> Bsdf:
    """Seen from behind as from the front, as all surfaces are in Blender; what transmits light knows its sides."""
    if not transmits(bsdf):
        return TwoSided(bsdf)
    if isinstance(bsdf, Blend):
        return replace(bsdf, first=on_both_sides(bsdf.first), second=on_both_sides(bsdf.second))
    if isinstance(bsdf, Mask):
        return replace(bsdf, nested=on_both_sides(bsdf.nested))
    return bsdf


def emission_of(look: Look) -> RGB | Bitmap | None:
    """The emission that a mesh takes, or None where it is dark."""
    if look.emission is None or not look.emission.array.max(initial=0.0) > 0.0:
        return None
    colour = look.emission.color()
    return colour if isinstance(colour, tuple | Bitmap) else look.emission.mean
