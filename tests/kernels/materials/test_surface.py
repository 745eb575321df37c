"""Points of surfaces: where they are, on which side rays leave, and what normals say."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.features import ALL
from wdpm.kernels.materials import resolve, texture
from wdpm.kernels.materials.resolve import Materials
from wdpm.kernels.materials.surface import leave, make_surface
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.rays import cell_triangles as triangles_of
from wdpm.kernels.rays.cell_triangles import Surfaces, position_at
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.bsdfs import Conductor
from wdpm.scenes.model.scene import Material

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Wide = NDArray[np.float64]
_surface_at = make_surface(ALL).surface_at


@wp.kernel
def place_kernel(
    surfaces: Surfaces,
    u: wp.array[wp.float32],
    v: wp.array[wp.float32],
    position_out: wp.array[wp.vec3],
    above_out: wp.array[wp.vec3],
    below_out: wp.array[wp.vec3],
) -> None:
    i = wp.tid()
    position = position_at(surfaces, i, u[i], v[i])
    position_out[i] = position
    above_out[i] = leave(position, surfaces.front[i], surfaces.offset_min)
    below_out[i] = leave(position, -surfaces.front[i], surfaces.offset_min)


@wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
def look_kernel(
    surfaces: Surfaces,
    table: Materials,
    textures: Textures,
    u: wp.array[wp.float32],
    v: wp.array[wp.float32],
    towards: wp.array[wp.vec3],
    normal_out: wp.array[wp.vec3],
    shading_out: wp.array[wp.vec3],
    tangent_out: wp.array[wp.vec3],
) -> None:
    i = wp.tid()
    s = _surface_at(surfaces, table, textures, i, u[i], v[i], towards[i], 0.5)
    normal_out[i] = s.normal
    shading_out[i] = s.shading_normal
    tangent_out[i] = s.s


def soup(corners: Wide, normals: Wide | None = None, uvs: Wide | None = None) -> Triangles:
    """Triangles of the first material, which has tangents."""
    count = len(corners)
    return Triangles(
        ids=np.arange(count, dtype=np.int32),
        positions=corners.astype(np.float32),
        normals=(np.zeros((count, 3, 3)) if normals is None else normals).astype(np.float32),
        uvs=(np.zeros((count, 3, 2)) if uvs is None else uvs).astype(np.float32),
        material=np.zeros(count, np.int32),
        emitter=np.full(count, -1, np.int32),
        colors=np.zeros((0, 3, 3), np.float32),
        area_before=np.zeros(count),
    )


def vectors(rows: Wide | None, count: int = 0) -> Any:
    if rows is None:
        return wp.empty(count, dtype=wp.vec3, device="cpu")
    return wp.array(rows.astype(np.float32), dtype=wp.vec3, device="cpu")


def weights_of(rng: np.random.Generator, count: int) -> tuple[Any, Any]:
    w = rng.dirichlet((1.0, 1.0, 1.0), count).astype(np.float32)
    return tuple(
        wp.array(np.ascontiguousarray(column), dtype=wp.float32, device="cpu") for column in (w[:, 1], w[:, 2])
    )


def unit(v: Wide) -> Wide:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def heights(triangles: Triangles, points: NDArray[np.float32]) -> Wide:
    """How far points are above the planes of their triangles, float64, up to 2^-52 of a coordinate."""
    p = triangles.positions.astype(np.float64)
    normal = unit(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]))
    return np.asarray(((points.astype(np.float64) - p[:, 0]) * normal).sum(axis=1))


@pytest.mark.parametrize("size", [1.0, 1e-3])
@pytest.mark.parametrize("plane", ["any", "through the middle"])
def test_rays_leave_on_their_side(plane: str, size: float) -> None:
    """Strictly, in exact numbers: a point that is rounded once, then moved by a length that follows its place."""
    rng = np.random.default_rng(1)
    count = 20_000
    corners = rng.uniform(-1, 1, (count, 1, 3)) + size * rng.uniform(-1, 1, (count, 3, 3))
    if plane == "through the middle":  # of the scene: the plane's distance from the origin, a coordinate, is zero
        corners[np.arange(count), :, rng.integers(0, 3, count)] = 0.0
    triangles = soup(corners)
    surfaces = triangles_of.upload(triangles, 2.0, "cpu")
    outputs = [vectors(None, count) for _ in range(3)]
    wp.launch(place_kernel, count, inputs=[surfaces, *weights_of(rng, count), *outputs], device="cpu")
    position, above, below = (out.numpy() for out in outputs)
    # Rounded once: within half an ulp along each axis, seen along the normal.
    normal = surfaces.front.numpy().astype(np.float64)
    reach = 2.0**-24 * (np.abs(normal) * np.abs(position)).sum(axis=1)
    sizes = np.abs(triangles.positions).max(axis=(1, 2)).astype(np.float64)
    assert (np.abs(heights(triangles, position)) <= 1.001 * reach + 2.0**-49 * sizes).all()
    assert (heights(triangles, above) > 0).all()
    assert (heights(triangles, below) < 0).all()


def test_normals_of_needles() -> None:
    """1 : 1e6 and thinner, anywhere: a cross product in float32 would be noise."""
    rng = np.random.default_rng(2)
    count = 2000
    start, along, across = (rng.uniform(-1, 1, (count, 3)) for _ in range(3))
    corners = np.stack([start, start + along, start + 0.5 * along + 1e-6 * across], axis=1)
    triangles = soup(corners)
    front, _ = triangles_of.front_normals(triangles)
    p = triangles.positions.astype(np.float64)
    expected = unit(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]))
    assert np.abs(front - expected).max() < 1e-6


def seen(triangles: Triangles, towards: Wide, weights: tuple[Any, Any]) -> list[NDArray[np.float32]]:
    """Geometric normal, shading normal and tangent of each triangle, seen from a direction of its own."""
    metal = Material("brushed", Conductor(alpha_u=0.1, alpha_v=0.3))
    box = cornell_box()
    flat = flatten(replace(box, materials=(metal, *box.materials[1:])))
    table = resolve.upload(flat.materials, "cpu")
    textures = texture.upload(flat.textures, "cpu")
    count = len(towards)
    outputs = [vectors(None, count) for _ in range(3)]
    inputs = [triangles_of.upload(triangles, 2.0, "cpu"), table, textures, *weights, vectors(towards), *outputs]
    wp.launch(look_kernel, count, inputs=inputs, device="cpu")
    return [out.numpy() for out in outputs]


def test_shading_normals_are_on_the_seen_side() -> None:
    """Normals that point anywhere, blends that cancel: what is seen is a unit normal of the side that is seen."""
    rng = np.random.default_rng(3)
    count = 20_000
    normals = unit(rng.normal(size=(count, 3, 3)))
    normals[::2, 1] = -normals[::2, 0]
    normals[::4, 2] = unit(normals[::4, 0] + normals[::4, 2] * 1e-4)
    triangles = soup(rng.uniform(-1, 1, (count, 3, 3)), normals)
    towards = unit(rng.normal(size=(count, 3)))
    half = [np.full(count, x, np.float32) for x in (0.5, 0.0)]
    weights = tuple(wp.array(w, dtype=wp.float32, device="cpu") for w in half)
    for chosen in (weights, weights_of(rng, count)):
        normal, shading, _ = seen(triangles, towards, chosen)
        assert ((normal * towards).sum(axis=1) >= -1e-7).all()
        np.testing.assert_allclose(np.linalg.norm(shading, axis=1), 1.0, atol=1e-5)
        assert ((shading * towards).sum(axis=1) >= -1e-6).all()
        assert ((shading * normal).sum(axis=1) >= -1e-6).all()


def test_a_blend_on_the_back_is_not_taken() -> None:
    """Two corners' normals lean far back: between them the blend is behind the front, and the geometric one holds."""
    triangle = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    back = unit(np.array([0.9, 0.0, -0.2]))
    normals = np.array([[[0.0, 0, 1], back, back]])
    towards = unit(np.array([[-0.2, 0.1, 1.0]]))
    one = tuple(wp.array(np.array([w], np.float32), dtype=wp.float32, device="cpu") for w in (0.45, 0.45))
    _, shading, _ = seen(soup(triangle, normals), towards, one)
    np.testing.assert_array_equal(shading[0], [0, 0, 1])


def test_tangents_where_coordinates_say_nothing() -> None:
    """All corners have the same texture coordinates, or lie on a line in them: frames are frames all the same."""
    rng = np.random.default_rng(4)
    count = 1000
    uvs = np.repeat(rng.random((count, 1, 2)), 3, axis=1)
    uvs[::2, 1] += 0.25
    uvs[::2, 2] += 0.5
    triangles = soup(rng.uniform(-1, 1, (count, 3, 3)), uvs=uvs)
    towards = unit(rng.normal(size=(count, 3)))
    _, shading, tangent = seen(triangles, towards, weights_of(rng, count))
    np.testing.assert_allclose(np.linalg.norm(tangent, axis=1), 1.0, atol=1e-5)
    assert np.abs((tangent * shading).sum(axis=1)).max() < 1e-5
