"""Rough panes, by Mitsuba's `principledthin`, and how they are sampled."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bsdf_testing import (
    GGX,
    chi_square,
    direction,
    evaluate,
    integrate,
    material,
    mitsuba_values,
    random_directions,
    random_samples,
)

from wdpm.kernels.features import Features
from wdpm.kernels.materials.thin.rough_pane import ROUGH_PANE
from wdpm.kernels.materials.types import FLUX

FEATURES = Features(rough_pane=True)
COLOR = (0.9, 0.6, 0.3)


def pane(roughness: float, anisotropic: float = 0.0, eta: float = 1.5, spec_tint: float = 0.0) -> Any:
    """A rough pane as kernels read it."""

    def alpha(value: float) -> tuple[float, float]:
        aspect = np.sqrt(1 - 0.9 * anisotropic)
        return max(value**2 / aspect, 1e-3), max(value**2 * aspect, 1e-3)

    through = (*alpha((0.65 * eta - 0.35) * roughness), 0.0)
    return material(
        ROUGH_PANE, color=COLOR, alpha=alpha(roughness), k=through, eta=eta, spec_tint=spec_tint, distribution=GGX
    )


PANES = {
    "satin": {"roughness": 0.5},
    "smoother": {"roughness": 0.25, "eta": 1.33},
    "brushed": {"roughness": 0.6, "anisotropic": 0.8, "spec_tint": 0.7},
    "thinner": {"roughness": 0.7, "eta": 0.8, "spec_tint": 1.0},
}


@pytest.mark.parametrize("name", PANES)
def test_panes_are_those_of_principledthin(name: str) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    color = {"type": "rgb", "value": list(COLOR)}
    plugin = {"type": "principledthin", "base_color": color, "spec_trans": 1.0, **PANES[name]}
    w_from, w_to = random_directions(400, 1), random_directions(400, 2)
    value, _ = mitsuba_values(mi, plugin, w_from, w_to)
    ours = evaluate(pane(**PANES[name]), w_from, w_to, features=FEATURES)
    assert np.count_nonzero(value[:, 0] > 1e-4) > 150
    np.testing.assert_allclose(ours.all, value, rtol=1e-3, atol=2e-6)


@pytest.mark.parametrize("b", [pane(0.5), pane(0.6, 0.7, 1.3, 0.5)], ids=["satin", "brushed"])
@pytest.mark.parametrize("theta", [20.0, 160.0, 75.0])
def test_samples_have_their_density_and_weigh_by_it(b: Any, theta: float) -> None:
    w_from = direction(theta, 30.0)
    samples = random_samples(b, w_from, 1 << 15, 1, features=FEATURES)

    def pdf(w: np.ndarray) -> np.ndarray:
        return evaluate(b, w_from, w, features=FEATURES).pdf_all

    assert chi_square(samples.to, pdf) > 1e-4
    made = samples.pdf > 0
    values = evaluate(b, w_from, samples.to[made], features=FEATURES)
    np.testing.assert_allclose(samples.pdf[made], values.pdf_all, rtol=2e-3)
    np.testing.assert_allclose(samples.weight[made] * samples.pdf[made, None], values.all, rtol=2e-3, atol=1e-6)
    np.testing.assert_array_equal(samples.flags[made, 3] == 1, samples.to[made, 2] * w_from[2] < 0)


def test_no_light_is_made() -> None:
    """A white pane keeps all but what facets send to the wrong side."""
    for theta in (0.0, 50.0, 80.0):
        w_from = direction(theta)

        def value(w: np.ndarray, at: np.ndarray = w_from) -> np.ndarray:
            white = pane(0.5)
            white.color = type(white.color)(1.0, 1.0, 1.0)
            return evaluate(white, at, w, features=FEATURES).all

        kept = integrate(value).sum(axis=(0, 1))
        assert np.all(kept < 1.0 + 1e-3)
        assert np.all(kept > (0.95 if theta < 60 else 0.7))


@pytest.mark.parametrize("roughness", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("colour", [(1.0, 1.0, 1.0), (0.8, 0.1, 0.05)])
def test_rough_panes_do_not_swell_paths(colour: tuple[float, float, float], roughness: float) -> None:
    """Samples are shared out by what the lobes reflect and let through, also of light that grazes rough facets."""
    b = pane(roughness)
    b.color = type(b.color)(*colour)
    for theta in (0.0, 60.0, 80.0, 89.0):
        s = random_samples(b, direction(theta), 20000, 3, FLUX, features=FEATURES)
        assert (np.square(s.weight).mean(axis=0) < 1.1).all(), theta
