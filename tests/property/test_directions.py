"""Directions, points of triangles and the choice of lights, against the densities that they claim."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels import lights
from wdpm.kernels.lights import (
    LightTable,
    around,
    choose_element,
    cosine_hemisphere,
    emit,
    sample_light,
    triangle_weights,
    uniform_sphere,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Array = NDArray[np.float64]
COUNT = 1 << 16

# Standard deviations by which a chi-square of 200 and more degrees of freedom is off its mean with a probability below
# 1e-5 (nearly normal); seeds are fixed.
DEVIATIONS = 5.0


@wp.kernel
def directions_kernel(
    u: wp.array(dtype=wp.vec2),
    normal: wp.array(dtype=wp.vec3),
    hemisphere_out: wp.array(dtype=wp.vec3),
    sphere_out: wp.array(dtype=wp.vec3),
    weights_out: wp.array(dtype=wp.vec2),
    frame_out: wp.array2d(dtype=wp.vec3),
):
    i = wp.tid()
    hemisphere_out[i] = cosine_hemisphere(normal[i], u[i])
    sphere_out[i] = uniform_sphere(u[i])
    weights_out[i] = triangle_weights(u[i])
    for axis in range(3):
        unit = wp.vec3()
        unit[axis] = 1.0
        frame_out[i, axis] = around(normal[i], unit)


@wp.kernel
def choice_kernel(table: LightTable, u: wp.array(dtype=wp.float64), element_out: wp.array(dtype=wp.int32)):
    i = wp.tid()
    element_out[i] = choose_element(table, u[i])


@wp.kernel
def emission_kernel(
    table: LightTable,
    u: wp.array(dtype=wp.float64),
    v: wp.array(dtype=wp.vec2),
    w: wp.array(dtype=wp.vec2),
    light_out: wp.array(dtype=wp.int32),
    origin_out: wp.array(dtype=wp.vec3),
    direction_out: wp.array(dtype=wp.vec3),
    flux_out: wp.array(dtype=wp.vec3),
    pdf_out: wp.array(dtype=wp.float32),
):
    i = wp.tid()
    e = emit(table, u[i], v[i], w[i])
    light_out[i] = e.light
    origin_out[i] = e.origin
    direction_out[i] = e.direction
    flux_out[i] = e.flux
    pdf_out[i] = sample_light(table, u[i], v[i]).pdf


def array(values: Array, dtype: type) -> wp.array:
    return wp.array(values, dtype=dtype, device="cpu")


def empty(shape: int | tuple[int, int], dtype: type) -> wp.array:
    return wp.empty(shape, dtype=dtype, device="cpu")


def directions(u: Array, normal: Array) -> tuple[Array, Array, Array, Array]:
    """cosine_hemisphere, uniform_sphere, triangle_weights and the axes of `around`."""
    count = len(u)
    outputs = [empty(count, wp.vec3), empty(count, wp.vec3), empty(count, wp.vec2), empty((count, 3), wp.vec3)]
    normals = np.broadcast_to(np.asarray(normal, np.float32), (count, 3))
    inputs = [array(u.astype(np.float32), wp.vec2), array(np.ascontiguousarray(normals), wp.vec3)]
    wp.launch(directions_kernel, count, inputs=[*inputs, *outputs], device="cpu")
    hemisphere, sphere, weights, frame = (out.numpy().astype(np.float64) for out in outputs)
    return hemisphere, sphere, weights, frame


def uniform(count: int = COUNT, seed: int = 0) -> Array:
    """Points of the unit square that are multiples of 2^-24 below 1, as kernels draw them."""
    return np.random.default_rng(seed).integers(0, 1 << 24, (count, 2)) * 2.0**-24


def excess(cells: NDArray[np.int64], count: int) -> float:
    """How far the chi-square of cells of equal probability is off, in standard deviations."""
    counts = np.bincount(cells, minlength=count)
    assert len(counts) == count
    expected = counts.sum() / count
    return float((((counts - expected) ** 2).sum() / expected - (count - 1)) / np.sqrt(2 * (count - 1)))


def bins(x: Array, low: float, high: float, count: int) -> NDArray[np.int64]:
    """Equal bins; the upper end belongs to the last."""
    return np.clip(np.floor((x - low) / (high - low) * count), 0, count - 1).astype(np.int64)


NORMALS = [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -1, 0), (0.6, 0.0, -0.8), (0.48, -0.6, 0.64)]


@pytest.mark.parametrize("normal", NORMALS)
def test_cosine_hemisphere_has_the_density_of_the_cosine(normal: tuple[float, float, float]) -> None:
    # Projected to the disk the density is uniform: r² and phi are, and independent.
    hemisphere, _, _, frame = directions(uniform(), np.array(normal))
    cosine = hemisphere @ np.array(normal)
    x, y = (np.einsum("ij,ij->i", hemisphere, frame[:, axis]) for axis in (0, 1))
    assert cosine.min() >= -1e-7
    radius2 = bins(1.0 - cosine**2, 0.0, 1.0, 16)
    phi = bins(np.arctan2(y, x), -np.pi, np.pi, 16)
    assert abs(excess(radius2 * 16 + phi, 256)) < DEVIATIONS


def test_cosine_hemisphere_keeps_strata_together() -> None:
    # The unit square's centre is the pole, its edge the horizon: no fold, so stratified points stay stratified.
    square = np.array([[0.5, 0.5], [0.0, 0.0], [0.0, 0.5], [1 - 2.0**-24, 0.25]])
    hemisphere, _, _, _ = directions(square, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(hemisphere[0], [0, 0, 1], atol=1e-7)
    np.testing.assert_allclose(hemisphere[1:, 2], 0.0, atol=1e-3)


def test_uniform_sphere_is_uniform() -> None:
    # Archimedes: z is uniform, and so is the azimuth.
    _, sphere, _, _ = directions(uniform(seed=1), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(np.linalg.norm(sphere, axis=1), 1.0, atol=3e-7)
    z = bins(sphere[:, 2], -1.0, 1.0, 16)
    phi = bins(np.arctan2(sphere[:, 1], sphere[:, 0]), -np.pi, np.pi, 16)
    assert abs(excess(z * 16 + phi, 256)) < DEVIATIONS


def test_triangle_weights_are_uniform() -> None:
    """In the triangle (0,0) (1,0) (0,1), 1 - (1 - w1)² and w2 / (1 - w1) are uniform and independent."""
    _, _, weights, _ = directions(uniform(seed=2), np.array([0.0, 0.0, 1.0]))
    w1, w2 = weights.T
    assert weights.min() >= 0.0
    assert (w1 + w2).max() <= 1.0 + 1e-7
    rest = 1.0 - w1
    share = np.divide(w2, rest, out=np.zeros_like(w2), where=rest > 0)
    cells = bins(1.0 - rest**2, 0.0, 1.0, 16) * 16 + bins(share, 0.0, 1.0, 16)
    assert abs(excess(cells, 256)) < DEVIATIONS


def test_frames_are_orthonormal_and_right_handed() -> None:
    rng = np.random.default_rng(4)
    normal = rng.normal(size=(4000, 3))
    normal[:200, 2] = rng.choice([1e-30, -1e-30, 0.0, -0.0], 200)  # both branches meet at z = 0
    normal[200:400, :2] *= 1e-6  # about the poles, where a frame from a cross product would lose its axes
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    *_, frame = directions(np.full((len(normal), 2), 0.5), normal)
    np.testing.assert_allclose(
        np.einsum("nai,nbi->nab", frame, frame), np.broadcast_to(np.eye(3), frame.shape), atol=1e-6
    )
    np.testing.assert_allclose(frame[:, 2], normal, atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(frame), 1.0, atol=1e-6)


def table_of(power: list[float], triangles: int = 0) -> LightTable:
    """Lights of given powers: triangles of area 1/2 first, then points; radiance and intensity 1."""
    points = len(power) - triangles
    corners = np.tile(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32), (triangles, 1, 1))
    corners += np.arange(triangles, dtype=np.float32)[:, None, None] * np.float32([0, 0, 10])
    return lights.upload(
        corners,
        np.ones((triangles, 3), np.float32),
        np.zeros((points, 3), np.float32),
        np.ones((points, 3), np.float32),
        np.arange(len(power), dtype=np.int32),
        np.array(power, np.float64),
        1.0,
        "cpu",
    )


def choose(table: LightTable, u: Array) -> NDArray[np.int32]:
    chosen = empty(len(u), wp.int32)
    wp.launch(choice_kernel, len(u), inputs=[table, array(u, wp.float64), chosen], device="cpu")
    return np.asarray(chosen.numpy())


# What sample_1d returns: multiples of 2^-32 from 0 to 1 - 2^-32.
ENDS = np.array([0.0, 2.0**-32, 0.5, 1.0 - 2.0**-31, 1.0 - 2.0**-32])


@pytest.mark.parametrize(
    "power", [[1.0], [1.0, 2.0, 3.0], [0.0, 1.0, 0.0, 0.0, 3.0, 0.0], [1e-6, 1e6], [5.0, 0.0], [0.1] * 1000]
)
def test_lights_are_chosen_in_proportion_to_power(power: list[float]) -> None:
    share = np.array(power) / np.sum(power)
    u = np.concatenate([(np.arange(1 << 14) + 0.5) / (1 << 14), ENDS])
    counts = np.bincount(choose(table_of(power), u), minlength=len(power))
    assert not counts[share == 0].any()  # what has no power is never chosen, not even by u = 0 or just below 1
    # Equidistant u: a share's interval holds its length over the step, rounded up or down, and the ends add at most 5.
    assert np.all(np.abs(counts - share * (1 << 14)) <= 1 + len(ENDS))


def test_power_ratios_of_1e12_are_kept() -> None:
    power = [1.0, 1e12, 0.0, 1.0, 1e12, 1.0]
    table = table_of(power)
    total = 2e12 + 3
    # The middle of the interval of each element that has one, in double.
    cumulative = np.cumsum(power) / total
    middle = cumulative - np.array(power) / total / 2
    alive = np.flatnonzero(power)
    np.testing.assert_array_equal(choose(table, middle[alive]), alive)
    pdf = sampled(table, middle[alive], 1)[4]
    # A share of 5e-13 is the difference of two doubles below 1: each is off by 2^-53, so by 2 * 1.1e-16 / 5e-13 =
    # 4.4e-4.
    np.testing.assert_allclose(pdf, np.array(power)[alive] / total, rtol=5e-4)


def test_no_power_at_all_is_no_division_by_zero() -> None:
    assert np.isfinite(table_of([0.0, 0.0]).cumulative.numpy()).all()


def sampled(table: LightTable, u: Array, seed: int) -> tuple[Array, Array, Array, Array, Array]:
    """light, origin, direction and flux of emission, and the pdf of the sample."""
    count = len(u)
    outputs = [
        empty(count, wp.int32),
        empty(count, wp.vec3),
        empty(count, wp.vec3),
        empty(count, wp.vec3),
        empty(count, wp.float32),
    ]
    points = [array(uniform(count, seed + i).astype(np.float32), wp.vec2) for i in range(2)]
    wp.launch(emission_kernel, count, inputs=[table, array(u, wp.float64), *points, *outputs], device="cpu")
    light, origin, direction, flux, pdf = (out.numpy().astype(np.float64) for out in outputs)
    return light, origin, direction, flux, pdf


def test_emission_carries_the_lights_power() -> None:
    """Mean flux by light is its power; a triangle shines from its front, a point all around."""
    triangle, point = np.pi * 0.5, 4.0 * np.pi  # pi * area * radiance, 4 pi * intensity
    table = table_of([triangle, triangle, point], triangles=2)
    u = (np.arange(COUNT) + 0.5) / COUNT
    light, origin, direction, flux, _ = sampled(table, u, 11)
    for number, power in enumerate((triangle, triangle, point)):
        # Each photon carries the whole power of all lights: flux = power / share. Equidistant u: counts off by 1.
        np.testing.assert_allclose(flux[light == number].sum(axis=0) / COUNT, power, rtol=1e-4)
    np.testing.assert_allclose(flux, 2 * triangle + point, rtol=1e-5)
    on_triangle = light < 2
    assert direction[on_triangle, 2].min() >= 0.0
    height = origin[on_triangle, 2] - 10 * light[on_triangle]
    assert height.min() > 0.0  # photons start certainly on the front's side
    assert height.max() < 1e-4
    # A point's directions have no preferred side: the mean of n of variance 1/3 is within 5 / sqrt(3 n).
    free = direction[~on_triangle]
    assert np.all(np.abs(free.mean(axis=0)) < DEVIATIONS / np.sqrt(3 * len(free)))
    np.testing.assert_array_equal(origin[~on_triangle], 0.0)
