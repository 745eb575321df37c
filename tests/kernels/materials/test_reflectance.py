"""What diffuse parts reflect by irradiance and how much it grazes them, against their scattering functions, summed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bsdf_testing import Wide, direction, evaluate, grazing_gains, is_even, material, reflectances
from test_bsdf_coated import PLASTICS, PRINCIPLES, plastic, principled

from wdpm.kernels.materials.types import DIFFUSE

COSINES = (0.02, 0.1, 0.25, 0.5, 0.75, 1.0)
PLAIN = [name for name, values in PRINCIPLES.items() if not values.get("sheen") and not values.get("flatness")]


def summed(b: Any, cosine: float) -> Wide:
    """The diffuse part times the cosine, over all directions that light comes from, shape [3]."""
    nodes, weights = np.polynomial.legendre.leggauss(48)
    mu = (nodes + 1.0) / 2.0
    return np.asarray((weights * mu) @ by_rings(b, cosine, mu))


def by_rings(b: Any, cosine: float, mu: Wide) -> Wide:
    """The same of light at one cosine of mu and all azimuths alike, that brings irradiance pi, shape [mu, 3]."""
    phi, sine = (np.arange(128) + 0.5) * (2.0 * np.pi / 128), np.sqrt(1.0 - mu * mu)
    w_to = np.stack(
        [np.outer(sine, np.cos(phi)), np.outer(sine, np.sin(phi)), np.outer(mu, np.ones_like(phi))], axis=-1
    )
    w_from = direction(float(np.degrees(np.arccos(cosine))))
    value = evaluate(b, w_from, w_to.reshape(-1, 3)).diffuse.astype(np.float64).reshape(len(mu), len(phi), 3)
    return np.asarray(value.mean(axis=1) * np.pi)


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

    assert grazing_gains(b, direction(60.0))[0] == 0.0


RINGS = np.array([0.15, 0.3, 0.5, 0.75, 1.0])


def told_of_rings(b: Any, cosine: float) -> Wide:
    """What is told of light as of by_rings, by how much it grazes."""
    grazing = (1.0 - RINGS) ** 5 - 1.0 / 21.0
    gain = float(grazing_gains(b, direction(float(np.degrees(np.arccos(cosine)))))[0])
    return np.asarray(told(b, cosine) * (1.0 + gain * grazing)[:, None])


@pytest.mark.parametrize("cosine", [0.25, 0.5, 0.75, 1.0])
@pytest.mark.parametrize("name", [name for name, values in PLASTICS.items() if values["eta"] > 1.0])
def test_of_plastic_by_light_at_one_angle(name: str, cosine: float) -> None:
    """As if it came alike from all sides it would be up to six tenths off."""
    b = plastic(**PLASTICS[name])
    rings = by_rings(b, cosine, RINGS)
    off = np.abs(told_of_rings(b, cosine) / rings - 1.0).max()
    assert off < 0.06
    assert off < 0.6 * np.abs(told(b, cosine) / rings - 1.0).max()


@pytest.mark.parametrize("cosine", [0.25, 0.5, 0.75, 1.0])
@pytest.mark.parametrize("eta", [1.3, 1.5, 1.8])
def test_of_a_layered_base_by_light_at_one_angle(eta: float, cosine: float) -> None:
    """As if it came alike from all sides it would be up to a tenth off."""
    b = principled(layered=1.0, eta=eta)
    rings = by_rings(b, cosine, RINGS)
    np.testing.assert_allclose(told_of_rings(b, cosine), rings, rtol=0.025)


def test_what_irradiance_and_how_much_it_grazes_tell_of() -> None:
    """Not of cloth, which shines against the light, nor of Disney's base, which sends light back: they need directions.

    Nor of a coat that totally reflects light from beyond some angle.
    """
    assert is_even(principled(layered=1.0, roughness=0.8))
    assert not is_even(principled(layered=0.0, roughness=0.8))
    assert not is_even(principled(layered=1.0, sheen=0.5))
    for values in PLASTICS.values():
        assert is_even(plastic(**values)) == (values["eta"] > 1.0)


def test_nothing_is_reflected_behind() -> None:
    np.testing.assert_array_equal(reflectances(principled(), -direction(30.0)), 0.0)
