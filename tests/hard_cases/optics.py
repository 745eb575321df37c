"""Closed formulas and quadratures that hard cases are measured against: none of them comes from wdpm."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

Array = NDArray[np.float64]


def fresnel(cosine: Any, eta: float) -> Array:
    """Reflectance of an interface for unpolarised light; eta: index ahead over that behind. 1 in total reflection."""
    c = np.asarray(cosine, np.float64)
    inside2 = 1.0 - (1.0 - c * c) / eta**2
    inside = np.sqrt(np.maximum(inside2, 0.0))
    s = (c - eta * inside) / (c + eta * inside)
    p = (inside - eta * c) / (inside + eta * c)
    return np.asarray(np.where(inside2 <= 0.0, 1.0, (s * s + p * p) / 2))


def slab_transmission(eta: float) -> float:
    """Of a slab at right angles, with all reflections within: (1 - R) / (1 + R) = 2 n / (n² + 1)."""
    return 2.0 * eta / (eta * eta + 1.0)


def beckmann_albedo(alpha: float, cosine: float, side: int = 800) -> float:
    """Share of light that a perfectly reflecting surface of Beckmann microfacets reflects once, by quadrature.

    Walter et al. 2007, equations 20, 25 and 27 (the rational fit of Smith's masking): the mean over visible normals of
    the masking of the outgoing direction; integrated over slopes, whose density is a gaussian.
    """
    x = (np.arange(side) + 0.5) / side * 10.0 - 5.0
    sx, sy = np.meshgrid(alpha * x, alpha * x)
    density = np.exp(-(sx**2 + sy**2) / alpha**2) / (np.pi * alpha**2) * (alpha * 10.0 / side) ** 2
    w = np.array([np.sqrt(1 - cosine**2), 0.0, cosine])
    m = np.stack([-sx, -sy, np.ones_like(sx)], axis=-1)
    length = np.linalg.norm(m, axis=-1)
    m /= length[..., None]
    c = np.maximum(m @ w, 0.0)
    out = 2.0 * c[..., None] * m - w
    # D(m) cos(m) dm is the density of slopes; a visible normal weighs masking(w) c / (cosine cos(m)).
    weight = density * masking(alpha, cosine) * c * length / cosine
    return float((weight * np.where(out[..., 2] > 0, masking(alpha, np.maximum(out[..., 2], 1e-9)), 0.0)).sum())


def masking(alpha: float, cosine: Any) -> Array:
    """Smith's masking of Beckmann microfacets, rational fit (Walter et al. 2007, equation 27)."""
    c = np.asarray(cosine, np.float64)
    a = c / (alpha * np.sqrt(np.maximum(1.0 - c * c, 1e-30)))
    return np.asarray(np.where(a < 1.6, (3.535 * a + 2.181 * a * a) / (1 + 2.276 * a + 2.577 * a * a), 1.0))


def h_function(albedo: float, cosines: Any, nodes: int = 200) -> Array:
    """Chandrasekhar's H of isotropic scattering (Radiative Transfer, 1950, chapter V), by iteration."""
    x, weight = leggauss(nodes)
    mu, weight = (x + 1) / 2, weight / 2
    h = np.ones(nodes)
    # 1 / H(mu) = sqrt(1 - albedo) + albedo / 2 * integral of mu' H(mu') / (mu + mu').
    root = np.sqrt(1.0 - albedo)
    for _ in range(5000):
        new = 1.0 / (root + albedo / 2 * ((weight * mu * h) / (mu[:, None] + mu)).sum(axis=1))
        if np.abs(new - h).max() < 1e-13:
            break
        h = (h + new) / 2  # else it swings where nothing is absorbed
    at = np.atleast_1d(np.asarray(cosines, np.float64))
    return np.asarray(1.0 / (root + albedo / 2 * ((weight * mu * h) / (at[:, None] + mu)).sum(axis=1)))


def reflected_by_half_space(albedo: float, cosine_in: float, cosine_out: float) -> float:
    """Radiance that a half space of a medium scatters back, of parallel light of irradiance 1 across its direction."""
    h_in, h_out = h_function(albedo, [cosine_in, cosine_out])
    return float(albedo / (4 * np.pi) * cosine_in / (cosine_in + cosine_out) * h_in * h_out)


def disk_irradiance(radius: float, height: float, aside: float) -> float:
    """Irradiance of a parallel disk of radiance 1 at a height, from its axis `aside` (Foote 1915)."""
    r2, h2, a2 = radius**2, height**2, aside**2
    return float(np.pi / 2 * (1 - (a2 + h2 - r2) / np.sqrt((a2 + h2 + r2) ** 2 - 4 * a2 * r2)))


def sphere_irradiance(radius: float, distance: float, cosine: float) -> float:
    """Irradiance of a sphere of radiance 1 wholly above the horizon."""
    return float(np.pi * (radius / distance) ** 2 * cosine)
