"""The beam radiance estimate: against a sum over all photons, over partitions, and against a medium evenly lit."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from beam_rig import (
    AXIS,
    PAD,
    RADIUS,
    SIGMA_T,
    SPLIT,
    UNIT,
    Floats,
    G,
    Photons,
    Stretches,
    add,
    sums,
    unit_vectors,
    upload,
)
from numpy.typing import NDArray

from wdpm.kernels.constants import EXACT_SUM_BITS
from wdpm.kernels.limits import MAX_VOLUME_PHOTONS
from wdpm.kernels.photons.beam import LEAST_INSIDE, sum_unit
from wdpm.kernels.rays import cells
from wdpm.scenes.errors import SettingsError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Wide = NDArray[np.float64]


def on_lattice(rng: np.random.Generator, values: Wide) -> Floats:
    """A part of the values moved to multiples of 1/4: on the planes of cells, at ends of beams, one on another."""
    moved = np.where(rng.random(values.shape) < 0.3, np.round(values * 4) / 4, values)
    return moved.astype(np.float32)


def random_photons(seed: int, count: int) -> Photons:
    rng = np.random.default_rng(seed)
    position = on_lattice(rng, rng.uniform(-1, 1, (count, 3)))
    flux = rng.uniform(0, 2, (count, 3)).astype(np.float32)
    return Photons(position, flux, rng.integers(0, 3, count), unit_vectors(rng, count))


def random_stretches(seed: int, count: int) -> Stretches:
    """Beams in all directions, some along axes and in the planes of cells, some infinite, empty or in no medium."""
    rng = np.random.default_rng(seed)
    origin = on_lattice(rng, rng.uniform(-1.2, 1.2, (count, 3)))
    direction = unit_vectors(rng, count)
    axes = np.eye(3, dtype=np.float32)[rng.integers(0, 3, count)] * rng.choice([-1, 1], (count, 1))
    direction = np.where(rng.random((count, 1)) < 0.4, axes, direction).astype(np.float32)
    length = on_lattice(rng, rng.uniform(0, 4, count))
    length[:5] = np.inf
    length[5:8] = 0.0
    number = rng.integers(0, 3, count).astype(np.int32)
    number[8:12] = -1
    return Stretches(origin, direction, length, number)


def brute_force(photons: Photons, s: Stretches, radius: float = RADIUS) -> tuple[Wide, NDArray[np.int64]]:
    """Radiance and number of photons of every beam, in float64, shapes [beams, 3] and [beams]."""
    position, back = photons.position.astype(np.float64), photons.direction.astype(np.float64)
    radiance = np.zeros((len(s.length), 3))
    counts = np.zeros(len(s.length), np.int64)
    for i, number in enumerate(s.medium):
        if number < 0:
            continue
        d = s.direction[i].astype(np.float64)
        to = position - s.origin[i].astype(np.float64)
        t = to @ d / (d @ d)
        distance2 = ((to - t[:, None] * d) ** 2).sum(axis=1)
        r2 = float(np.float32(radius)) ** 2
        near = (distance2 < r2) & (t >= 0) & (t < s.length[i]) & (photons.medium == number)
        g = float(G[number])
        cosine = (-back[near]) @ (-d)
        phase = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
        kernel = 3 / (np.pi * r2) * (1 - distance2[near] / r2) ** 2
        through = np.exp(-t[near, None] * SIGMA_T[number].astype(np.float64))
        radiance[i] = (photons.flux[near].astype(np.float64) * through * (phase * kernel)[:, None]).sum(axis=0)
        counts[i] = near.sum()
    return radiance, counts


@pytest.mark.parametrize("count", [0, 1, 7, 9, 65, 600, 6000])
def test_equals_the_sum_over_all_photons(count: int) -> None:
    photons, stretches = random_photons(count, count), random_stretches(100 + count, 200)
    beams = upload(stretches)
    add(beams, photons)
    exact, counts = brute_force(photons, stretches)
    assert count < 600 or counts.max() >= 5
    np.testing.assert_allclose(sums(beams) * UNIT, exact, rtol=3e-6, atol=UNIT * max(counts.max(), 1))
    assert not beams.clamped.numpy().any()


def test_parts_of_four_cells_add_up_to_the_whole() -> None:
    photons, stretches = random_photons(1, 6000), random_stretches(2, 400)
    whole = upload(stretches)
    add(whole, photons)
    low, high = cells.cell_boxes(AXIS, SPLIT)
    parts, without_ghosts = upload(stretches), upload(stretches)
    for cell in (2, 0, 3, 1):
        outside = np.maximum(np.maximum(low[cell] - photons.position, photons.position - high[cell]), 0.0)
        distance = np.linalg.norm(outside.astype(np.float64), axis=1)
        add(parts, photons.some(distance <= RADIUS + PAD), cell, (AXIS, SPLIT))
        add(without_ghosts, photons.some(distance == 0.0), cell, (AXIS, SPLIT))
    assert sums(whole).any(axis=1).sum() > 200
    np.testing.assert_array_equal(sums(parts), sums(whole))
    # The ghosts are what makes them equal: without, some beams are short of photons.
    assert (sums(without_ghosts) < sums(whole)).any()


def test_no_sum_of_all_photons_that_may_be_asked_for_exceeds_64_bits() -> None:
    """Each contributes at most 2^EXACT_SUM_BITS units; somewhat more are stored than were asked for."""
    assert 2 * MAX_VOLUME_PHOTONS * 2**EXACT_SUM_BITS <= 2**63


def test_order_of_photons_does_not_matter() -> None:
    photons, stretches = random_photons(3, 3000), random_stretches(4, 200)
    straight, shuffled = upload(stretches), upload(stretches)
    add(straight, photons)
    add(shuffled, photons.some(np.random.default_rng(5).permutation(3000)))
    np.testing.assert_array_equal(sums(shuffled), sums(straight))


def test_photons_out_of_reach_do_not_matter() -> None:
    """They make other trees, and larger paddings."""
    photons, stretches = random_photons(6, 3000), random_stretches(7, 200)
    stretches.length[:5] = 4.0
    alone, beside = upload(stretches), upload(stretches)
    add(alone, photons)
    far = random_photons(8, 2000)
    far.position[:, 0] += np.float32(5000.0)
    both = Photons(
        np.concatenate([far.position, photons.position]),
        np.concatenate([far.flux, photons.flux]),
        np.concatenate([far.medium, photons.medium]),
        np.concatenate([far.direction, photons.direction]),
    )
    add(beside, both)
    np.testing.assert_array_equal(sums(beside), sums(alone))


@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_far_from_the_origin_nothing_is_lost(scale: float) -> None:
    """Radii of a millionth of the coordinates, where float32 distances are rounded to a good part of the radius."""
    rng = np.random.default_rng(9)
    radius = np.float32(2e-6 * scale)
    direction = unit_vectors(rng, 50)
    direction[:25] = np.eye(3, dtype=np.float32)[rng.integers(0, 3, 25)]
    origin = (rng.uniform(-1, 1, (50, 3)) * scale).astype(np.float32)
    stretches = Stretches(origin, direction, np.full(50, scale, np.float32), np.zeros(50, np.int32))
    # Photons around the beams, as near as their coordinates' rounding lets them be, some just within the radius along
    # an axis, where boxes are narrowest; 16 in a place, so that boxes of leaves are points.
    on_beam = origin[:, None].astype(np.float64) + rng.uniform(0, 1, (50, 60, 1)) * scale * direction[:, None]
    aside = rng.normal(size=on_beam.shape) * radius / 2
    edge = np.eye(3)[rng.integers(0, 3, (50, 30))] * rng.choice([-1, 1], (50, 30, 1))
    aside[:, 30:] = edge * rng.uniform(0.9, 1.0, (50, 30, 1)) * radius
    position = (on_beam + aside).reshape(-1, 3).astype(np.float32)
    position = np.repeat(position, 16, axis=0)
    count = len(position)
    photons = Photons(position, np.ones((count, 3), np.float32), np.zeros(count, np.int64), unit_vectors(rng, count))
    unit = sum_unit(1.0, float(radius), 0.0)
    beams = upload(stretches)
    add(beams, photons, radius=float(radius), unit=unit, media=(SIGMA_T * 0, G))
    d = stretches.direction.astype(np.float64)
    expected = np.zeros(50)
    for i in range(50):
        to = position.astype(np.float64) - stretches.origin[i]
        along = to @ d[i] / (d[i] @ d[i])
        inside = 1 - ((to - along[:, None] * d[i]) ** 2).sum(axis=1) / float(radius) ** 2
        near = (inside > 0) & (along >= 0) & (along < stretches.length[i])
        expected[i] = (3 / (np.pi * float(radius) ** 2) * inside[near] ** 2).sum() / (4 * np.pi)
    assert (expected > 0).all()
    np.testing.assert_allclose(sums(beams)[:, 0] * unit, expected, rtol=1e-6)


def test_stretches_that_follow_each_other_share_no_photon() -> None:
    """Half-open: the photon beside the end of one is beside the beginning of the next, and counts there."""
    position = np.float32([[0, 0.1, 0], [0.5, 0, 0.1], [1, 0.1, 0], [1.5, 0, 0], [2, 0, 0]])
    photons = Photons(position, np.ones((5, 3), np.float32), np.zeros(5, np.int64), np.float32([[0, 0, 1]] * 5))
    along = np.float32([[1, 0, 0]] * 3)
    origin = np.float32([[0, 0, 0], [1, 0, 0], [0, 0, 0]])
    beams = upload(Stretches(origin, along, np.float32([1, 1, 2]), np.zeros(3, np.int32)))
    add(beams, photons, media=(SIGMA_T * 0, G))
    inside = np.array([1 - (0.1 / RADIUS) ** 2, 1.0]) ** 2 * 3 / (np.pi * RADIUS**2) / (4 * np.pi)
    np.testing.assert_allclose(sums(beams)[:, 0] * UNIT, inside @ [[2, 1, 3], [0, 1, 1]], rtol=1e-5)


def test_evenly_lit_medium() -> None:
    """Photons of flux F, n a volume, alike from all sides: radiance n F / 4 pi * integral of the transmittance."""
    rng = np.random.default_rng(10)
    count, half = 400000, 1.0
    photons = Photons(
        rng.uniform(-half, half, (count, 3)).astype(np.float32),
        np.broadcast_to(np.float32([1.0, 0.5, 2.0]), (count, 3)),
        np.zeros(count, np.int64),
        unit_vectors(rng, count),
    )
    # Beams that stay the radius away from the faces of the cube.
    stretches = Stretches(
        rng.uniform(-0.3, 0.3, (64, 3)).astype(np.float32),
        unit_vectors(rng, 64),
        np.full(64, 0.5, np.float32),
        np.zeros(64, np.int32),
    )
    for g in (0.0, 0.5):
        beams = upload(stretches)
        add(beams, photons, radius=0.1, unit=sum_unit(2.0, 0.1, g), media=(SIGMA_T, np.float32([g, 0, 0])))
        sigma = SIGMA_T[0].astype(np.float64)
        path = (1 - np.exp(-sigma * 0.5)) / sigma
        exact = count / (2 * half) ** 3 * np.array([1.0, 0.5, 2.0]) / (4 * np.pi) * path
        mean = sums(beams).mean(axis=0) * sum_unit(2.0, 0.1, g)
        # About 786 photons a beam, 64 beams that overlap: a standard deviation of some 0.7 %.
        np.testing.assert_allclose(mean, exact, rtol=0.025)


def test_contributions_too_large_for_the_unit_are_told() -> None:
    photons, stretches = random_photons(11, 600), random_stretches(12, 100)
    beams = upload(stretches)
    add(beams, photons, unit=UNIT * 2.0**-30)
    counts = brute_force(photons, stretches)[1]
    clamped = beams.clamped.numpy()
    assert clamped.sum() > 20
    assert (clamped <= counts).all()
    assert (sums(beams) <= counts[:, None] * 2**40).all()


@pytest.mark.parametrize(
    ("flux", "radius", "g"), [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, -1.0), (1.0, 1e-200, 0)]
)
def test_units_that_cannot_be(flux: float, radius: float, g: float) -> None:
    with pytest.raises(SettingsError, match="beams of radius"):
        sum_unit(flux, radius, g)


def test_the_unit_leaves_room_for_the_largest_contribution_and_no_more() -> None:
    for flux, radius, g in ((1.0, 0.1, 0.0), (3e7, 2.0, -0.95), (1e-20, 1e-3, 0.5)):
        peak = (1 - g * g) / (4 * np.pi * (1 - abs(g)) ** 3)
        largest = flux * peak * 3 / (np.pi * radius**2) / LEAST_INSIDE
        assert 1 < 2.0**40 * sum_unit(flux, radius, g) / largest <= 4
