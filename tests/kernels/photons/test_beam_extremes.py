"""Beams whose radius is hardly more than the rounding of a coordinate: photon by photon."""

from __future__ import annotations

import numpy as np
import pytest
from beam_rig import SIGMA_T, G, Photons, Stretches, add, sums, unit_vectors, upload

from wdpm.kernels.photons.beam import sum_unit

BEAMS = 4000


@pytest.mark.parametrize("radius", [3e-7, 1e-6, 1e-5])
def test_every_photon_within_reach_is_found(radius: float) -> None:
    """Each beam has one photon of its own, up to its very edge; float32 alone does not know how far off it is."""
    rng = np.random.default_rng(1)
    direction = unit_vectors(rng, BEAMS)
    origin = rng.uniform(-1, 1, (BEAMS, 3)).astype(np.float32)
    stretches = Stretches(origin, direction, np.full(BEAMS, 2.0, np.float32), np.zeros(BEAMS, np.int32))
    d = direction.astype(np.float64)
    along = rng.uniform(0.5, 1.5, (BEAMS, 1))
    aside = np.cross(d, rng.normal(size=(BEAMS, 3)))
    aside *= radius * rng.uniform(0.0, 1.0, (BEAMS, 1)) / np.linalg.norm(aside, axis=1, keepdims=True)
    position = (origin + along * d + aside).astype(np.float32)
    to = position.astype(np.float64) - origin
    t = (to * d).sum(axis=1, keepdims=True) / (d * d).sum(axis=1, keepdims=True)
    distance = np.linalg.norm(to - t * d, axis=1)
    photons = Photons(position, np.ones((BEAMS, 3), np.float32), np.zeros(BEAMS, np.int64), unit_vectors(rng, BEAMS))
    beams = upload(stretches)
    add(beams, photons, radius=radius, unit=sum_unit(1.0, radius, 0.0), media=(SIGMA_T * 0, G))
    found = sums(beams)[:, 0] > 0
    sure = 0.999 * np.float64(np.float32(radius))  # next to the edge a contribution rounds to nothing
    assert (distance < sure).sum() > BEAMS / 10
    np.testing.assert_array_equal(found[distance < sure], True)
