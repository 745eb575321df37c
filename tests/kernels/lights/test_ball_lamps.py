"""Lamps that are balls: which meshes are, and ways to them against what is known of a sphere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from light_rig import Array, Glow, direct, irradiance, numbers, square, table_of, without_power
from numpy.typing import NDArray

from wdpm.scenes.flat.balls import balls_of
from wdpm.scenes.flat.light_tree import build_light_tree
from wdpm.scenes.meshes import primitives
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.textures import Checkerboard

CENTER = np.array([0.3, -0.2, 2.0])
RADIUS = 0.7
ERRORS = 5.0
OTHER = PointLight("other", (-3.0, 1.0, 2.0), (0.5, 0.5, 0.5))


def ball(
    around: int = 96, scale: tuple[float, float, float] = (RADIUS,) * 3, center: Array = CENTER
) -> NDArray[np.float32]:
    mesh = primitives.sphere(around, true_area=True)
    corners: NDArray[np.float32] = (mesh.vertices[mesh.faces] * scale + center).astype(np.float32)
    return corners


def lamp(corners: NDArray[np.float32]) -> Glow:
    return Glow(corners, (1.0, 1.0, 1.0))


def angle(place: Array) -> Array:
    """Solid angle in which the round sphere is seen."""
    distance2 = ((place - CENTER) ** 2).sum(axis=-1)
    sine2 = RADIUS**2 / distance2
    return np.asarray(2.0 * math.pi * sine2 / (1.0 + np.sqrt(1.0 - sine2)))


def around_the_ball(count: int, least: float, most: float, seed: int) -> Array:
    """Places at distances from the centre, in radii."""
    way = np.random.default_rng(seed).normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    far = np.exp(np.random.default_rng(seed + 1).uniform(math.log(least), math.log(most), (count, 1)))
    return np.asarray(CENTER + way * far * RADIUS).astype(np.float32).astype(np.float64)


def test_a_round_mesh_is_known_as_a_ball() -> None:
    found = balls_of(table_of([square(5.0, 1.0), lamp(ball())], [OTHER]))
    np.testing.assert_array_equal(found.first, [2])
    np.testing.assert_array_equal(found.last, [2 + len(ball()) - 1])
    np.testing.assert_allclose(found.center[0], CENTER, atol=1e-6)
    np.testing.assert_allclose(found.radius, RADIUS, rtol=1e-6)
    farthest = np.linalg.norm(ball().astype(np.float64) - found.center[0], axis=2).max()
    np.testing.assert_allclose(found.outside, farthest, rtol=1e-12)
    shuffled = np.random.default_rng(1).permutation(ball())
    np.testing.assert_allclose(balls_of(table_of([lamp(shuffled)])).center[0], CENTER, atol=1e-6)
    assert len(balls_of(table_of([lamp(ball()), lamp(ball(center=CENTER + 3.0))])).first) == 2


NOT_BALLS = {
    "coarse": ball(32),
    "half": ball()[: len(ball()) // 2],
    "with a hole": ball()[:-1],
    "one triangle twice": np.concatenate([ball(), ball()[-1:]]),
    "longer than wide": ball(scale=(RADIUS, RADIUS, 1.02 * RADIUS)),
    "inside out": ball()[:, [0, 2, 1]],
    "two in one": np.concatenate([ball(), ball(center=CENTER + 3.0)]),
    "one in the other": np.concatenate([ball(), ball(scale=(0.5,) * 3)]),
}


@pytest.mark.parametrize("name", NOT_BALLS)
def test_other_meshes_are_not(name: str) -> None:
    assert not len(balls_of(table_of([lamp(NOT_BALLS[name])])).first)


def test_what_shines_unevenly_is_not() -> None:
    texture = Checkerboard("even", (1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    uvs = np.zeros((len(ball()), 3, 2), np.float32)
    assert not len(balls_of(table_of([Glow(ball(), texture, uvs)], textures=[texture])).first)
    dark = without_power(table_of([lamp(ball())]), [7])
    assert not len(balls_of(dark).first)


def test_a_ball_is_one_leaf() -> None:
    table = table_of([lamp(ball())])
    tree = build_light_tree(table)
    assert len(tree.child) == 1
    assert (tree.first[0], tree.last[0]) == (0, len(table.prim) - 1)
    np.testing.assert_array_equal(tree.leaf, 0)
    np.testing.assert_allclose(tree.strength, 1.0 / (4.0 * math.pi))
    far = np.linalg.norm(table.corners.astype(np.float64) - tree.center[0], axis=2)
    assert far.max() <= tree.radius[0] * (1 + 1e-12)
    tree = build_light_tree(table_of([square(5.0, 1.0), lamp(ball())], [OTHER]))
    assert len(tree.child) == 5
    assert np.count_nonzero(tree.ball) == 1


@pytest.mark.parametrize(("least", "most"), [(1.01, 1.5), (1.5, 10.0), (10.0, 1000.0)])
def test_ways_are_even_over_the_cone(least: float, most: float) -> None:
    """Density, the ends, and the density of the same end found by other means; chi-square of where in the cone."""
    table, count = table_of([lamp(ball())]), 1 << 14
    place = around_the_ball(count, least, most, 3)
    ways = direct(table, place, count)
    assert (ways.pdf > 0).all()
    np.testing.assert_allclose(ways.pdf * angle(place), 1.0, rtol=1e-3)
    np.testing.assert_allclose(ways.triangle_pdf, ways.pdf, rtol=1e-5)
    np.testing.assert_array_equal(ways.radiance, 1.0)
    np.testing.assert_allclose(np.linalg.norm(ways.direction, axis=1), 1.0, atol=1e-6)
    way = ways.end - place
    length = np.linalg.norm(way, axis=1)
    distance = np.linalg.norm(place - CENTER, axis=1)
    arm = RADIUS * np.maximum(distance / RADIUS, 1.0)  # of roundings of places
    clearance = 2.0**-16 * RADIUS + 2.0**-21 * (np.abs(CENTER).sum() + distance)
    off = np.linalg.norm(way / length[:, None] - ways.direction, axis=1) * length
    assert np.all(off < 1e-5 * arm + clearance)
    outside = balls_of(table).outside[0]
    far = np.linalg.norm(ways.end - CENTER, axis=1)
    assert np.all(far >= outside * (1 - 1e-6) + clearance)
    assert np.all(far < outside * (1 + 1e-5) + 1.1 * clearance)
    # What is even over a cone is even in 1 - cos, and around its axis.
    axis = (CENTER - place) / np.linalg.norm(CENTER - place, axis=1, keepdims=True)
    across = np.linalg.norm(np.cross(axis, ways.direction), axis=1)
    height = across**2 / (1.0 + np.sqrt(1.0 - across**2)) / (angle(place) / (2.0 * math.pi))
    counts = np.histogram(height, 16, (0.0, 1.0 + 5e-3))[0]
    assert ((counts - count / 16) ** 2).sum() / (count / 16) < 15 + ERRORS * math.sqrt(30)


def test_no_triangle_stands_before_the_end() -> None:
    """Against all triangles of a ball, from all around it."""
    corners = ball(64).astype(np.float64)
    place = around_the_ball(200, 1.001, 50.0, 5)
    ways = direct(table_of([lamp(ball(64))]), place, len(place))
    for start, end, pdf in zip(place, ways.end, ways.pdf, strict=True):
        if pdf > 0:
            assert not _meets(corners, start, end).any()


def _meets(corners: Array, start: Array, end: Array) -> NDArray[np.bool_]:
    """Which triangles a segment meets (Möller & Trumbore)."""
    e1, e2, way = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], end - start
    across = np.cross(way, e2)
    determinant = (e1 * across).sum(axis=1)
    arm = start - corners[:, 0]
    other = np.cross(arm, e1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v, t = (arm * across).sum(axis=1) / determinant, other @ way / determinant, (e2 * other).sum(1) / determinant
    return np.asarray((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < 1))


def test_irradiance_is_that_of_a_sphere() -> None:
    """pi sin² of the half angle where it stands straight above; hardly any noise, near or far."""
    table = table_of([lamp(ball())])
    for height in (1.05, 2.0, 30.0):
        place = CENTER - np.array([0.0, 0.0, height * RADIUS])
        mean, error = irradiance(direct(table, place, 1 << 14))
        np.testing.assert_allclose(mean, math.pi / height**2, rtol=5e-3 if height < 2 else 1e-3)
        assert np.all(error < 4e-3 * mean)


def test_among_other_lights_it_has_its_share() -> None:
    table = table_of([square(4.0, 2.0), lamp(ball())], [OTHER])
    place = (0.4, -0.3, 0.2)
    total, variance = np.zeros(3), np.zeros(3)
    balls = range(2, len(table.prim))
    for others in ([*balls, len(table.prim)], [0, 1, len(table.prim)], [0, 1, *balls]):
        mean, error = irradiance(direct(without_power(table, others), place, 1 << 15))
        total, variance = total + mean, variance + error**2
    mean, error = irradiance(direct(table, place, 1 << 15, seed=7))
    assert np.all(np.abs(mean - total) < ERRORS * np.sqrt(error**2 + variance))


def test_nothing_arrives_within() -> None:
    place = CENTER + (numbers(256, 3, 3) - 0.5) * RADIUS
    ways = direct(table_of([lamp(ball())]), place, 256)
    np.testing.assert_array_equal(ways.pdf, 0.0)
    np.testing.assert_array_equal(ways.triangle_pdf, 0.0)
