"""Directions and points of triangles, against the densities that they claim."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.maths.directions import around, cosine_hemisphere, triangle_weights, uniform_cone, uniform_sphere

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
    cone_height: wp.float32,
    cone_out: wp.array(dtype=wp.vec3),
    weights_out: wp.array(dtype=wp.vec2),
    frame_out: wp.array2d(dtype=wp.vec3),
):
    i = wp.tid()
    hemisphere_out[i] = cosine_hemisphere(normal[i], u[i])
    sphere_out[i] = uniform_sphere(u[i])
    cone_out[i] = uniform_cone(u[i], cone_height)
    weights_out[i] = triangle_weights(u[i])
    for axis in range(3):
        unit = wp.vec3()
        unit[axis] = 1.0
        frame_out[i, axis] = around(normal[i], unit)


def array(values: Array, dtype: type) -> wp.array:
    return wp.array(values, dtype=dtype, device="cpu")


def empty(shape: int | tuple[int, int], dtype: type) -> wp.array:
    return wp.empty(shape, dtype=dtype, device="cpu")


def directions(u: Array, normal: Array) -> tuple[Array, Array, Array, Array]:
    """cosine_hemisphere, uniform_sphere, triangle_weights and the axes of `around`."""
    hemisphere, sphere, _, weights, frame = all_directions(u, normal, 1.0)
    return hemisphere, sphere, weights, frame


def all_directions(u: Array, normal: Array, cone_height: float) -> tuple[Array, ...]:
    """As directions, and uniform_cone."""
    count = len(u)
    vectors = [empty(count, wp.vec3) for _ in range(3)]
    rest = [empty(count, wp.vec2), empty((count, 3), wp.vec3)]
    normals = np.broadcast_to(np.asarray(normal, np.float32), (count, 3))
    inputs = [array(u.astype(np.float32), wp.vec2), array(np.ascontiguousarray(normals), wp.vec3)]
    arguments = [*inputs, *vectors[:2], cone_height, vectors[2], *rest]
    wp.launch(directions_kernel, count, inputs=arguments, device="cpu")
    return tuple(out.numpy().astype(np.float64) for out in (*vectors, *rest))


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


@pytest.mark.parametrize("height", [2.0, 1.0, 0.3, 1e-9])
def test_uniform_cone_is_uniform(height: float) -> None:
    # 1 - z is uniform up to the cone's height, and so is the azimuth; in narrow cones, 1 - z is (x² + y²) / 2.
    _, _, cone, _, _ = all_directions(uniform(seed=3), np.array([0.0, 0.0, 1.0]), height)
    np.testing.assert_allclose(np.linalg.norm(cone, axis=1), 1.0, atol=3e-7)
    radius2 = (cone[:, :2] ** 2).sum(axis=1)
    depth = radius2 / 2 if height < 1e-3 else 1.0 - cone[:, 2]
    depth_bin = bins(depth, 0.0, height, 16)
    phi = bins(np.arctan2(cone[:, 1], cone[:, 0]), -np.pi, np.pi, 16)
    assert abs(excess(depth_bin * 16 + phi, 256)) < DEVIATIONS
