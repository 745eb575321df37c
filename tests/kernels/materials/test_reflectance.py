"""What diffuse parts reflect of light that comes alike from all sides, against their scattering functions, summed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bsdf_testing import Wide, direction, evaluate, is_even, material, reflectances
from test_bsdf_coated import PLASTICS, PRINCIPLES, plastic, principled

from wdpm.kernels.materials.types import DIFFUSE

COSINES = (0.02, 0.1, 0.25, 0.5, 0.75, 1.0)
PLAIN = [name for name, values in PRINCIPLES.items() if not values.get("sheen") and not values.get("flatness")]


def summed(b: Any, cosine: float) -> Wide:
    """The diffuse part times the cosine, over all directions that light comes from, shape [3]."""
    nodes, weights = np.polynomial.legendre.leggauss(48)
    mu, phi = (nodes + 1.0) / 2.0, (np.arange(128) + 0.5) * (2.0 * np.pi / 128)
    sine = np.sqrt(1.0 - mu * mu)
    w_to = np.stack(
        [np.outer(sine, np.cos(phi)), np.outer(sine, np.sin(phi)), np.outer(mu, np.ones_like(phi))], axis=-1
    )
    w_from = direction(float(np.degrees(np.arccos(cosine))))
    value = evaluate(b, w_from, w_to.reshape(-1, 3)).diffuse.astype(np.float64).reshape(len(mu), len(phi), 3)
    return np.asarray(np.einsum("i,ijc->c", weights / 2.0 * mu, value) * (2.0 * np.pi / 128))


def told(b: Any, cosine: float) -> Wide:
    return reflectances(b, direction(float(np.degrees(np.arccos(cosine))))).astype(np.float64)[0]


@pytest.mark.parametrize("cosine", COSINES)
@pytest.mark.parametrize("name", PLASTICS)
def test_of_plastic(name: str, cosine: float) -> None:
    """To the error of the fits of a coat's transmittance, 0.4 %, or 0.04 where light is totally reflected."""
    b = plastic(**PLASTICS[name])
    error = 0.06 if PLASTICS[name]["eta"] < 1.0 else 0.01
    np.testing.assert_allclose(told(b, cosine), summed(b, cosine), rtol=error, atol=1e-4)


@pytest.mark.parametrize("cosine", COSINES)
@pytest.mark.parametrize("name", PLAIN)
def test_of_principled(name: str, cosine: float) -> None:
    """To the error of Schlick's approximation, where Fresnel's formulas are not its own."""
    b = principled(**PRINCIPLES[name])
    np.testing.assert_allclose(told(b, cosine), summed(b, cosine), rtol=0.013, atol=1e-6)


@pytest.mark.parametrize("roughness", [0.05, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("layered", [0.0, 1.0])
def test_of_principled_however_rough(layered: float, roughness: float) -> None:
    for eta in (1.2, 1.5, 2.0):
        b = principled(roughness=roughness, layered=layered, eta=eta)
        for cosine in COSINES:
            np.testing.assert_allclose(
                told(b, cosine), summed(b, cosine), rtol=0.013 if layered else 1e-4, err_msg=f"{eta} {cosine}"
            )


def test_of_a_lambertian_surface_it_is_the_albedo() -> None:
    b = material(DIFFUSE, color=(0.7, 0.4, 0.1))
    np.testing.assert_array_equal(reflectances(b, direction(60.0))[0], np.float32([0.7, 0.4, 0.1]))
    assert is_even(b)


def test_irradiance_tells_of_a_lambertian_base_under_gloss_alone() -> None:
    """Disney's base is 1 to 2 % off in the Cornell box, cloth more where light comes from behind it."""
    assert is_even(principled(layered=1.0, roughness=0.8))
    assert not is_even(principled(layered=0.0, roughness=0.8))
    assert not is_even(principled(layered=1.0, sheen=0.5))


def test_nor_is_what_a_coat_lets_through() -> None:
    """A hall whose only light comes from low down would be half as bright again."""
    assert not any(is_even(plastic(**values)) for values in PLASTICS.values())


def test_nothing_is_reflected_behind() -> None:
    np.testing.assert_array_equal(reflectances(principled(), -direction(30.0)), 0.0)
