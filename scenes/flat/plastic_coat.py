"""What the coat of a plastic lets through: computed when a scene is loaded, so that kernels evaluate a few terms.

A plastic is a diffuse base under a dielectric interface (Mitsuba 3's `plastic` and `roughplastic`). Light crosses the
interface twice, and what the base scatters is partly reflected back by the interface from inside. Kernels need

* the transmittance T(mu) from outside, mu the cosine of the direction;
* the internal reflectance: the share of diffuse light that the interface reflects back to the base;
* the mean transmittance: the share of diffuse light from outside that gets to the base;
* the grazing gain: by what share of that more gets there for each unit by which light grazes more (it is less).

For a smooth interface T is 1 - F(mu) by Fresnel's equations, and the internal reflectance is a published fit. For a
rough one both are integrals over the visible normals of microfacets (Walter et al. 2007; masking is Smith's). They are
computed here in double; T is then fitted by

    T(mu) = c0 + c1 q + c2 q² + (1 - F(nu)) (c3 + c4 p + c5 p²)
    p = mu / (mu + alpha),  q = mu / (mu + 2 alpha),  nu = sqrt((mu² + alpha²) / (1 + alpha²))

whose error is at most 0.4 % of T (of 0.1, where T is less) for eta in [1.01, 3] and alpha up to 1, and 1 % for eta
still closer to 1. Where the coat is optically less dense than what is around it, light from outside is totally
reflected up to a cosine mu0, and

    T(mu) = c0 (1 - F(mu)) + s(x, w) (c1 + c2 mu) + c3 s(x, 3 w) + c4 s(x - w, w) + c5 s(x + w, w)
    mu0 = sqrt(1 - eta²),  x = mu - mu0,  w = alpha eta,  s(x, w) = 1/2 + 1/2 x / sqrt(x² + w²)

is off by up to 0.04.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.model.bsdfs import Distribution

Wide = NDArray[np.float64]

ALPHA_LEAST: Final = 1e-4
"""Least roughness that is not smooth; kernels/materials/microfacet.py has the same."""

_COSINES: Final = 64
"""Cosines at which T is known, and over which the internal reflectance is a mean: as many as Mitsuba's table has."""

_NODES: Final = 48
"""Nodes of the quadrature over visible normals along each of two axes."""

_REWEIGHTINGS: Final = 30
"""Of the fit by least squares: enough to bring the largest relative error to within a few per cent of the least."""

_SLOPES: Final = np.linspace(-4.5, 4.5, 4001)
"""Of Beckmann facets in units of alpha, along one axis; beyond lie 2e-10 of them."""

_BELOW: Final = np.array([math.erf(slope) for slope in _SLOPES])
"""Where facets of smaller slope end in [-1, 1]: interpolation inverts it to 1e-6."""


@dataclass(frozen=True)
class Coat:
    """A plastic's interface.

    Attributes:
        coefficients: c0 to c5 of the transmittance; zeros for a smooth interface, whose transmittance is Fresnel's.
        internal_reflectance: share of diffuse light from inside that is reflected back inside, in [0, 1).
        mean_transmittance: share of diffuse light from outside that is let through, in (0, 1].
        grazing_gain: slope of the line that fits T over Schlick's weight (1 - mu)^5 best, for diffuse light, over that
            mean. Where the coat is denser than what is around it T is within 0.02 of that line at cosines above 0.1.
    """

    coefficients: tuple[float, float, float, float, float, float]
    internal_reflectance: float
    mean_transmittance: float
    grazing_gain: float


@functools.cache
def coat(eta: float, alpha: float, distribution: Distribution) -> Coat:
    """The interface of a plastic.

    Args:
        eta: index of refraction inside over that outside, above 0.
        alpha: roughness; exactly 0 is smooth.
    """
    even = np.linspace(0.0, 1.0, _COSINES)
    dense = even * even if eta >= 1.0 else np.linspace(0.0, 1.0, 2 * _COSINES)  # where T bends: up to alpha, or at mu0
    if alpha == 0.0:
        through = 1.0 - _fresnel(np.maximum(dense, 1e-6), eta)[0]
        return Coat((0.0,) * 6, diffuse_reflectance(1.0 / eta), _mean(through, dense), _gain(through, dense))
    alpha = max(alpha, ALPHA_LEAST)
    transmitted = rough_transmittance(eta, alpha, distribution, dense)
    reflected = rough_reflectance(1.0 / eta, alpha, distribution, even)
    # The mean over the nodes, not the integral (which is 1 to 2 % more): what Mitsuba does, and colours depend on it.
    internal = 2.0 * float(np.mean(reflected * even))
    c0, c1, c2, c3, c4, c5 = (float(c) for c in _fit(terms(dense, eta, alpha), transmitted, 0.1 if eta >= 1.0 else 1.0))
    return Coat((c0, c1, c2, c3, c4, c5), internal, _mean(transmitted, dense), _gain(transmitted, dense))


def _mean(transmittance: Wide, mu: Wide) -> float:
    """Of diffuse light: weighted by the cosines mu, ascending from 0 to 1."""
    weighted = transmittance * mu
    return float(np.sum((weighted[1:] + weighted[:-1]) * np.diff(mu)))  # the trapezoidal rule, twice


def _gain(transmittance: Wide, mu: Wide) -> float:
    """By which a line rises with Schlick's weight that fits the transmittance of diffuse light best, over its mean."""
    schlick = (1.0 - mu) ** 5
    mean, among = _mean(transmittance, mu), _mean(schlick, mu)
    slope = (_mean(transmittance * schlick, mu) - mean * among) / (_mean(schlick * schlick, mu) - among * among)
    return slope / mean


def diffuse_reflectance(eta: float) -> float:
    """Reflectance of a smooth interface for diffuse light from outside.

    Sources: Egan & Hilgeman 1973 below 1 (within 1 % down to 0.4), d'Eon & Irving 2011 above.
    """
    if eta < 1.0:
        return -1.4399 * eta * eta + 0.7099 * eta + 0.6681 + 0.0636 / eta
    r = 1.0 / eta
    return 0.919317 + r * (-3.4793 + r * (6.75335 + r * (-7.80989 + r * (4.98554 - r * 1.36881))))


def terms(mu: Wide, eta: float, alpha: float) -> Wide:
    """The functions whose sum, weighted by the coefficients, is T(mu). Shape [N, 6] for mu of shape [N]."""
    if eta < 1.0:
        w = alpha * eta
        x = mu - np.sqrt(1.0 - eta * eta)
        steps = (_step(x, w), _step(x, w) * mu, _step(x, 3.0 * w), _step(x - w, w), _step(x + w, w))
        return np.stack([1.0 - _fresnel(np.maximum(mu, 1e-6), eta)[0], *steps], axis=1)
    p = mu / (mu + alpha)
    q = mu / (mu + 2.0 * alpha)
    nu = np.sqrt((mu * mu + alpha * alpha) / (1.0 + alpha * alpha))
    through = 1.0 - _fresnel(nu, eta)[0]
    return np.stack([np.ones_like(mu), q, q * q, through, through * p, through * p * p], axis=1)


def _step(x: Wide, width: float) -> Wide:
    """From 0 to 1 around x = 0."""
    return 0.5 + 0.5 * x / np.sqrt(x * x + width * width)


def rough_reflectance(eta: float, alpha: float, distribution: Distribution, mu: Wide) -> Wide:
    """Share of light that a rough dielectric interface reflects; some is lost between its facets.

    Args:
        eta: index of refraction beyond over that on the side where light comes from.
        mu: cosines of the direction of light, in [0, 1], shape [N].

    Returns:
        Shape [N].
    """
    w, m, weight = _facets(alpha, distribution, mu)
    cos = np.sum(w * m, axis=0)
    mirrored = 2.0 * cos * m - w
    back = np.where(mirrored[2] > 0.0, _masking(alpha, distribution, mirrored, m), 0.0)
    return np.asarray(np.sum(weight * _fresnel(cos, eta)[0] * back, axis=1))


def rough_transmittance(eta: float, alpha: float, distribution: Distribution, mu: Wide) -> Wide:
    """The share that gets through; arguments as of rough_reflectance."""
    w, m, weight = _facets(alpha, distribution, mu)
    cos = np.sum(w * m, axis=0)
    reflectance, cos_beyond = _fresnel(cos, eta)
    refracted = m * (cos / eta - cos_beyond) - w / eta
    through = np.where(refracted[2] < 0.0, _masking(alpha, distribution, refracted, m), 0.0)
    return np.asarray(np.sum(weight * (1.0 - reflectance) * through, axis=1))


def _facets(alpha: float, distribution: Distribution, mu: Wide) -> tuple[Wide, Wide, Wide]:
    """The directions of light, shape [3, N, 1], and the normals and weights of the facets that are seen from there."""
    mu = np.maximum(mu, 1e-6)[:, None]
    m, weight = _visible_normals(alpha, distribution, mu)
    return np.stack([np.sqrt(1.0 - mu * mu), np.zeros_like(mu), mu]), m, weight


def _fresnel(cos: Wide, eta: float) -> tuple[Wide, Wide]:
    """Reflectance for cosines >= 0 on the side of index 1, and the cosine beyond: 0 in total reflection."""
    squared = 1.0 - (1.0 - cos * cos) / (eta * eta)
    beyond = np.sqrt(np.maximum(squared, 0.0))
    sums = np.stack([cos + eta * beyond, eta * cos + beyond])
    parts = np.stack([cos - eta * beyond, eta * cos - beyond]) / np.maximum(sums, 1e-300)
    return np.where(squared <= 0.0, 1.0, 0.5 * np.sum(parts * parts, axis=0)), beyond


def _masking(alpha: float, distribution: Distribution, v: Wide, m: Wide) -> Wide:
    """Smith's G1; for Beckmann facets the rational fit of Walter et al. 2007, as in kernels/materials/microfacet.py."""
    cos = np.abs(v[2])
    sine = alpha * np.sqrt(v[0] * v[0] + v[1] * v[1])
    if distribution is Distribution.GGX:
        seen = 2.0 * cos / (cos + np.sqrt(cos * cos + sine * sine))
    else:
        a = cos / np.maximum(sine, 1e-300)
        a = np.minimum(a, 1.6)
        seen = np.where(a >= 1.6, 1.0, (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a))
    return np.where(np.sum(v * m, axis=0) * v[2] > 0.0, seen, 0.0)


def _visible_normals(alpha: float, distribution: Distribution, mu: Wide) -> tuple[Wide, Wide]:
    """A quadrature of the microfacets that are seen from (sqrt(1 - mu²), 0, mu).

    Args:
        mu: shape [N, 1].

    Returns:
        Unit normals, shape [3, N, M], and weights that sum to 1, shape [N, M].
    """
    node, weight = np.polynomial.legendre.leggauss(_NODES)
    first, second = (axis.ravel() for axis in np.meshgrid(0.5 * (node + 1.0), 0.5 * (node + 1.0)))
    area = np.outer(weight, weight).ravel() / 4.0
    sine = np.sqrt(1.0 - mu * mu)
    if distribution is Distribution.GGX:
        # Half vectors of the direction and the points of a cap of the sphere, stretched (Dupuy & Benyoub 2023). Facets
        # lie alike on both sides of the plane of incidence: half the circle does.
        length = np.sqrt((alpha * sine) ** 2 + mu * mu)
        x, z = alpha * sine / length, mu / length
        height = (1.0 - first) * (1.0 + z) - z
        ring = np.sqrt(np.maximum(0.0, 1.0 - height * height))
        turn = np.pi * second
        m = np.stack([alpha * (ring * np.cos(turn) + x), alpha * ring * np.sin(turn), np.maximum(height + z, 1e-12)])
        share = np.broadcast_to(area, height.shape)
    else:
        # Slopes along and across the plane of incidence, in units of alpha; those beyond mu / sine face away.
        last = np.interp(mu / np.maximum(alpha * sine, 1e-300), _SLOPES, _BELOW)
        along = np.interp((1.0 + last) * first - 1.0, _BELOW, _SLOPES)
        across = np.interp(second, _BELOW, _SLOPES)
        m = np.stack([-alpha * along, np.broadcast_to(-alpha * across, along.shape), np.ones_like(along)])
        share = area * np.maximum(mu - alpha * sine * along, 0.0)
        share = share / np.sum(share, axis=1, keepdims=True)
    return m / np.sqrt(np.sum(m * m, axis=0)), share


def _fit(functions: Wide, wanted: Wide, floor: float) -> Wide:
    """Coefficients with about the least possible largest error, relative to what is wanted (or to floor, below it)."""
    scale = 1.0 / np.maximum(wanted, floor)
    weight = scale
    best: Wide = np.zeros(functions.shape[1])
    least = np.inf
    for _ in range(_REWEIGHTINGS):
        c: Wide = np.linalg.lstsq(functions * weight[:, None], wanted * weight, rcond=1e-7)[0].astype(np.float64)
        error = np.abs(functions @ c - wanted) * scale
        largest = float(np.max(error))
        if largest < least:
            best, least = c, largest
        if largest == 0.0:
            break
        weight = weight * (error / largest + 0.03) ** 0.3
    return best
