"""Mitsuba's bsdf plugins as scattering functions: Mitsuba 3's parameters and defaults, 0.6's spellings.

Source: Mitsuba 3 documentation, "BSDFs". Parameters that only steer sampling are accepted and change nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from wdpm.scenes.errors import did_you_mean
from wdpm.scenes.mitsuba.metals import METALS
from wdpm.scenes.mitsuba.plugin import Plugin
from wdpm.scenes.mitsuba.refraction_indices import INDICES
from wdpm.scenes.mitsuba.supported import reads
from wdpm.scenes.mitsuba.textures import TextureReader, halved
from wdpm.scenes.mitsuba.values import numbers
from wdpm.scenes.model.bsdfs import (
    BLACK,
    GREY,
    WHITE,
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
    Principled,
    RoughPane,
    ThinDielectric,
    Translucent,
    TwoSided,
    transmits,
)
from wdpm.scenes.model.highlights import highlight_over
from wdpm.scenes.model.textures import Color, Number, Texture

# what stands in for "no difference of index" where light must be refracted; Mitsuba's own values
_LEAST_ETA, _LEAST_SPECULAR = 1.001, 1e-3


@dataclass(frozen=True)
class BsdfReader:
    """Reads bsdf plugins, with all that is nested in them.

    Attributes:
        textures: what reads their textures.
        warnings: what is replaced is appended here.
    """

    textures: TextureReader
    warnings: list[str]

    def read(self, plugin: Plugin) -> Bsdf:
        """The scattering function that a plugin describes.

        Raises:
            SceneError: a parameter that the plugin does not have or that is out of range, with file and line.
        """
        bsdf = _READERS[plugin.type](self, plugin)
        plugin.finish()
        return bsdf

    def one_nested(self, plugin: Plugin) -> Bsdf:
        """The only bsdf nested in a plugin."""
        found = plugin.take_nested("bsdf")
        if len(found) != 1:
            raise plugin.error(f"{plugin}: expected one nested bsdf, got {len(found)}")
        return self.read(found[0])

    def color(self, plugin: Plugin, name: str, default: tuple[float, float, float] = WHITE) -> Color:
        """A colour between 0 and 1, or a texture."""
        return self.textures.take_color(plugin, name, default, most=1.0)

    def share(self, plugin: Plugin, name: str, default: float) -> Number:
        """A number between 0 and 1, or a texture."""
        return self.textures.take_number(plugin, name, default, most=1.0)


_Reader = Callable[[BsdfReader, Plugin], Bsdf]
_READERS: Final[dict[str, _Reader]] = {}


def _reads(plugin_type: str) -> Callable[[_Reader], _Reader]:
    """Registers what reads plugins of a type: with that they are supported."""

    def register(reader: _Reader) -> _Reader:
        _READERS[plugin_type] = reader
        reads("bsdf", plugin_type)
        return reader

    return register


@_reads("diffuse")
def _diffuse(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    # 0.6 knows both names
    name = "diffuse_reflectance" if plugin.has("diffuse_reflectance") else "reflectance"
    return Diffuse(reader.color(plugin, name, GREY))


@_reads("conductor")
def _conductor(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    eta, k = _complex_index(reader, plugin)
    return Conductor(eta, k, reader.color(plugin, "specular_reflectance"))


@_reads("roughconductor")
def _rough_conductor(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    eta, k = _complex_index(reader, plugin)
    alpha_u, alpha_v = _roughness(reader, plugin)
    specular = reader.color(plugin, "specular_reflectance")
    return Conductor(eta, k, specular, alpha_u, alpha_v, _distribution(plugin))


def _complex_index(reader: BsdfReader, plugin: Plugin) -> tuple[Color, Color]:
    """eta and k of a conductor: given, or those of a named material; over the index outside (0.6's extEta)."""
    outside = _index(plugin, "ext_eta", "vacuum")
    if not plugin.has("material"):
        eta = reader.textures.take_color(plugin, "eta", BLACK)
        k = reader.textures.take_color(plugin, "k", WHITE)
        return _divided(plugin, eta, outside), _divided(plugin, k, outside)
    at = plugin.at("material")
    name = plugin.take_string("material")
    if plugin.has("eta") or plugin.has("k"):
        raise at.error(f'{plugin}: give either "material" or "eta" and "k", not both')
    if name not in METALS:
        spelt = {metal.lower(): metal for metal in METALS}.get(name.lower(), name)
        hint = did_you_mean(spelt, METALS) or f" (known: {', '.join(METALS)})"
        raise at.error(f'{plugin}: unknown material "{name}"{hint}')
    metal_eta, metal_k = METALS[name]
    return _divided(plugin, metal_eta, outside), _divided(plugin, metal_k, outside)


def _divided(plugin: Plugin, value: Color, divisor: float) -> Color:
    if divisor == 1.0:
        return value
    if isinstance(value, Texture):
        raise plugin.error(f'{plugin}: "ext_eta" together with a texture as "eta" or "k" is not supported')
    return value[0] / divisor, value[1] / divisor, value[2] / divisor


def _index(plugin: Plugin, name: str, default: str) -> float:
    """An index of refraction: a number, or the name of a material."""
    at = plugin.at(name)
    if at.tag in ("float", "integer"):
        return plugin.take_positive(name, 1.0)
    given = plugin.take_string(name, default)
    if given.lower() not in INDICES:
        hint = did_you_mean(given.lower(), INDICES) or f" (known: {', '.join(INDICES)})"
        raise at.error(f'{plugin}: unknown material "{given}" as "{name}"{hint}')
    return INDICES[given.lower()]


def _relative_index(plugin: Plugin, inside: str) -> float:
    return _index(plugin, "int_ior", inside) / _index(plugin, "ext_ior", "air")


def _distribution(plugin: Plugin) -> Distribution:
    at = plugin.at("distribution")
    given = plugin.take_string("distribution", "beckmann")
    plugin.ignore("sample_visible")
    names = [distribution.value for distribution in Distribution]
    if given.lower() not in names:
        error = at.error(f'{plugin}: "distribution" must be one of {", ".join(names)}, got "{given}"')
        plugin.rules.refuse(error, f'{plugin}: distribution "{given}" is not supported', 'it is taken for "beckmann"')
        return Distribution.BECKMANN
    return Distribution(given.lower())


def _roughness(reader: BsdfReader, plugin: Plugin) -> tuple[Number, Number]:
    """alpha for both tangents, or one for each."""
    directions = ("alpha_u", "alpha_v")
    along = [reader.textures.take_number(plugin, name, -1.0) for name in directions if _is_given(plugin, name)]
    if not along:
        alpha = reader.textures.take_number(plugin, "alpha", 0.1)
        return alpha, alpha
    if len(along) == 1:
        raise plugin.error(f'{plugin}: "alpha_u" and "alpha_v" must be given together')
    if _is_given(plugin, "alpha"):
        raise plugin.value_error("alpha", 'cannot be given together with "alpha_u" and "alpha_v"')
    return along[0], along[1]


def _is_given(plugin: Plugin, name: str) -> bool:
    return plugin.has(name) or plugin.has_nested("texture", name)


@_reads("dielectric")
def _dielectric(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    eta = _relative_index(plugin, "bk7")
    _tell_smooth(plugin)
    return Dielectric(eta, *_interface(reader, plugin))


@_reads("thindielectric")
def _thin_dielectric(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    eta = _relative_index(plugin, "bk7")
    _tell_smooth(plugin)
    return ThinDielectric(eta, *_interface(reader, plugin))


def _tell_smooth(plugin: Plugin) -> None:
    """Files of forks give a smooth dielectric a roughness; Mitsuba 0.6 warns of it."""
    for name in plugin.ignore("alpha", "distribution"):
        plugin.rules.tell(plugin.line, f"{plugin}: {name} is ignored: the surface is smooth")


@_reads("roughdielectric")
def _rough_dielectric(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    at = plugin.at("int_ior")
    eta = _relative_index(plugin, "bk7")
    if eta == 1.0:
        raise at.error(f'{plugin}: "int_ior" must differ from "ext_ior": nothing would be refracted')
    reflectance, transmittance = _interface(reader, plugin)
    alpha_u, alpha_v = _roughness(reader, plugin)
    return Dielectric(eta, reflectance, transmittance, alpha_u, alpha_v, _distribution(plugin))


def _interface(reader: BsdfReader, plugin: Plugin) -> tuple[Color, Color]:
    return reader.color(plugin, "specular_reflectance"), reader.color(plugin, "specular_transmittance")


@_reads("plastic")
def _plastic(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    return _coated(reader, plugin)


@_reads("roughplastic")
def _rough_plastic(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    for texture in plugin.take_nested("texture", "alpha"):
        raise texture.error(f'{plugin}: "alpha" must be a number; Mitsuba 3 takes no texture here')
    at = plugin.at("alpha")
    alpha = plugin.take_float("alpha", 0.1)
    if alpha < 0:
        raise at.error(f'{plugin}: "alpha" must not be negative, got {alpha:g}')
    return replace(_coated(reader, plugin), alpha=alpha, distribution=_distribution(plugin))


def _coated(reader: BsdfReader, plugin: Plugin) -> Plastic:
    """What plastic and roughplastic have in common."""
    at = plugin.at("int_ior")
    eta = _relative_index(plugin, "polypropylene")
    if eta < 1.0:
        raise at.error(f'{plugin}: "int_ior" must not be less than "ext_ior"')
    diffuse = reader.color(plugin, "diffuse_reflectance", GREY)
    specular = reader.color(plugin, "specular_reflectance")
    return Plastic(diffuse, specular, eta, plugin.take_bool("nonlinear", False))


_SHARES: Final = (
    "anisotropic",
    "metallic",
    "spec_trans",
    "spec_tint",
    "sheen",
    "sheen_tint",
    "flatness",
    "clearcoat",
    "clearcoat_gloss",
)


@_reads("principled")
def _principled(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    base = reader.color(plugin, "base_color", GREY)
    roughness = reader.share(plugin, "roughness", 0.5)
    shares: dict[str, Any] = {name: reader.share(plugin, name, 0.0) for name in _SHARES}
    eta = _principled_index(plugin, refracts=shares["spec_trans"] != 0)
    plugin.ignore("main_specular_sampling_rate", "clearcoat_sampling_rate", "diffuse_reflectance_sampling_rate")
    return Principled(base, roughness, eta=eta, **shares)


def _principled_index(plugin: Plugin, *, refracts: bool) -> float:
    """The index that "eta" or "specular" stands for.

    "Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering", Burley 2015: a specular of 1
    reflects 8 % at normal incidence, and the index is solved for from Fresnel's equation there.
    """
    if plugin.has("eta"):
        if plugin.has("specular") and not plugin.replaced:
            raise plugin.value_error("specular", 'cannot be given together with "eta": one follows from the other')
        plugin.ignore("specular")
        eta = plugin.take_positive("eta", 1.5)
        return _LEAST_ETA if refracts and eta == 1.0 else eta
    at = plugin.at("specular")
    specular = plugin.take_float("specular", 0.5)
    if not 0.0 <= specular <= 1.0:
        raise at.error(f'{plugin}: "specular" must lie between 0 and 1, got {specular:g}')
    if refracts and specular == 0.0:
        specular = _LEAST_SPECULAR
    return 2.0 / (1.0 - math.sqrt(0.08 * specular)) - 1.0


@_reads("principledthin")
def _principled_thin(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    """Its lobes one by one: what is not specular is Disney's diffuse part, without a coat, on both sides."""
    base = reader.color(plugin, "base_color", GREY)
    roughness = reader.share(plugin, "roughness", 0.5)
    names = ("anisotropic", "spec_trans", "spec_tint", "sheen", "sheen_tint", "flatness")
    shares = {name: reader.share(plugin, name, 0.0) for name in names}
    # 2 lets all of it through
    crossing = halved(reader.textures.take_number(plugin, "diff_trans", 0.0, most=2.0))
    eta = reader.textures.take_number(plugin, "eta", 1.5)
    if eta == 0.0:
        raise plugin.value_error("eta", "must be greater than 0")
    plugin.ignore(*(f"{kind}_{way}_sampling_rate" for kind in ("diffuse", "specular") for way in _WAYS))
    diffuse: dict[str, Any] = {name: shares[name] for name in ("sheen", "sheen_tint", "flatness")}
    surface: Bsdf = TwoSided(Principled(base, roughness, eta=1.0, **diffuse))  # of index 1: no reflection over it
    if crossing != 0.0:
        surface = Blend(surface, Translucent(base), crossing)
    if shares["spec_trans"] == 0.0:
        return surface
    pane = RoughPane(base, roughness, eta, shares["anisotropic"], shares["spec_tint"])
    return Blend(surface, pane, shares["spec_trans"])


_WAYS: Final = ("reflectance", "transmittance")


@_reads("difftrans")
def _diffuse_transmitter(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    return Translucent(reader.color(plugin, "transmittance", GREY))


@_reads("phong")
def _phong(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    """0.6's, whose exponent stands for a roughness (Walter et al. 2007, section 5.2)."""
    exponent = _plain(plugin, "exponent", 30.0)
    alpha = math.sqrt(2.0 / (exponent + 2.0))
    return _highlighted(reader, plugin, (alpha, alpha))


@_reads("ward")
def _ward(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    """0.6's, whose roughness is that of Beckmann's distribution: Ward's lobe is an approximation of it."""
    alpha_u, alpha_v = _plain(plugin, "alpha_u", 0.1), _plain(plugin, "alpha_v", 0.1)
    plugin.ignore("variant")  # which of three approximations
    return _highlighted(reader, plugin, (alpha_u, alpha_v))


def _plain(plugin: Plugin, name: str, default: float) -> float:
    for texture in plugin.take_nested("texture", name):
        raise texture.error(f'{plugin}: a texture as "{name}" is not supported; give a number')
    return plugin.take_positive(name, default)


def _highlighted(reader: BsdfReader, plugin: Plugin, alpha: tuple[float, float]) -> Bsdf:
    diffuse = reader.color(plugin, "diffuse_reflectance", GREY)
    specular = reader.color(plugin, "specular_reflectance", (0.2, 0.2, 0.2))
    surface, _ = highlight_over(diffuse, specular, alpha, Distribution.BECKMANN)
    size = f"{alpha[0]:.3g}" if alpha[0] == alpha[1] else f"{alpha[0]:.3g} and {alpha[1]:.3g}"
    plugin.rules.tell(
        plugin.line, f"{plugin}: taken for a mixture of diffuse and rough metal (Beckmann, roughness {size})"
    )
    return surface


@_reads("coating")
def _coating(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    return _coat_over(reader, plugin, Plastic())


@_reads("roughcoating")
def _rough_coating(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    alpha = _plain(plugin, "alpha", 0.1)
    return _coat_over(reader, plugin, Plastic(alpha=alpha, distribution=_distribution(plugin)))


def _coat_over(reader: BsdfReader, plugin: Plugin, coat: Plastic) -> Bsdf:
    """0.6's dielectric coat: over a diffuse surface it is a plastic; over others it can only be left away."""
    at = plugin.at("int_ior")
    eta = _relative_index(plugin, "bk7")
    if eta < 1.0:
        raise at.error(f'{plugin}: "int_ior" must not be less than "ext_ior"')
    specular = reader.color(plugin, "specular_reflectance")
    given = plugin.at("sigma_a")
    absorbs = reader.textures.take_color(plugin, "sigma_a", BLACK) != BLACK
    plugin.ignore("thickness")  # counts together with sigma_a only
    if absorbs:
        what = f"{plugin}: a coat that absorbs (sigma_a) is not supported yet"
        plugin.rules.refuse(given.error(f"{what}; leave sigma_a out"), what, "it is clear")
    nested = reader.one_nested(plugin)
    if isinstance(nested, Diffuse):
        plugin.rules.tell(plugin.line, f"{plugin}: taken for a plastic with this coat over the diffuse surface")
        return replace(
            coat, diffuse_reflectance=nested.reflectance, specular_reflectance=specular, eta=eta, nonlinear=True
        )
    what = f"{plugin}: a coat over anything but a diffuse surface is not supported yet"
    plugin.rules.refuse(plugin.error(f"{what}; use plastic or principled"), what, "the coat is left away")
    return nested


@_reads("mixturebsdf")
def _mixture(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    """0.6's, of any number of parts: blends of blends. What the weights leave of 1 is absorbed."""
    at = plugin.at("weights")
    weights = numbers(plugin.take_string("weights"), at)
    found = [reader.read(nested) for nested in plugin.take_nested("bsdf")]
    if len(found) != len(weights) or not found:
        raise at.error(f"{plugin}: {len(weights)} weights for {len(found)} nested bsdfs; expected one each")
    if min(weights) < 0.0 or not sum(weights) > 0.0:
        raise at.error(f'{plugin}: "weights" must not be negative, and not all 0')
    total = max(sum(weights), 1.0)  # more than 1 is lowered, as in Mitsuba
    parts = [*zip(found, (weight / total for weight in weights), strict=True)]
    if sum(weights) < 1.0:
        parts.append((Diffuse(BLACK), 1.0 - sum(weights)))
    mixed, so_far = parts[0]
    for part, share in parts[1:]:
        so_far += share
        mixed = Blend(mixed, part, share / so_far) if share > 0.0 else mixed
    return mixed


@_reads("twosided")
def _two_sided(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    found = plugin.take_nested("bsdf")
    if not 1 <= len(found) <= 2:
        raise plugin.error(f"{plugin}: expected one nested bsdf for both sides, or two, got {len(found)}")
    sides = [_front(reader, plugin, inner) for inner in found]
    return TwoSided(sides[0], sides[1] if len(sides) == 2 else None)


def _front(reader: BsdfReader, plugin: Plugin, inner: Plugin) -> Bsdf:
    side = reader.read(inner)
    if transmits(side):
        raise inner.error(f"{plugin}: {inner} lets light through; only materials that do not can be two-sided")
    return side.front if isinstance(side, TwoSided) else side  # each side is only ever seen from its front


@_reads("mask")
def _mask(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    opacity = reader.share(plugin, "opacity", 0.5)
    return Mask(reader.one_nested(plugin), opacity)


@_reads("blendbsdf")
def _blend(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    if not _is_given(plugin, "weight"):
        raise plugin.error(f'{plugin}: the parameter "weight" is missing')
    weight = reader.share(plugin, "weight", 0.5)
    found = plugin.take_nested("bsdf")
    if len(found) != 2:
        raise plugin.error(f"{plugin}: expected two nested bsdfs, got {len(found)}")
    return Blend(reader.read(found[0]), reader.read(found[1]), weight)


@_reads("bumpmap")
def _bump_map(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    height = reader.textures.take_texture(plugin)
    if height is None:
        raise plugin.error(f"{plugin}: expected one nested texture, of heights")
    scale = plugin.take_float("scale", 1.0)
    _bending_options(reader, plugin)
    return BumpMap(reader.one_nested(plugin), height, scale)


@_reads("normalmap")
def _normal_map(reader: BsdfReader, plugin: Plugin) -> Bsdf:
    normals = reader.textures.take_texture(plugin, "normalmap")
    if normals is None:
        raise plugin.error(f'{plugin}: the texture "normalmap" is missing')
    _bending_options(reader, plugin)
    return NormalMap(reader.one_nested(plugin), normals)


def _bending_options(reader: BsdfReader, plugin: Plugin) -> None:
    for name in ("flip_invalid_normals", "use_shadowing_function"):
        if not plugin.take_bool(name, True):
            line = plugin.element.line
            reader.warnings.append(f"line {line}: {plugin}: {name} cannot be switched off, and stays on")


@_reads("null")
def _null(_reader: BsdfReader, _plugin: Plugin) -> Bsdf:
    return Null()
