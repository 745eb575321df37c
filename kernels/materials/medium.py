"""Participating media: what light loses on its way, where it collides, and where it goes from there.

A medium has an extinction coefficient sigma_t and an albedo by channel, and the Henyey-Greenstein phase function with
mean cosine g. Medium -1 is empty space. Distances are in scene units along a unit direction; where a medium's density
changes from place to place, optical lengths take their place (flights).

Free paths are sampled for one channel, chosen evenly, and weighted by the one-sample balance heuristic over all three
(Veach & Guibas 1995; over wavelengths: Wilkie et al. 2014, "Hero Wavelength Spectral Sampling"): no weight is above 3,
however much the channels differ.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.materials import grids
from wdpm.kernels.materials.grids import Grids
from wdpm.kernels.maths.directions import around
from wdpm.kernels.maths.elementary import exp_of, log1p_of, sincos_of
from wdpm.scenes.flat.arrays import Media as MediaTable

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NO_MEDIUM = wp.constant(-1)

_INF = wp.constant(wp.float32(math.inf))
_TWO_PI = wp.constant(wp.float32(2 * math.pi))
_INV_4_PI = wp.constant(wp.float32(0.25 / math.pi))
_BELOW_ONE = wp.constant(wp.float32(1 - 2.0**-24))
_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_THREE = wp.constant(wp.float64(3.0))


@wp.struct
class Media:
    """All media of a scene on a device, one an element."""

    sigma_t: wp.array[wp.vec3]  # extinction where the density is 1 [1 / scene units]
    albedo: wp.array[wp.vec3]  # the largest, where it lies in a grid
    g: wp.array[wp.float32]  # mean cosine of scattering
    density: wp.array[wp.int32]  # the grid of its density; -1: 1 everywhere
    albedo_grid: wp.array[wp.int32]  # the grid of its albedo, or -1
    grids: Grids


@wp.struct
class DistanceSample:
    """Where a path through a medium goes on.

    Attributes:
        t: distance to a collision; t_max where there is none.
        scatters: 1 at a collision, 0 where the path reached t_max.
        weight: by channel, of `scatter_weight` or `pass_weight`.
    """

    t: wp.float32
    scatters: wp.int32
    weight: wp.vec3


def upload(table: MediaTable, device: str) -> Any:
    """The media of a scene on a device.

    Returns:
        Media.
    """
    media = upload_homogeneous(table.sigma_t, table.albedo, table.g, device)
    media.density = wp.array(table.density_grid, dtype=wp.int32, device=device)
    media.albedo_grid = wp.array(table.albedo_grid, dtype=wp.int32, device=device)
    media.grids = grids.upload(table.grids, device)
    return media


def upload_homogeneous(
    sigma_t: NDArray[np.float32], albedo: NDArray[np.float32], g: NDArray[np.float32], device: str
) -> Any:
    """Homogeneous media on a device.

    Args:
        sigma_t: finite, 0 or at least 1e-30, shape [K, 3].
        albedo: in [0, 1], shape [K, 3].
        g: in (-1, 1), shape [K].

    Returns:
        Media.
    """
    media = Media()
    media.sigma_t = wp.array(sigma_t, dtype=wp.vec3, device=device)
    media.albedo = wp.array(albedo, dtype=wp.vec3, device=device)
    media.g = wp.array(g, dtype=wp.float32, device=device)
    media.density = wp.full(len(g), -1, dtype=wp.int32, device=device)
    media.albedo_grid = wp.full(len(g), -1, dtype=wp.int32, device=device)
    return media


@wp.func
def _transmitted(sigma_t: wp.float32, distance: wp.float32) -> wp.float32:
    """Beer-Lambert, of one channel. What is not there absorbs nothing, over an infinite distance either."""
    if sigma_t == 0.0:
        return 1.0
    return exp_of(-sigma_t * distance)


@wp.func
def _transmitted_channels(sigma_t: wp.vec3, distance: wp.float32) -> wp.vec3:
    """By channel, with one exponential for each that differs from those before it."""
    red = _transmitted(sigma_t[0], distance)
    green = red
    if sigma_t[1] != sigma_t[0]:
        green = _transmitted(sigma_t[1], distance)
    blue = green
    if sigma_t[2] != sigma_t[1]:
        blue = _transmitted(sigma_t[2], distance)
    return wp.vec3(red, green, blue)


@wp.func
def transmittance(media: wp.ref[Media], medium: wp.int32, distance: wp.float32) -> wp.vec3:
    """Share of light that gets through `distance` >= 0, which may be infinite; 1 in empty space."""
    if medium < 0:
        return wp.vec3(1.0)
    return _transmitted_channels(media.sigma_t[medium], distance)


@wp.func
def free_path_of(sigma_t: wp.float32, u_distance: wp.float32) -> wp.float32:
    """As free_path, of one channel."""
    if sigma_t == 0.0:
        return _INF
    return -log1p_of(-wp.min(u_distance, _BELOW_ONE)) / sigma_t


@wp.func
def free_path(media: wp.ref[Media], medium: wp.int32, u_channel: wp.float32, u_distance: wp.float32) -> wp.float32:
    """Distance to the next collision, were the medium endless; inf where there is none.

    Args:
        u_channel, u_distance: independent random numbers in [0, 1].
    """
    if medium < 0:
        return _INF
    return free_path_of(media.sigma_t[medium][wp.min(wp.int32(u_channel * 3.0), 2)], u_distance)


@wp.func
def _over_mean(weight: wp.vec3) -> wp.vec3:
    return weight / ((weight[0] + weight[1] + weight[2]) * wp.float32(1.0 / 3.0))


# In both weights the channel that `free_path` chose has at least e^-17 of its largest value: no mean is 0.


@wp.func
def scatter_weight(media: wp.ref[Media], medium: wp.int32, t: wp.float32) -> wp.vec3:
    """Weight of a collision at t, a distance that `free_path` gave: sigma_t times transmittance over its pdf.

    Its mean is the share of light that collides. Of that the albedo is scattered: it is not in the weight.
    """
    sigma_t = media.sigma_t[medium]
    return _over_mean(wp.cw_mul(sigma_t, _transmitted_channels(sigma_t, t)))


@wp.func
def pass_weight(media: wp.ref[Media], medium: wp.int32, t: wp.float32) -> wp.vec3:
    """Weight of reaching t, no further than the `free_path`, without a collision: transmittance over probability."""
    if medium < 0:
        return wp.vec3(1.0)
    return _over_mean(_transmitted_channels(media.sigma_t[medium], t))


@wp.func
def channel_of(share: wp.vec3, u: wp.float32) -> wp.int32:
    """One of the channels, chosen by its share.

    Args:
        share: not negative, of sum 1.
        u: random number in [0, 1).
    """
    if u < share[0]:
        return 0
    if u < share[0] + share[1] or share[2] == 0.0:
        return 1
    return 2


@wp.func
def over_shares(weight: wp.vec3, share: wp.vec3) -> wp.vec3:
    """One-sample balance heuristic over channels that were chosen by their shares; zero where none could have been."""
    chance = wp.dot(weight, share)
    if chance <= 0.0:
        return wp.vec3(0.0)
    return weight / chance


@wp.func
def scatter_weight_by(media: wp.ref[Media], medium: wp.int32, t: wp.float32, share: wp.vec3) -> wp.vec3:
    """As scatter_weight, where the channel was chosen by `share`."""
    sigma_t = media.sigma_t[medium]
    return over_shares(wp.cw_mul(sigma_t, _transmitted_channels(sigma_t, t)), share)


@wp.func
def pass_weight_by(media: wp.ref[Media], medium: wp.int32, t: wp.float32, share: wp.vec3) -> wp.vec3:
    """As pass_weight, where the channel was chosen by `share`."""
    return over_shares(_transmitted_channels(media.sigma_t[medium], t), share)


@wp.func
def phase_value(g: wp.float32, cosine: wp.float32) -> wp.float32:
    """Henyey & Greenstein 1941: the phase function, which is its own pdf_solid_angle.

    Args:
        g: mean cosine, -1 < g < 1; above 0 light goes on forwards.
        cosine: between the directions of propagation before and after.
    """
    size = wp.abs(g)
    # 1 + g² - 2 g cosine without cancellation.
    backward = wp.max(0.0, 1.0 - cosine)
    if g < 0.0:
        backward = wp.max(0.0, 1.0 + cosine)
    gap = 1.0 - size
    d = gap * gap + 2.0 * size * backward
    return _INV_4_PI * (gap * (1.0 + size)) / (d * wp.sqrt(d))


@wp.func
def phase_sample(g: wp.float32, direction: wp.vec3, u: wp.vec2) -> wp.vec3:
    """A direction of propagation after scattering, unit, with pdf_solid_angle = `phase_value`.

    The inverse of the cumulative distribution is written so that nothing is divided by g: with x = 2 u - 1,
    cosine = (x (1 + g²) + g (3 - g²) / 2 + g x² (1 + g²) / 2) / (1 + g x)²; in float64, as the sum cancels when |g| is
    close to 1.

    Args:
        g: mean cosine, -1 < g < 1.
        direction: of propagation before, unit.
        u: random numbers in [0, 1].
    """
    k = wp.float64(g)
    x = _TWO * wp.float64(u[0]) - _ONE
    k2 = k * k
    below = _ONE + k * x
    above = x * (_ONE + k2) + _HALF * k * ((_THREE - k2) + x * x * (_ONE + k2))
    cosine = wp.clamp(above / (below * below), -_ONE, _ONE)
    sine = wp.float32(wp.sqrt((_ONE - cosine) * (_ONE + cosine)))
    turn = sincos_of(_TWO_PI * u[1])
    return around(direction, wp.vec3(sine * turn[1], sine * turn[0], wp.float32(cosine)))
