"""The diffuse part of `principled`: where it is not all metal or glass, in front.

Disney's diffuse lobe with retro-reflection, and the fake subsurface lobe (flatness), in the form that Mitsuba 3.9 gives
them (Burley 2012, section 5.3; Burley 2015). Or (layered) a Lambertian surface, lit by what the facets between two
directions do not reflect (glTF 2.0, appendix B). And sheen.
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.constants import INV_PI
from wdpm.kernels.materials.fresnel import fresnel_dielectric
from wdpm.kernels.materials.types import Bsdf
from wdpm.kernels.maths.schlick import schlick_weight

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def luminance(color: wp.vec3) -> wp.float32:
    """Of linear sRGB (ITU-R BT.709)."""
    return 0.212671 * color[0] + 0.715160 * color[1] + 0.072169 * color[2]


@wp.func
def tint(color: wp.vec3) -> wp.vec3:
    """A colour's hue at luminance 1; white for black."""
    y = luminance(color)
    if y > 0.0:
        return color / y
    return wp.vec3(1.0)


@wp.func
def brdf_share(b: Bsdf) -> wp.float32:
    """Strength of the diffuse part."""
    return (1.0 - b.metallic) * (1.0 - b.spec_trans)


@wp.func
def disney_strength(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3, half2: wp.float32) -> wp.float32:
    """Disney's diffuse lobe over that of a Lambertian surface.

    Args:
        half2: squared cosine between either direction and the half vector.
    """
    from_weight = schlick_weight(w_from[2])
    to_weight = schlick_weight(w_to[2])
    grazing = 2.0 * b.roughness * half2
    flat = (1.0 - 0.5 * from_weight) * (1.0 - 0.5 * to_weight)
    retro = grazing * (to_weight + from_weight + to_weight * from_weight * (grazing - 1.0))
    strength = flat + retro
    if b.flatness > 0.0:
        f90 = 0.5 * grazing - 1.0
        f = (1.0 + f90 * to_weight) * (1.0 + f90 * from_weight)
        subsurface = 1.25 * (f * (1.0 / (w_from[2] + w_to[2]) - 0.5) + 0.5)
        strength = strength + b.flatness * (subsurface - strength)
    return strength


@wp.func
def eval_diffuse(b: Bsdf, w_from: wp.vec3, w_to: wp.vec3) -> wp.vec3:
    """The diffuse part without the cosine [1/sr]."""
    share = brdf_share(b)
    if w_from[2] <= 0.0 or w_to[2] <= 0.0 or share <= 0.0:
        return wp.vec3(0.0)
    half2 = wp.clamp(0.5 + 0.5 * wp.dot(w_from, w_to), 0.0, 1.0)
    strength = wp.float32(0.0)
    if b.layered > 0.0:
        strength = 1.0 - fresnel_dielectric(wp.sqrt(half2), b.eta[0]).reflectance
    else:
        strength = disney_strength(b, w_from, w_to, half2)
    value = b.color * (share * strength * INV_PI)
    if b.sheen > 0.0:
        sheen = b.sheen * (1.0 - b.metallic) * schlick_weight(wp.sqrt(half2))
        color = wp.vec3(1.0)
        if b.sheen_tint > 0.0:
            color = color + (tint(b.color) - color) * b.sheen_tint
        value = value + color * sheen
    return value


@wp.func
def has_diffuse(b: Bsdf) -> bool:
    """Where it is not all metal or glass."""
    return b.metallic < 1.0 and b.spec_trans < 1.0


@wp.func
def is_even(b: Bsdf) -> bool:
    """Without sheen, which is brightest against the light, and Disney's lobe, which sends light back."""
    return b.layered > 0.0 and b.sheen <= 0.0


@wp.func
def schlick_between(cos: wp.float32) -> wp.float32:
    """Mean of Schlick's weight at the half vector, for one direction's cosine and diffuse light: a fit, to 1e-5."""
    a = wp.float32(0.00895193)
    a = a * cos - 0.04360492
    a = a * cos + 0.08641311
    a = a * cos - 0.07984127
    return a * cos + 0.02816349


@wp.func
def disney_mean(roughness: wp.float32, cos: wp.float32) -> wp.float32:
    """Mean of disney_strength without flatness over diffuse light, for one direction's cosine.

    With <.> for that mean, h for half2 and W for Schlick's weight of the light's direction: <W> = 1/21,
    <h> = 1/2 (1 + 2/3 cos), <h W> = 1/2 (1/21 + cos / 84), <h² W> = 1/4 (1/21 + cos / 42 + cos² / 252 + 11/504 sin²).
    """
    own = schlick_weight(cos)
    h = 0.5 + cos * (1.0 / 3.0)
    hw = 0.5 * (1.0 / 21.0) + cos * (1.0 / 168.0)
    h2w = 0.25 * (1.0 / 21.0 + cos * (1.0 / 42.0) + cos * cos * (1.0 / 252.0) + (1.0 - cos * cos) * (11.0 / 504.0))
    double = 2.0 * roughness
    flat = (1.0 - 0.5 * own) * (1.0 - 0.5 / 21.0)
    return flat + double * (hw + own * h) + own * double * (double * h2w - hw)


@wp.func
def reflectance_of_base(b: Bsdf, w_from: wp.vec3) -> wp.vec3:
    """What it reflects of light that comes alike from all sides, sheen and the subsurface lobe left out.

    For the layered one Fresnel's formulas are Schlick's approximation of them (1 % at grazing angles).
    """
    cos = w_from[2]
    share = brdf_share(b)
    if cos <= 0.0 or share <= 0.0:
        return wp.vec3(0.0)
    strength = wp.float32(0.0)
    if b.layered > 0.0:
        root = (b.eta[0] - 1.0) / (b.eta[0] + 1.0)
        strength = (1.0 - root * root) * (1.0 - schlick_between(cos))
    else:
        strength = disney_mean(b.roughness, cos)
    return b.color * (share * strength)


@wp.func
def schlick_between_slope(cos: wp.float32) -> wp.float32:
    """By how much the mean over all azimuths of Schlick's weight at the half vector grows with that of the light.

    That is the slope of the line that fits it best, over diffuse light, for one direction's cosine: itself a fit, to
    3e-4.
    """
    a = wp.float32(0.18749689)
    a = a * cos - 0.62882352
    a = a * cos + 0.78070093
    a = a * cos - 0.27496863
    a = a * cos - 0.24613398
    return a * cos + 0.18377548


@wp.func
def grazing_gain(b: Bsdf, w_from: wp.vec3) -> wp.float32:
    """By what share of reflectance_of_base a layered one reflects more for each unit by which light grazes more."""
    gain = wp.float32(0.0)
    if b.layered > 0.0:
        gain = -schlick_between_slope(w_from[2]) / (1.0 - schlick_between(w_from[2]))
    return gain
