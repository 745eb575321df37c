"""glTF's material against the formulas of its specification (glTF 2.0, appendix B), written down anew."""

from __future__ import annotations

import numpy as np
import pytest
from bsdf_testing import GGX, direction, evaluate, material, random_directions
from numpy.typing import NDArray

from wdpm.kernels.materials.principled import PRINCIPLED

Array = NDArray[np.float64]


def layered(color: float | tuple[float, ...], roughness: float, metallic: float = 0.0, eta: float = 1.5) -> object:
    alpha = max(roughness**2, 1e-3)
    return material(
        PRINCIPLED,
        color=color,
        layered=1.0,
        roughness=roughness,
        alpha=alpha,
        metallic=metallic,
        eta=eta,
        distribution=GGX,
    )


def half_cosine(a: Array, b: Array) -> Array:
    """Between a direction and the half vector."""
    half = (a + b) / np.linalg.norm(a + b, axis=1, keepdims=True)
    return np.einsum("ij,ij->i", a, half)


def schlick(f0: Array | float, cosine: Array) -> Array:
    return f0 + (1.0 - f0) * (1.0 - cosine) ** 5


def fresnel(eta: float, cosine: Array) -> Array:
    """Reflectance of an interface, by the tangent and sine laws."""
    inside = np.sqrt(1.0 - (1.0 - cosine**2) / eta**2)
    across = (cosine - eta * inside) / (cosine + eta * inside)
    along = (eta * cosine - inside) / (eta * cosine + inside)
    return 0.5 * (across**2 + along**2)


def of_specification(color: Array, roughness: float, metallic: float, eta: float, a: Array, b: Array) -> Array:
    """Appendix B.3: scattering functions of a dielectric and a metal, mixed, times the cosine, shape [N, 3].

    With Fresnel's formulas for the dielectric, which Schlick's approximation there is one of.
    """
    alpha2 = roughness**4
    half = (a + b) / np.linalg.norm(a + b, axis=1, keepdims=True)
    distribution = alpha2 / (np.pi * (half[:, 2] ** 2 * (alpha2 - 1.0) + 1.0) ** 2)

    def masked(w: Array) -> Array:
        return 2.0 * w[:, 2] / (w[:, 2] + np.sqrt(alpha2 + (1.0 - alpha2) * w[:, 2] ** 2))

    specular = distribution * masked(a) * masked(b) / (4.0 * a[:, 2] * b[:, 2])
    cosine = half_cosine(a, b)
    mirrored = fresnel(eta, cosine)[:, None]
    dielectric = (1.0 - mirrored) * color / np.pi + mirrored * specular[:, None]
    metal = schlick(color[None, :], cosine[:, None]) * specular[:, None]
    return ((1.0 - metallic) * dielectric + metallic * metal) * b[:, 2:]


def above(count: int, seed: int) -> Array:
    w = random_directions(count, seed).astype(np.float64)
    w[:, 2] = np.maximum(np.abs(w[:, 2]), 0.05)
    unit: Array = w / np.linalg.norm(w, axis=1, keepdims=True)
    return unit


@pytest.mark.parametrize("metallic", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
def test_it_is_what_the_specification_says(roughness: float, metallic: float) -> None:
    color = np.array([0.7, 0.4, 0.1])
    a, b = above(2000, 3), above(2000, 4)
    got = evaluate(layered(tuple(color), roughness, metallic), a.astype(np.float32), b.astype(np.float32)).all
    expected = of_specification(color, roughness, metallic, 1.5, a, b)
    np.testing.assert_allclose(got, expected, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("roughness", [0.1, 1.0])
def test_its_diffuse_part_is_lambertian_under_gloss(roughness: float) -> None:
    """However rough: Disney's is up to 1.4 times that at grazing angles where the surface is rough."""
    a, b = above(500, 5), above(500, 6)
    got = evaluate(layered(0.8, roughness), a.astype(np.float32), b.astype(np.float32)).diffuse
    expected = 0.8 / np.pi * (1.0 - fresnel(1.5, half_cosine(a, b)))
    np.testing.assert_allclose(got[:, 0], expected, rtol=1e-4)


def test_what_it_reflects_at_grazing_angles_is_no_more_than_disneys() -> None:
    """Of white surfaces that are rough, which reflect more than they get there in Disney's form."""
    a = np.repeat(direction(80.0)[None, :], 4000, axis=0).astype(np.float32)
    b = above(4000, 7).astype(np.float32)
    ours = evaluate(layered(1.0, 1.0), a, b).all.mean()
    disneys = evaluate(material(PRINCIPLED, color=1.0, roughness=1.0, alpha=1.0, distribution=GGX), a, b).all.mean()
    assert ours < 0.9 * disneys
