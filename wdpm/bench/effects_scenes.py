"""The scenes of `wdpm bench effects`: the Cornell box, with one effect each, and with all of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.builtin.cornell_box import cornell_box
from wdpm.scenes.meshes import primitives
from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.mitsuba.metals import METALS
from wdpm.scenes.model.bsdfs import (
    Bsdf,
    Conductor,
    Dielectric,
    Diffuse,
    Distribution,
    Mask,
    Null,
    Plastic,
    Principled,
    TwoSided,
)
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.scene import Instance, Material, Medium, Mesh, Scene
from wdpm.scenes.model.textures import Bitmap, Checkerboard
from wdpm.scenes.model.transforms import rotation, scaling, translation
from wdpm.scenes.model.volumes import Volume

Change = Callable[[Scene], Scene]

SPHERE_AROUND = 128
"""Segments of the glass sphere."""

FOG = Medium("fog", (1e-3, 1e-3, 1e-3), (0.8, 0.8, 0.8), 0.3)
"""Extinction per millimetre: the fog, half a metre wide, takes two fifths of the light."""

SMOKE_SIDE = 64
"""Voxels of the smoke's side."""

SKY_SIZE = (16, 32)

PEBBLES = 100
PEBBLE_AROUND = 64
"""Segments of a pebble: all together have more triangles than are worth copying (scenes.flat.shapes)."""


def with_textures(scene: Scene) -> Scene:
    """An image on the back wall, and a checkerboard on the floor."""
    random = np.random.default_rng(0)
    image = Bitmap("noise", random.uniform(0.2, 0.8, (64, 64, 3)).astype(np.float32))
    board = Checkerboard("board", (0.8, 0.8, 0.8), (0.2, 0.2, 0.2), np.diag([8.0, 8.0, 1.0]))
    return _painted(_painted(scene, "back wall", TwoSided(Diffuse(image))), "floor", TwoSided(Diffuse(board)))


def with_mirror(scene: Scene) -> Scene:
    """A tall block that reflects everything."""
    return _painted(scene, "tall block", TwoSided(Conductor()))


def with_glass(scene: Scene) -> Scene:
    """A ball of glass before the tall block, and its caustic on the floor."""
    ball = primitives.sphere(SPHERE_AROUND)
    return _added(scene, "ball", ball, _placed((430.0, 90.0, 120.0), (80.0, 80.0, 80.0)), Dielectric(1.5))


def with_rough_metal(scene: Scene) -> Scene:
    """A short block of brushed gold."""
    eta, k = METALS["Au"]
    gold = Conductor(eta, k, alpha_u=0.3, alpha_v=0.1, distribution=Distribution.GGX)
    return _painted(scene, "short block", TwoSided(gold))


def with_plastic(scene: Scene) -> Scene:
    """A ceiling of smooth plastic."""
    return _painted(scene, "ceiling", TwoSided(Plastic((0.5, 0.5, 0.5))))


def with_principled(scene: Scene) -> Scene:
    """Disney's material on the left wall."""
    varnish = Principled((0.6, 0.1, 0.1), roughness=0.4, metallic=0.3, clearcoat=0.5)
    return _painted(scene, "left wall", TwoSided(varnish))


def with_environment(scene: Scene) -> Scene:
    """A sky that shines through the open front."""
    height, width = SKY_SIZE
    rows = np.linspace(1.0, 0.2, height)[:, None, None]
    pixels = np.broadcast_to(rows * np.array([0.6, 0.8, 1.0]), (height, width, 3)).astype(np.float32)
    return replace(scene, lights=(*scene.lights, Environment("sky", pixels)))


def with_mask(scene: Scene) -> Scene:
    """A right wall that lets half of the light pass."""
    wall = next(mesh for mesh in scene.meshes if mesh.name == "right wall")
    return _painted(scene, "right wall", Mask(scene.materials[wall.material].bsdf, 0.5))


def with_lens(scene: Scene) -> Scene:
    """Depth of field."""
    return replace(scene, camera=replace(scene.camera, aperture_radius=20.0, focus_distance=1000.0))


def with_medium(scene: Scene) -> Scene:
    """Fog about the blocks."""
    return _filled(scene, (278.0, 200.0, 280.0), (240.0, 190.0, 240.0), FOG)


def with_smoke(scene: Scene) -> Scene:
    """Smoke under the lamp, denser towards its middle."""
    center, half = (278.0, 465.0, 280.0), (240.0, 70.0, 240.0)
    axes = [np.linspace(-1.0, 1.0, SMOKE_SIDE)] * 3
    radius = np.sqrt(sum(axis**2 for axis in np.meshgrid(*axes, indexing="ij")))
    puff = np.maximum(2.0 * (1.0 - radius), 0.0)[..., None].astype(np.float32)
    to_cube = np.diag([2.0, 2.0, 2.0, 1.0])  # from 0 .. 1 to -1 .. 1
    to_cube[:3, 3] = -1.0
    smoke = replace(FOG, name="smoke", density=Volume("puff", puff, _placed(center, half) @ to_cube))
    return _filled(scene, center, half, smoke)


def with_instances(scene: Scene) -> Scene:
    """Pebbles on the floor: one fine ball that stands there many times, flattened and turned."""
    ball = primitives.sphere(PEBBLE_AROUND)
    random = np.random.default_rng(1)
    number = len(scene.materials)
    shape = Mesh("pebble", ball.vertices, ball.faces, ball.normals, ball.uvs, number)
    pebbles = []
    for _ in range(PEBBLES):
        x, z, height = random.uniform((30.0, 20.0, 5.0), (520.0, 250.0, 14.0))
        turn = rotation((0.0, 1.0, 0.0), float(random.uniform(0.0, 360.0)))
        to_world = translation((x, height, z)) @ turn @ scaling((20.0, height, 12.0))
        pebbles.append(Instance("pebble", shape, to_world))
    materials = (*scene.materials, Material("pebble", Diffuse((0.4, 0.4, 0.45))))
    return replace(scene, meshes=(*scene.meshes, *pebbles), materials=materials)


EFFECTS: dict[str, Change] = {
    "textures": with_textures,
    "mirror": with_mirror,
    "glass": with_glass,
    "rough metal": with_rough_metal,
    "plastic": with_plastic,
    "principled": with_principled,
    "environment": with_environment,
    "mask": with_mask,
    "lens": with_lens,
    "medium": with_medium,
    "heterogeneous medium": with_smoke,
    "instances": with_instances,
}
"""What each scene has besides the diffuse box."""

DIFFUSE = "diffuse box"
EVERYTHING = "everything"


def names() -> tuple[str, ...]:
    """Of all scenes, the diffuse box first and everything last."""
    return (DIFFUSE, *(f"+ {name}" for name in EFFECTS), EVERYTHING)


def scene_of(name: str, size: tuple[int, int]) -> Scene:
    """One of the scenes."""
    scene = cornell_box(size)
    if name == DIFFUSE:
        return scene
    chosen = EFFECTS.values() if name == EVERYTHING else [EFFECTS[name.removeprefix("+ ")]]
    for change in chosen:
        scene = change(scene)
    return replace(scene, name=name)


def _painted(scene: Scene, mesh_name: str, bsdf: Bsdf) -> Scene:
    """A mesh gets a material of its own."""
    number = len(scene.materials)
    meshes = tuple(
        replace(mesh, material=number) if isinstance(mesh, Mesh) and mesh.name == mesh_name else mesh
        for mesh in scene.meshes
    )
    return replace(scene, meshes=meshes, materials=(*scene.materials, Material(mesh_name, bsdf)))


def _added(scene: Scene, name: str, data: MeshData, matrix: NDArray[np.float64], bsdf: Bsdf) -> Scene:
    """One more mesh of a material of its own."""
    placed = data.transformed(matrix)
    mesh = Mesh(name, placed.vertices, placed.faces, placed.normals, placed.uvs, len(scene.materials))
    return replace(scene, meshes=(*scene.meshes, mesh), materials=(*scene.materials, Material(name, bsdf)))


def _filled(
    scene: Scene, center: tuple[float, float, float], half: tuple[float, float, float], medium: Medium
) -> Scene:
    """A box of a medium, whose boundary is nothing."""
    scene = _added(scene, medium.name, primitives.cube(), _placed(center, half), Null())
    inside = len(scene.media)
    meshes = tuple(
        replace(mesh, interior=inside, bounds=True) if isinstance(mesh, Mesh) and mesh.name == medium.name else mesh
        for mesh in scene.meshes
    )
    return replace(scene, meshes=meshes, media=(*scene.media, medium))


def _placed(center: tuple[float, float, float], half: tuple[float, float, float]) -> NDArray[np.float64]:
    """Puts what lies within -1 .. 1 into a box."""
    matrix = np.diag([*half, 1.0])
    matrix[:3, 3] = center
    return matrix
