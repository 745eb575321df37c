"""Small scenes for hard cases, made in code."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wdpm.scenes.meshes.primitives import cube, sphere
from wdpm.scenes.model.bsdfs import BumpMap, Conductor, Dielectric, Diffuse, Null, TwoSided
from wdpm.scenes.model.lights import Light, PointLight, SpotLight
from wdpm.scenes.model.scene import Camera, Material, Medium, Mesh, Scene, diffuse
from wdpm.scenes.model.textures import RGB, Bitmap
from wdpm.scenes.model.transforms import look_at

Array = NDArray[np.float64]
GREY = (0.5, 0.5, 0.5)


def quad(
    corner: ArrayLike, u: ArrayLike, v: ArrayLike, material: int = 0, emission: RGB | None = None, name: str = "quad"
) -> Mesh:
    """The parallelogram corner + [0, 1] u + [0, 1] v; it faces u x v."""
    a, du, dv = (np.asarray(x, np.float64) for x in (corner, u, v))
    vertices = np.array([a, a + du, a + du + dv, a + dv])
    uvs = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    return Mesh(name, vertices, np.array([[0, 1, 2], [0, 2, 3]]), None, uvs, material, emission)


def box(
    half: ArrayLike = (1, 1, 1),
    middle: ArrayLike = (0, 0, 0),
    material: int = 0,
    inside: bool = False,
    emission: RGB | None = None,
    name: str = "box",
) -> Mesh:
    """A box along the axes of these half lengths; it faces outwards, or inwards."""
    data = cube()
    vertices = data.vertices * np.asarray(half, np.float64) + np.asarray(middle, np.float64)
    return Mesh(name, vertices, data.faces[:, ::-1] if inside else data.faces, None, data.uvs, material, emission)


def ball(
    radius: float = 1.0, middle: ArrayLike = (0, 0, 0), material: int = 0, around: int = 24, name: str = "ball"
) -> Mesh:
    """A smooth sphere of flat triangles."""
    data = sphere(around)
    vertices = data.vertices * radius + np.asarray(middle, np.float64)
    return Mesh(name, vertices, data.faces, data.normals, data.uvs, material)


def triangles(corners: ArrayLike, material: int = 0, emission: RGB | None = None, name: str = "triangles") -> Mesh:
    """A mesh that shares no vertices; corners of shape [T, 3, 3]."""
    soup = np.asarray(corners, np.float64).reshape(-1, 3)
    return Mesh(name, soup, np.arange(len(soup)).reshape(-1, 3), None, None, material, emission)


def view(
    eye: ArrayLike, target: ArrayLike, fov: float = 60.0, size: int = 8, up: ArrayLike = (0.1, 1.0, 0.03)
) -> Camera:
    """A square image through a pinhole."""
    return Camera(look_at(eye, target, up), fov, size, size, near_clip=1e-5, far_clip=1e5)


def scene(
    meshes: Sequence[Mesh],
    camera: Camera,
    materials: Sequence[Material] = (),
    lights: Sequence[Light] = (),
    media: Sequence[Medium] = (),
) -> Scene:
    """A scene; two-sided grey where no materials are named."""
    chosen = tuple(materials) or (diffuse("grey", GREY, twosided=True),)
    return Scene("hard case", tuple(meshes), chosen, tuple(lights), camera, media=tuple(media))


def glowing_box(albedo: RGB = GREY, emission: RGB = (1.0, 1.0, 1.0), size: int = 8) -> Scene:
    """A closed box whose walls all glow: radiance is emission / (1 - albedo) wherever one looks."""
    return scene(
        [box(inside=True, emission=emission)],
        view((0.2, 0.1, -0.3), (0.5, -0.3, 1.0), 70, size),
        [diffuse("wall", albedo)],
    )


def lit_room(size: int = 8, extra: Sequence[Mesh] = (), materials: Sequence[Material] = ()) -> Scene:
    """A closed grey room [-1, 1]³ with a square lamp below its ceiling, and what else is put into it."""
    lamp = quad((-0.3, 0.98, -0.3), (0.6, 0, 0), (0, 0, 0.6), emission=(8.0, 8.0, 8.0), name="lamp")
    return scene(
        [box(inside=True, name="room"), lamp, *extra],
        view((0.1, 0.2, -0.9), (0.0, -0.3, 1.0), 70, size),
        [diffuse("grey", GREY, twosided=True), *materials],
    )


def effects_room() -> Scene:
    """Glass, a mirror, bumps, a medium and lights of several kinds in a room: each has a unit of length in it."""
    waves = Bitmap("waves", np.random.default_rng(3).random((4, 4, 3)).astype(np.float32))
    materials = (
        diffuse("grey", GREY, twosided=True),
        Material("glass", Dielectric(1.5)),
        Material("mirror", TwoSided(Conductor())),
        Material("bumps", TwoSided(BumpMap(Diffuse(GREY), waves, 0.05))),
        Material("boundary", Null()),
    )
    haze = Medium("haze", (0.8, 1.2, 1.6), (0.9, 0.8, 0.7), 0.3)
    fog = box((0.3, 0.2, 0.3), (0.5, -0.6, 0.3), 4, name="fog")
    fog = Mesh("fog", fog.vertices, fog.faces, None, None, 4, interior=0, bounds=True)
    meshes = (
        box(inside=True, name="room"),
        quad((-0.3, 0.97, -0.3), (0.6, 0, 0), (0, 0, 0.6), emission=(6.0, 5.0, 4.0), name="lamp"),
        ball(0.3, (-0.4, -0.4, 0.2), 1, 16, "glass"),
        quad((-0.9, -0.7, 0.9), (0.0, 1.2, 0.0), (1.0, 0.0, 0.05), 2, name="mirror"),
        quad((0.2, -0.9, -0.5), (0.0, 0.0, 0.8), (0.7, 0.1, 0.0), 3, name="bumps"),
        fog,
    )
    lights = (
        PointLight("point", (0.6, 0.5, -0.2), (0.6, 0.5, 0.4)),
        SpotLight("spot", look_at((-0.7, 0.8, -0.6), (0.1, -0.8, 0.3), (0.0, 1.0, 0.0)), (2.0, 2.0, 2.5), 25.0, 15.0),
    )
    camera = view((0.1, 0.2, -0.93), (0.0, -0.2, 1.0), 75, 16)
    return Scene("room of effects", meshes, materials, lights, camera, media=(haze,))
