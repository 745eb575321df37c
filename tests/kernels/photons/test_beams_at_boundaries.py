"""Beams near where their medium ends: discs that reach out of it find no photons there, and are not darker for it."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from beam_rig import Floats, Photons, Stretches, add, sums, upload
from numpy.typing import NDArray

from wdpm.kernels.photons.beam import LEAST_INSIDE, share_inside, sum_unit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

CLEAR = (np.zeros((1, 3), np.float32), np.zeros(1, np.float32))
"""A medium that takes nothing away and scatters evenly."""


@wp.kernel
def shares(
    direction: wp.array[wp.vec3],
    start: wp.array[wp.vec3],
    end: wp.array[wp.vec3],
    length: wp.float64,
    t: wp.array[wp.float64],
    share_out: wp.array[wp.float64],
) -> None:
    i = wp.tid()
    share_out[i] = share_inside(direction[i], start[i], end[i], length, t[i], wp.float64(1.0))


def shares_of(direction: object, start: object, end: object, length: float, t: object) -> NDArray[np.float64]:
    """With a radius of 1."""
    places = np.atleast_1d(np.asarray(t, np.float64))
    vectors = [np.tile(np.asarray(v, np.float32), (len(places), 1)) for v in (direction, start, end)]
    arrays = [wp.array(v, dtype=wp.vec3, device="cpu") for v in vectors]
    found = wp.zeros(len(places), dtype=wp.float64, device="cpu")
    on = wp.array(places, dtype=wp.float64, device="cpu")
    wp.launch(shares, dim=len(places), inputs=[*arrays, length, on, found], device="cpu")
    return np.asarray(found.numpy())


NONE = (0.0, 0.0, 0.0)
X, Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
ALONG = (0.6, 0.0, 0.8)
"""From a floor, whose normal is z, up and to the right: at t it is 0.8 t high, and the plane cuts its disc at 4/3 t."""


def test_discs_that_nothing_cuts_are_whole() -> None:
    assert shares_of(Z, NONE, NONE, 5.0, [0.0, 1.0, 5.0]).tolist() == [1.0, 1.0, 1.0]
    assert shares_of(Z, Z, (0.0, 0.0, -1.0), 5.0, [0.0, 2.5, 5.0]).tolist() == [1.0, 1.0, 1.0]
    assert shares_of(ALONG, Z, NONE, np.inf, [0.75, 3.0]) == pytest.approx([1.0, 1.0], abs=1e-4)


def test_a_disc_that_a_plane_cuts_has_the_kernel_on_its_inner_side() -> None:
    t = np.linspace(0.0, 0.75, 16)
    y = np.linspace(-1.0, 1.0, 200_001)
    across = (16 / (5 * np.pi)) * (1 - y**2) ** 2.5  # the biweight kernel, summed up along lines
    expected = [across[y <= 4 / 3 * each].sum() * (y[1] - y[0]) for each in t]
    np.testing.assert_allclose(shares_of(ALONG, Z, NONE, 9.0, t), expected, atol=1e-4)


def test_what_is_cut_is_bounded() -> None:
    flat = (0.999, 0.0, np.sqrt(1 - 0.999**2))
    opposite = (0.0, 0.0, -1.0)
    found = shares_of(flat, Z, opposite, 1.0, np.linspace(0.0, 1.0, 11))
    assert found.min() == LEAST_INSIDE
    assert found.max() < 0.6


def filled(inside: NDArray[np.bool_], position: Floats, volume: float) -> Photons:
    """Photons of which each has its share of the light of a volume."""
    some = position[inside]
    flux = np.full((len(some), 3), volume / len(position), np.float32)
    back = np.tile(np.array([[0.0, 0.0, 1.0]], np.float32), (len(some), 1))
    return Photons(some, flux, np.zeros(len(some), np.int64), back)


def radiance(photons: Photons, stretches: Stretches, radius: float) -> NDArray[np.float64]:
    """Red, of all beams; of even light it is their length / 4 pi."""
    unit = sum_unit(float(photons.flux.max()), radius, 0.0)
    beams = upload(stretches)
    add(beams, photons, radius=radius, unit=unit, media=CLEAR)
    assert not beams.clamped.numpy().any()
    return np.asarray(sums(beams)[:, 0] * unit)


def test_even_light_in_a_slab_is_even_for_beams_of_all_slopes() -> None:
    """The slab is 0 <= z <= 0.3, and the radius a third of that."""
    rng = np.random.default_rng(1)
    position = rng.uniform((-2, -2, 0), (2, 2, 0.3), (800_000, 3)).astype(np.float32)
    photons = filled(np.ones(len(position), np.bool_), position, 16 * 0.3)
    rise = np.repeat(np.cos(np.radians([0.0, 30.0, 60.0, 75.0])), 100)
    turn = rng.uniform(0, 2 * np.pi, len(rise))
    side = np.sqrt(1 - rise**2)
    direction = np.stack([side * np.cos(turn), side * np.sin(turn), rise], axis=1).astype(np.float32)
    origin = np.concatenate([rng.uniform(-0.5, 0.5, (len(rise), 2)), np.zeros((len(rise), 1))], axis=1)
    up = np.tile(np.array(Z, np.float32), (len(rise), 1))
    length = (0.3 / rise).astype(np.float32)
    beams = Stretches(origin.astype(np.float32), direction, length, np.zeros(len(rise), np.int32))
    uncut = (radiance(photons, beams, 0.1) / length * 4 * np.pi).reshape(4, -1).mean(axis=1)
    beams.start, beams.end = up, -up
    found = (radiance(photons, beams, 0.1) / length * 4 * np.pi).reshape(4, -1).mean(axis=1)
    np.testing.assert_allclose(found, 1.0, atol=0.02)
    assert uncut[0] == pytest.approx(1.0, abs=0.02)
    assert uncut[3] < 0.93, "it must not be even without"


def test_a_sphere_is_evenly_bright_up_to_its_outline() -> None:
    """Of radius 1, and the beams' 0.15: chords through the middle, and 0.4 to 0.95 beside it."""
    rng = np.random.default_rng(2)
    position = rng.uniform(-1, 1, (800_000, 3)).astype(np.float32)
    photons = filled((position**2).sum(axis=1) < 1, position, 8.0)
    beside = np.repeat([0.0, 0.4, 0.7, 0.85, 0.95], 100)
    turn = rng.uniform(0, 2 * np.pi, len(beside))
    half = np.sqrt(1 - beside**2)
    origin = np.stack([beside * np.cos(turn), beside * np.sin(turn), -half], axis=1)
    direction = np.tile(np.array(Z, np.float32), (len(beside), 1))
    length = (2 * half).astype(np.float32)
    beams = Stretches(origin.astype(np.float32), direction, length, np.zeros(len(beside), np.int32))
    uncut = (radiance(photons, beams, 0.15) / length * 4 * np.pi).reshape(5, -1).mean(axis=1)
    beams.start = (-origin).astype(np.float32)
    beams.end = (-origin * (1, 1, -1)).astype(np.float32)
    found = (radiance(photons, beams, 0.15) / length * 4 * np.pi).reshape(5, -1).mean(axis=1)
    assert uncut[4] < 0.75, "it must be dark at its outline without"
    np.testing.assert_allclose(found, 1.0, atol=0.06)
