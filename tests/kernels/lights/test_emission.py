"""Photons as they leave the lights: their flux is the lights' power, and aiming changes no mean."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from light_rig import KINDS, POINT, PROJECTOR, SPOT, SUN, Array, Photons, Rows, emitted, sky, square, table_of

from wdpm.kernels.lights.target_clusters import MOST_TARGETS, cluster_targets
from wdpm.scenes.model.lights import Environment, Light, ProjectorLight, SpotLight
from wdpm.scenes.model.textures import Bitmap, Interpolation

COUNT = 1 << 16
# Standard errors that an estimate may be off by: a probability below 1e-6; seeds are fixed.
ERRORS = 5.0

LIGHTS: dict[str, tuple[bool, list[Light]]] = {
    "area": (True, []),
    "point": (False, [POINT]),
    "spot": (False, [SPOT]),
    "projector": (False, [PROJECTOR]),
    "directional": (False, [SUN]),
    "environment": (False, [sky()]),
    "constant": (False, [Environment("constant", np.full((1, 1, 3), [1.0, 2.0, 3.0], np.float32))]),
    "squared spot": (False, [replace(SPOT, squared=True)]),
    "all": (True, [POINT, SPOT, PROJECTOR, SUN, sky()]),
}


def table_for(name: str):
    with_square, others = LIGHTS[name]
    return table_of([square(4.0, 2.0, (3.0, 2.0, 1.0))] if with_square else [], others)


def mean_and_error(terms: Array) -> tuple[Array, Array]:
    return terms.mean(axis=0), terms.std(axis=0) / math.sqrt(len(terms))


@pytest.mark.parametrize("name", LIGHTS)
def test_photons_carry_the_power_of_their_lights(name: str) -> None:
    table = table_for(name)
    photons = emitted(table, COUNT)
    np.testing.assert_allclose(np.linalg.norm(photons.direction, axis=1), 1.0, atol=1e-6)
    flux = photons.flux.mean(axis=1)
    for light in range(len(table.names)):
        power = table.power[table.light == light].sum()
        terms = np.where(photons.light == light, flux, 0.0)
        mean, error = mean_and_error(terms)
        # 1e-3 for the maps: their density is that of a grid, power that of the exact integral.
        assert abs(mean - power) < ERRORS * error + 1e-3 * power
    np.testing.assert_array_equal(photons.light, table.light[photons.element.astype(int)])


def test_photons_of_parallel_light_start_on_the_scenes_sphere() -> None:
    table = table_of(others=[SUN, sky()])
    photons = emitted(table, 4096)
    np.testing.assert_allclose(np.linalg.norm(photons.origin, axis=1), table.scene_radius, rtol=1e-5)
    assert np.all(np.einsum("ij,ij->i", photons.origin, photons.direction) <= 1e-5)  # inwards
    sun = photons.direction[photons.light == 0]
    np.testing.assert_allclose(sun, np.broadcast_to([0.6, 0, -0.8], sun.shape), atol=1e-6)


def test_photons_of_a_textured_square_carry_what_it_shows() -> None:
    texture = Bitmap("halves", np.array([[[1, 0, 0], [0, 3, 0]]], np.float32), interpolation=Interpolation.NEAREST)
    photons = emitted(table_of([square(2.0, 2.0, texture)], textures=[texture]), COUNT, [texture])
    left = photons.origin[:, 0] < 0
    mean, error = mean_and_error(photons.flux)
    assert np.all(np.abs(mean - np.array([2, 6, 0]) * math.pi) <= ERRORS * error)  # pi times half the area's radiance
    np.testing.assert_array_equal(photons.flux[:, 0] > 0, left)
    np.testing.assert_array_equal(photons.flux[:, 1] > 0, ~left)
    assert np.all(photons.direction[:, 2] <= 1e-7)
    assert photons.origin[:, 2].max() < 2.0


def test_a_projector_throws_its_picture() -> None:
    """Left is where +x is; the flux of each half is its share of the area at distance 1."""
    texture = Bitmap("halves", np.array([[[1, 0, 0], [0, 3, 0]]], np.float32), interpolation=Interpolation.NEAREST)
    projector = ProjectorLight("projector", np.eye(4), (1.0, 1.0, 1.0), 90.0, 2.0, texture)
    table = table_of(others=[projector], textures=[texture])
    photons = emitted(table, COUNT, [texture])
    np.testing.assert_array_equal(photons.flux[:, 0] > 0, photons.direction[:, 0] > 0)
    mean, error = mean_and_error(photons.flux)
    assert np.all(np.abs(mean - np.array([1, 3, 0])) <= ERRORS * error)  # half of 2 x 1 each
    assert table.power.sum() == pytest.approx(4 / 3)
    at_one = photons.direction[:, :2] / photons.direction[:, 2:]
    np.testing.assert_allclose(np.abs(at_one).max(axis=0), [1.0, 0.5], rtol=1e-3)


def test_a_patterned_spot_shows_its_pattern() -> None:
    texture = Bitmap("halves", np.array([[[0, 0, 0], [1, 1, 1]]], np.float32), interpolation=Interpolation.NEAREST)
    spot = SpotLight("spot", np.eye(4), (1.0, 1.0, 1.0), 40.0, 40.0, texture)
    photons = emitted(table_of(others=[spot], textures=[texture]), 4096, [texture])
    lit = photons.flux[:, 0] > 0
    np.testing.assert_array_equal(lit, photons.direction[:, 0] > 0)
    np.testing.assert_allclose(photons.flux[lit], 2 * math.pi * (1 - math.cos(math.radians(40))), rtol=1e-4)


# Overlapping spheres, one beside the others, one that no downward light reaches.
CENTERS = np.array([[0, 0, 0], [0.3, 0.2, 0.1], [-2, 1, -1], [0.5, 0.0, 9.0]], np.float32)
RADII = np.array([0.5, 0.6, 0.4, 0.3], np.float32)


def hits(photons: Photons, centers: Rows, radii: Rows) -> Array:
    """Which photons meet each sphere in front of them, shape [photons, spheres]."""
    to = centers.astype(np.float64) - photons.origin[:, None]
    along = np.einsum("nsi,ni->ns", to, photons.direction)
    aside2 = ((to - along[..., None] * photons.direction[:, None]) ** 2).sum(axis=2)
    return np.asarray((aside2 <= radii.astype(np.float64) ** 2) & (along > 0))


@pytest.mark.parametrize("name", LIGHTS)
def test_aiming_changes_no_mean(name: str) -> None:
    """Flux through each target, and its first moment over the sphere, by aimed and by free photons."""
    table = table_for(name)
    aimed = emitted(table, COUNT, targets=(CENTERS, RADII))
    free = emitted(table, 4 * COUNT, seed=20)
    results = []
    for photons in (aimed, free):
        met = hits(photons, CENTERS, RADII)
        flux = photons.flux.mean(axis=1)
        # a function of the direction, too: the mean alone would not see photons in wrong places
        tilt = flux * (1.0 + photons.direction[:, 0])
        terms = np.concatenate([met * flux[:, None], met * tilt[:, None]], axis=1)
        results.append((*mean_and_error(terms), met.any(axis=1).mean(), np.nanmax(terms.std(axis=0))))
    (mean, error, share, _), (free_mean, free_error, free_share, _) = results
    assert np.all(np.abs(mean - free_mean) <= ERRORS * np.sqrt(error**2 + free_error**2) + 1e-6 * free_mean)
    assert share > 0.95  # but for what falls below a light's horizon
    assert share > 3 * free_share
    lit = free_mean > 0
    assert lit.any()
    # As many photons: less noise.
    assert (error[lit] < 2 * free_error[lit]).mean() > 0.7


def test_a_light_within_a_target_sends_as_if_there_were_none() -> None:
    around = (np.array([[1, 2, 2]], np.float32), np.array([1.0], np.float32))
    aimed, free = emitted(table_of(others=[POINT]), 1024, targets=around), emitted(table_of(others=[POINT]), 1024)
    np.testing.assert_array_equal(aimed.direction, free.direction)
    np.testing.assert_array_equal(aimed.flux, free.flux)


def test_no_targets_is_not_aimed() -> None:
    table = table_for("all")
    nothing = (np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
    one, other = emitted(table, 1024, targets=nothing), emitted(table, 1024)
    np.testing.assert_array_equal(one.direction, other.direction)


def test_targets_that_a_light_cannot_reach_get_no_photons() -> None:
    behind = (np.array([[0, 0, 8]], np.float32), np.array([0.5], np.float32))
    photons = emitted(table_of([square(4.0, 2.0)]), 256, targets=behind)
    assert not photons.flux.any()


def test_shares_other_than_power_change_no_mean() -> None:
    table = table_for("all")
    shares = np.arange(1.0, 1.0 + len(table.power))
    photons = emitted(table, 4 * COUNT, shares=shares)
    counts = np.bincount(photons.element.astype(int), minlength=len(shares)) / (4 * COUNT)
    np.testing.assert_allclose(counts, shares / shares.sum(), atol=1e-5)
    for light in range(len(table.names)):
        power = table.power[table.light == light].sum()
        mean, error = mean_and_error(np.where(photons.light == light, photons.flux.mean(axis=1), 0.0))
        assert abs(mean - power) < ERRORS * error + 1e-3 * power


@pytest.mark.parametrize("kind", KINDS)
def test_kernels_of_fewer_features_give_the_same_bits(kind: str) -> None:
    others, features = KINDS[kind]
    table = table_of([square(4.0, 2.0)], others)
    for targets in (None, (CENTERS, RADII)):
        one = emitted(table, 1024, targets=targets, features=features)
        other = emitted(table, 1024, targets=targets)
        for name in vars(one):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def ball(center: tuple[float, float, float], radius: float, slices: int = 16) -> Rows:
    """A sphere of 2 slices² triangles, shape [triangles, 3, 3]."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, slices + 1), np.arange(slices) * 2 * np.pi / slices, indexing="ij")
    grid = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=2) * radius
    grid = (grid + np.array(center)).astype(np.float32)
    right = np.roll(grid, -1, axis=1)
    upper = np.stack([grid[:-1], grid[1:], right[1:]], axis=2)
    lower = np.stack([grid[:-1], right[1:], right[:-1]], axis=2)
    return np.concatenate([upper.reshape(-1, 3, 3), lower.reshape(-1, 3, 3)])


def assert_held(positions: Rows, center: Rows, radius: Rows) -> None:
    """Some sphere holds all corners of each triangle."""
    far = np.linalg.norm(positions[:, :, None].astype(np.float64) - center.astype(np.float64), axis=3).max(axis=1)
    assert np.all((far <= radius.astype(np.float64)).any(axis=1))


def test_two_balls_are_two_targets() -> None:
    positions = np.concatenate([ball((0, 0, 0), 1.0), ball((5, 1, 0), 0.5)])
    center, radius = cluster_targets(positions)
    assert center.dtype == radius.dtype == np.float32
    order = np.argsort(center[:, 0])
    np.testing.assert_allclose(center[order], [[0, 0, 0], [5, 1, 0]], atol=1e-6)
    np.testing.assert_allclose(radius[order], [1, 0.5], rtol=1e-4)
    assert_held(positions, center, radius)


def test_a_ball_is_one_target() -> None:
    center, _ = cluster_targets(ball((1, 2, 3), 2.0, 40))
    assert len(center) == 1


def test_targets_are_few_and_hold_everything() -> None:
    """150 balls in 30 heaps: fewer spheres than balls, and far smaller than the one around them all."""
    rng = np.random.default_rng(4)
    places = np.repeat(rng.uniform(-10, 10, (30, 3)), 5, axis=0) + rng.uniform(-0.5, 0.5, (150, 3))
    positions = np.concatenate([ball(tuple(p), 0.2, 3) for p in places])
    center, radius = cluster_targets(positions)
    assert 30 <= len(center) <= MOST_TARGETS
    assert_held(positions, center, radius)
    assert (radius.astype(np.float64) ** 2).sum() < 30
    shuffled = cluster_targets(positions[rng.permutation(len(positions))])
    np.testing.assert_allclose(np.sort(shuffled[1]), np.sort(radius))


def test_scattered_objects_are_targets_of_their_own() -> None:
    """Halving such a scene once gains nothing, and yet each ball by itself is best."""
    places = np.random.default_rng(5).uniform(-10, 10, (40, 3))
    positions = np.concatenate([ball(tuple(p), 0.3) for p in places])
    center, radius = cluster_targets(positions)
    assert len(center) == 40
    np.testing.assert_allclose(radius, 0.3, rtol=1e-4)
    assert_held(positions, center, radius)


def test_a_large_mesh_is_dealt_with_in_runs() -> None:
    """Half a million triangles: two balls, one with nearly all of them."""
    positions = np.concatenate([ball((0, 0, 0), 1.0, 500), ball((5, 1, 0), 0.5, 5)])
    center, radius = cluster_targets(positions)
    assert len(center) == 2
    assert_held(positions[::97], center, radius)
    assert_held(positions[-50:], center, radius)


def test_nothing_specular_is_no_target() -> None:
    center, radius = cluster_targets(np.zeros((0, 3, 3), np.float32))
    assert center.shape == (0, 3)
    assert radius.shape == (0,)
    center, radius = cluster_targets(np.ones((4, 3, 3), np.float32))  # one place: no plane divides it
    assert len(center) == 1
