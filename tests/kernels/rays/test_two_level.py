"""Rays find in instances the very hits that they find in copies: nearest, any, ties and all."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.rays import two_level
from wdpm.kernels.rays.instances import upload_instances
from wdpm.kernels.rays.triangle import no_hit
from wdpm.kernels.rays.two_level import Trees, any_of_all, closest_of_all
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.flat.shapes import Instancing
from wdpm.scenes.meshes import primitives
from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.model import transforms
from wdpm.scenes.model.bsdfs import Diffuse
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Camera, Instance, Material, Mesh, Scene, Solid

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

RAYS = 4000


@wp.kernel
def look(
    trees: Trees,
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    t_max: wp.float32,
    t_out: wp.array[wp.float32],
    prim_out: wp.array[wp.int32],
    u_out: wp.array[wp.float32],
    v_out: wp.array[wp.float32],
    any_out: wp.array[wp.bool],
) -> None:
    i = wp.tid()
    hit = closest_of_all(trees, origin[i], direction[i], no_hit())
    t_out[i] = hit.t
    prim_out[i] = hit.prim
    u_out[i] = hit.u
    v_out[i] = hit.v
    any_out[i] = any_of_all(trees, origin[i], direction[i], t_max)


def hits(flat: FlatScene, origin: np.ndarray, direction: np.ndarray, t_max: float) -> list[np.ndarray]:
    instances = upload_instances(flat.triangles.instances, "cpu")
    trees = two_level.build(flat.triangles, instances, flat.extent * PAD_SHARE, "cpu")
    count = len(origin)
    outputs = [wp.empty(count, dtype=kind) for kind in (wp.float32, wp.int32, wp.float32, wp.float32, wp.bool)]
    rays = [wp.array(values, dtype=wp.vec3) for values in (origin, direction)]
    wp.launch(look, count, inputs=[trees, *rays, t_max, *outputs], device="cpu")
    return [output.numpy() for output in outputs]


def mesh(name: str, data: MeshData, normals: bool = True) -> Mesh:
    return Mesh(name, data.vertices, data.faces, data.normals if normals else None, data.uvs, 0)


def scene_of(solids: list[Solid]) -> Scene:
    camera = Camera(transforms.look_at((0, 0, 9), (0, 0, 0), (0, 1, 0)), 40.0, 8, 8)
    lights = (PointLight("lamp", (0.0, 5.0, 5.0), (1.0, 1.0, 1.0)),)
    return Scene("instances", tuple(solids), (Material("grey", Diffuse((0.5, 0.5, 0.5))),), lights, camera)


def needles(rng: np.random.Generator) -> MeshData:
    """Long thin triangles in a box far from their origin."""
    corners = rng.normal(size=(200, 1, 3)) + rng.normal(size=(200, 3, 3)) * (1.0, 1.0, 1e-3) + 100.0
    return MeshData(corners.reshape(-1, 3), np.arange(600).reshape(-1, 3))


def cluttered(seed: int) -> Scene:
    """Shapes turned, mirrored, stretched, tiny and large, some in one plane with others, and meshes among them."""
    rng = np.random.default_rng(seed)
    shapes = [
        mesh("sphere", primitives.sphere(12)),
        mesh("cube", primitives.cube(), normals=False),
        mesh("needles", needles(rng)),
        mesh("rectangle", primitives.rectangle()),
    ]
    solids: list[Solid] = [mesh("floor", primitives.rectangle().transformed(transforms.scaling((3.0, 3.0, 1.0))))]
    for number in range(24):
        shape = shapes[number % 4]
        turn = transforms.rotation(rng.normal(size=3), float(rng.uniform(0, 360)))
        if number % 8 == 3:  # rectangles in the plane of the floor
            turn = np.eye(4)
        sizes = rng.choice([0.05, 0.3, 0.8], 3) * rng.choice([-1.0, 1.0], 3)
        place = rng.uniform(-2, 2, 3) * (1, 1, 0 if number % 8 == 3 else 1)
        matrix = transforms.translation(place) @ turn @ transforms.scaling(sizes)
        if shape.name == "needles":
            matrix = matrix @ transforms.translation((-100.0, -100.0, -100.0))
        solids.append(Instance(f"{shape.name} {number}", shape, matrix))
    solids.insert(9, mesh("ball", primitives.sphere(8).transformed(transforms.translation((0.5, 0.2, 0.1)))))
    return scene_of(solids)


def rays_at(flat: FlatScene, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays at random, along axes, and at vertices and edges of triangles."""
    rng = np.random.default_rng(seed)
    origin = rng.uniform(-1.2, 1.2, (RAYS, 3)).astype(np.float32)
    target = rng.uniform(-1.0, 1.0, (RAYS, 3)).astype(np.float32)
    corners = flat.triangles.positions
    chosen = corners[rng.integers(0, len(corners), RAYS)]
    weights = rng.dirichlet((1.0, 1.0, 1.0), RAYS)
    weights[::3] = np.eye(3)[rng.integers(0, 3, len(weights[::3]))]  # corners
    weights[1::3, 0] = 0.0  # edges
    on = np.einsum("ic,ica->ia", weights / weights.sum(axis=1, keepdims=True), chosen.astype(np.float64))
    target[: RAYS * 3 // 4] = on[: RAYS * 3 // 4]
    direction = target - origin
    direction[-200:, :2] = 0.0
    direction[-100:, 2] = 1.0
    return origin, direction.astype(np.float32)


@pytest.mark.parametrize("seed", range(3))
def test_hits_are_those_of_copies(seed: int) -> None:
    scene = cluttered(seed)
    held, copied = flatten(scene, Instancing.KEEP), flatten(scene, Instancing.EXPAND)
    assert len(held.triangles.instances) >= 20
    origin, direction = rays_at(copied, seed)
    found = hits(held, origin, direction, 0.9)
    expected = hits(copied, origin, direction, 0.9)
    assert (expected[1] >= 0).mean() > 0.3
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("seed", range(6))
def test_hits_at_borders_are_those_of_copies_from_near_and_far(seed: int) -> None:
    """Corners, edges and silhouettes, hit from a hair's breadth to many times the scene away."""
    scene = cluttered(seed)
    if seed % 2:  # far from the middle of the scene, whose coordinates are coarse there
        post = transforms.translation((400.0, -300.0, 90.0)) @ transforms.scaling([0.1] * 3)
        solids = [*scene.meshes, mesh("post", primitives.cube().transformed(post))]
        scene = scene_of(solids)
    held, copied = flatten(scene, Instancing.KEEP), flatten(scene, Instancing.EXPAND)
    rng = np.random.default_rng(seed)
    _, direction = rays_at(copied, seed)
    corners = copied.triangles.positions.astype(np.float64)
    chosen = rng.integers(0, len(corners), RAYS)
    weights = rng.dirichlet((1.0, 1.0, 1.0), RAYS)
    weights[::3] = np.eye(3)[rng.integers(0, 3, len(weights[::3]))]
    weights[1::3, 0] = 0.0
    weights[2::9] = 0.5, 0.5 + 1e-7, -1e-7  # beside an edge
    target = np.einsum("ic,ica->ia", weights / weights.sum(axis=1, keepdims=True), corners[chosen])
    way = rng.normal(size=(RAYS, 3))
    way[::5] = (corners[chosen, 1] - corners[chosen, 0])[::5] + 1e-6 * way[::5]  # along an edge
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    away = copied.extent * 10.0 ** rng.uniform(-6, 0.3, (RAYS, 1))
    origin = (target - way * away).astype(np.float32)
    direction = ((target - origin) * 10.0 ** rng.uniform(-3, 3, (RAYS, 1))).astype(np.float32)
    rays = origin[np.any(direction != 0, axis=1)], direction[np.any(direction != 0, axis=1)]
    expected = hits(copied, *rays, 1.0)
    assert (expected[1] >= 0).mean() > 0.5
    for one, other in zip(hits(held, *rays, 1.0), expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_scene_of_nothing_but_instances() -> None:
    shape = mesh("sphere", primitives.sphere(12))
    places = [transforms.translation((float(x), 0.0, 0.0)) @ transforms.scaling([0.4] * 3) for x in range(5)]
    scene = scene_of([Instance(f"{number}", shape, place) for number, place in enumerate(places)])
    held, copied = flatten(scene, Instancing.KEEP), flatten(scene, Instancing.EXPAND)
    assert len(held.triangles) == 0
    origin, direction = rays_at(copied, 1)
    for one, other in zip(hits(held, origin, direction, 1.0), hits(copied, origin, direction, 1.0), strict=True):
        np.testing.assert_array_equal(one, other)
