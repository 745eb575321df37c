"""How noisy images are expected to be, by what each pixel of a trial sees."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.cluster.plan.path_caustics import NO_CAUSTICS
from wdpm.cluster.plan.small_view import Figures, SeenPlaces
from wdpm.cluster.plan.trial.figures import GATHERED, Trial
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings

NOISE, OF_DIRECT = 0.4, 0.03
"""Of indirect light by paths, and of what photon mapping finds without its maps, a sample."""


def trial_of(noises: list[float], uneven: list[float]) -> Trial:
    """One of pixels in a row, by the noise of indirect light in each and the part that records do not serve."""
    settings = RenderSettings(integrator=Integrator.PHOTONS)
    by_photons = Figures(settings, OF_DIRECT, of_indirect=0.0, vertices=0.0, light_samples=1, indirect=0.0)
    by_paths = Figures(settings, NOISE + OF_DIRECT, of_indirect=NOISE, vertices=0.0, light_samples=1, indirect=0.1)
    row = np.array([noises])
    each = (np.full_like(row, OF_DIRECT), row + OF_DIRECT, row)
    return Trial(by_photons, by_paths, NO_CAUSTICS, 0.5, 0.0, (None, None), 0.0, 0.0, each, np.array([uneven]))


@pytest.mark.parametrize(
    ("noises", "uneven", "share"),
    [([1.0, 1.0], [1.0, 0.0], 0.5), ([0.0, 1.0], [1.0, 0.0], 0.0), ([1.0, 0.0], [1.0, 0.0], 1.0)],
    ids=["alike", "a dark floor has the coat", "only what has a coat is noisy"],
)
def test_gather_rays_make_noise_where_no_record_serves(noises: list[float], uneven: list[float], share: float) -> None:
    """Not in proportion to how much is seen of it."""
    trial = trial_of(noises, uneven)
    cache, gather, by_map = (
        RenderSettings(integrator=Integrator.PHOTONS, indirect=way)
        for way in (Indirect.CACHE, Indirect.GATHER, Indirect.MAP)
    )
    assert trial.noise_by(cache) == pytest.approx(OF_DIRECT + share * GATHERED * NOISE, rel=1e-2, abs=1e-3)
    assert trial.noise_by(gather) == pytest.approx(OF_DIRECT + GATHERED * NOISE)
    assert trial.noise_by(by_map) == OF_DIRECT
    expected = OF_DIRECT + np.array([uneven]) * GATHERED * np.array([noises])
    np.testing.assert_allclose(trial.noises_by(cache), expected)


def test_of_each_pixel_it_is_known_what_records_serve() -> None:
    places, white, dark = SeenPlaces(), np.full(3, 0.8, np.float32), np.full(3, 0.2, np.float32)
    found = {
        "position": np.zeros((4, 3), np.float32),
        "normal": np.zeros((4, 3), np.float32),
        "weight": np.stack([white, dark, dark, white]),
        "even": np.array([True, False, False, True]),
        "pixel": np.array([0, 0, 1, 3], np.int32),
        "sample": np.zeros(4, np.int32),
    }
    keep(places, found)
    np.testing.assert_allclose(places.uneven((2, 2)), [[0.2, 1.0], [0.0, 0.0]], rtol=1e-6)


def keep(places: SeenPlaces, found: dict[str, NDArray[np.generic]]) -> None:
    """As an observer of camera paths does."""
    places._found.append(found)
