"""Small scenes of every awkward kind, for Hypothesis.

Needles, duplicates, coplanar overlaps, boxes, smooth and textured meshes, lights inside and outside of everything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from wdpm.scenes.meshes.primitives import cube
from wdpm.scenes.model.bsdfs import (
    Blend,
    Bsdf,
    BumpMap,
    Conductor,
    Dielectric,
    Diffuse,
    Distribution,
    Mask,
    NormalMap,
    Null,
    Plastic,
    Principled,
    ThinDielectric,
    TwoSided,
)
from wdpm.scenes.model.lights import DirectionalLight, Environment, Light, PointLight, SpotLight
from wdpm.scenes.model.scene import Camera, FilterKind, Material, Medium, Mesh, PixelFilter, Scene, diffuse
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Interpolation, Wrap
from wdpm.scenes.model.transforms import look_at
from wdpm.scenes.model.volumes import Volume

Array = NDArray[np.float64]

# Coordinates on a coarse lattice, so that planes, edges and vertices coincide, as well as anywhere.
LATTICE = np.linspace(-1.0, 1.0, 9)


def soup(rng: np.random.Generator, count: int, on_lattice: bool) -> Array:
    """Corners of random triangles, shape [count, 3, 3]: some of them long needles, some repeated."""
    if on_lattice:
        corners = rng.choice(LATTICE, (count, 3, 3))
    else:
        corners = rng.uniform(-1, 1, (count, 3, 3))
    needles = rng.random(count) < 0.2
    corners[needles, 2] = corners[needles, 1] + rng.normal(0, 1e-4, (int(needles.sum()), 3))
    return np.concatenate([corners, corners[rng.random(count) < 0.2]])


def coplanar(rng: np.random.Generator, count: int) -> Array:
    """Overlapping triangles in one axis-aligned plane of the lattice, shape [count, 3, 3]."""
    corners = rng.uniform(-1, 1, (count, 3, 3))
    corners[:, :, rng.integers(3)] = rng.choice(LATTICE)
    return corners


def box(rng: np.random.Generator) -> Array:
    """A cube or box along the axes, its faces on planes of the lattice, shape [12, 3, 3]."""
    data = cube()
    size = rng.choice([0.25, 0.5, 0.75], 3)
    centre = rng.choice(LATTICE[2:7], 3)
    return (data.vertices * size + centre)[data.faces]


def room() -> Array:
    """The cube [-1.5, 1.5]³ seen from inside, shape [12, 3, 3]."""
    data = cube()
    return 1.5 * data.vertices[data.faces[:, ::-1]]


def mesh_of(corners: Array, material: int, rng: np.random.Generator, smooth: bool = False) -> Mesh:
    """A mesh of a triangle soup; smooth ones get normals that lean from the facets' by up to some 30 degrees."""
    vertices = corners.reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    normals = None
    if smooth:
        flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(flat, axis=1, keepdims=True)
        flat = np.divide(flat, length, out=np.tile([0.0, 0.0, 1.0], (len(flat), 1)), where=length > 0)
        leaning = np.repeat(flat, 3, axis=0) + rng.uniform(-0.3, 0.3, (len(vertices), 3))
        normals = leaning / np.linalg.norm(leaning, axis=1, keepdims=True)
    return Mesh("soup", vertices, faces, normals, rng.uniform(-3, 3, (len(vertices), 2)), material)


def lamp(rng: np.random.Generator) -> Mesh:
    """A few glowing triangles."""
    corners = soup(rng, int(rng.integers(2, 5)), bool(rng.integers(2)))
    vertices = corners.reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    emission = tuple(float(x) for x in rng.uniform(0.5, 20, 3))
    return Mesh("lamp", vertices, faces, None, None, 0, emission)  # type: ignore[arg-type]


def materials(rng: np.random.Generator) -> tuple[Material, ...]:
    """Black, grey, two-sided, bright, and one of each kind of texture."""
    texture = tuple(
        Bitmap(
            "noise",
            rng.uniform(0, 1, (int(rng.integers(1, 5)), int(rng.integers(1, 5)), 3)).astype(np.float32),
            wrap,
            interpolation,
        )
        for wrap, interpolation in zip(
            Wrap, (Interpolation.BILINEAR, Interpolation.NEAREST, Interpolation.BILINEAR), strict=True
        )
    )
    plain = (
        diffuse("black", (0.0, 0.0, 0.0), twosided=True),
        diffuse("one side", (0.5, 0.5, 0.5)),
        diffuse("coloured", (0.8, 0.3, 0.05), twosided=True),
        diffuse("bright", (0.95, 0.95, 0.95), twosided=True),
    )
    return (*plain, *(diffuse("texture", bitmap, twosided=True) for bitmap in texture))


def scene_of(meshes: Sequence[Mesh], points: Sequence[PointLight], rng: np.random.Generator, size: int) -> Scene:
    """The scene, seen from within or from outside, sometimes straight along an axis."""
    eye = rng.choice([rng.uniform(-1, 1, 3), [0.25, 0.25, -1.25], [1.2, 0.9, -1.3], [3.0, 2.0, -3.0]])
    towards = rng.choice([rng.uniform(-0.4, 0.4, 3), eye + np.array([0.0, 0.0, 1.0])])
    to_world = look_at(eye, towards, (0.03, 1.0, 0.05))
    filters = (FilterKind.GAUSSIAN, FilterKind.TENT, FilterKind.MITCHELL, *[FilterKind.BOX] * 6, FilterKind.LANCZOS)
    kind = filters[int(10 * rng.random())]
    shape = PixelFilter(kind, 0.5 if kind in (FilterKind.BOX, FilterKind.GAUSSIAN) else 2.0)
    camera = Camera(to_world, float(rng.uniform(30, 90)), size, size - 3, 1e-2, 1e3, filter=shape)
    return Scene("random", tuple(meshes), materials(rng), tuple(points), camera)


@st.composite
def scenes(draw: st.DrawFn, size: int = 14) -> Scene:
    """A random scene with at least one light."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1), label="seed of the scene"))
    parts: list[tuple[Array, bool]] = []
    if draw(st.sampled_from([True, True, False]), label="in a room"):
        parts.append((room(), False))
    if draw(st.booleans(), label="soup"):
        parts.append((soup(rng, 12, draw(st.booleans(), label="on a lattice")), draw(st.booleans(), label="smooth")))
    if draw(st.booleans(), label="coplanar"):
        parts.append((coplanar(rng, 8), False))
    if draw(st.booleans(), label="box") or not parts:
        parts.append((box(rng), False))
    meshes = [mesh_of(corners, int(rng.integers(7)), rng, smooth) for corners, smooth in parts]
    points = []
    if draw(st.booleans(), label="point light"):
        place = rng.choice([rng.uniform(-1, 1, 3), rng.choice(LATTICE, 3)])
        points.append(PointLight("point", tuple(float(x) for x in place), (5.0, 4.0, 3.0)))
    if draw(st.booleans(), label="area light") or not points:
        meshes.append(lamp(rng))
    return scene_of(meshes, points, rng, size)


def effects(rng: np.random.Generator) -> tuple[Material, ...]:
    """Materials of every kind, smooth and rough, plain and textured, some inside others."""
    pixels = rng.uniform(0, 1, (int(rng.integers(1, 5)), int(rng.integers(2, 5)), 3)).astype(np.float32)
    texture, squares = Bitmap("noise", pixels), Checkerboard("squares", (0.9, 0.8, 0.1), (0.1, 0.2, 0.3))
    alpha = float(rng.choice([0.0, 0.05, 0.3]))
    eta = float(rng.choice([1.5, 1.0, 0.7, 2.4]))
    grey = Diffuse((0.5, 0.5, 0.5))
    glossy: tuple[Bsdf, ...] = (
        Conductor(),
        Conductor((0.2, 0.9, 1.1), (3.9, 2.4, 2.2), texture, alpha, 0.2, Distribution.GGX),
        Dielectric(eta, alpha_u=alpha, alpha_v=alpha),
        ThinDielectric(),
        TwoSided(Plastic(squares, alpha=alpha)),
        Principled((0.7, 0.3, 0.2), 0.3, 0.5, metallic=0.2, spec_trans=float(rng.choice([0.0, 0.5])), clearcoat=0.5),
        Null(),
        Mask(TwoSided(Diffuse(texture)), float(rng.uniform(0, 1))),
        TwoSided(Blend(Plastic(), Conductor(alpha_u=0.1, alpha_v=0.1), texture)),
        TwoSided(BumpMap(grey, texture, 0.3)),
        TwoSided(NormalMap(Diffuse(squares), texture)),
    )
    return tuple(Material(type(bsdf).__name__, bsdf) for bsdf in glossy)


def distant_lights(rng: np.random.Generator) -> tuple[Light, ...]:
    """A spot, a sun and a sky."""
    turn = look_at(rng.uniform(-1, 1, 3), (0.01, 0.02, 0.03), (0.1, 1.0, 0.2))
    down = rng.normal(size=3)
    x, y, z = (float(c) for c in down / np.linalg.norm(down))
    sky = (1, 1, 3) if rng.random() < 0.3 else (int(rng.integers(2, 5)), int(rng.integers(2, 6)), 3)
    return (
        SpotLight("spot", turn, (3.0, 4.0, 5.0), float(rng.uniform(5, 80)), 5.0),
        DirectionalLight("sun", (x, y, z), (1.0, 0.9, 0.8)),
        Environment("sky", rng.uniform(0, 1, sky).astype(np.float32)),
    )


def voxels(name: str, rng: np.random.Generator) -> Volume:
    """A turned grid of densities from 0 to 2, half of them 0, that fills much of the space or little of it."""
    sides = rng.integers(1, 12, 3)
    matrix = np.eye(4)
    matrix[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.5, 4.0)
    matrix[:3, 3] = rng.uniform(-0.5, 0.5, 3) - matrix[:3, :3].sum(axis=1) / 2
    values = rng.uniform(-2.0, 2.0, (*sides, 1)).clip(0.0).astype(np.float32)
    return Volume(name, values, matrix, nearest=bool(rng.integers(2)))


@st.composite
def scenes_with_effects(draw: st.DrawFn, size: int = 12) -> Scene:
    """A random scene whose materials, lights, camera and space may be of any kind."""
    plain = draw(scenes(size))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1), label="seed of the effects"))
    first, more = len(plain.materials), effects(rng)
    media = (
        Medium("haze", (0.2, 0.3, 0.4), (0.9, 0.8, 0.7), 0.5),
        Medium("ink", (3.0, 1.0, 9.0), (0.5, 0.9, 0.1), -0.2),
    )
    if draw(st.booleans(), label="media in grids"):
        media = tuple(replace(medium, density=voxels(medium.name, rng)) for medium in media)
    around = draw(st.sampled_from([None, None, 0]), label="medium around all")

    def changed(mesh: Mesh, number: int) -> Mesh:
        bounds = draw(st.booleans(), label=f"mesh {number} bounds a medium")
        return replace(
            mesh,
            material=first + draw(st.integers(0, len(more) - 1), label=f"material of mesh {number}"),
            interior=draw(st.sampled_from([None, 1])) if bounds else None,
            exterior=around if bounds else None,
            bounds=bounds,
        )

    in_room = len(plain.meshes[0].faces) == 12 and np.abs(plain.meshes[0].vertices).max() == 1.5
    meshes = tuple(
        mesh if mesh.emission or (in_room and number == 0) else changed(mesh, number)
        for number, mesh in enumerate(plain.meshes)
    )
    box_of_effects = mesh_of(box(rng), 0, rng, draw(st.booleans(), label="smooth box"))
    lights = plain.lights + tuple(light for light in distant_lights(rng) if draw(st.booleans(), label=light.name))
    camera = plain.camera
    if draw(st.booleans(), label="lens"):
        camera = replace(camera, aperture_radius=0.05)
    elif draw(st.booleans(), label="orthographic"):
        camera = replace(camera, orthographic=True)
    return replace(
        plain,
        meshes=(*meshes, changed(box_of_effects, len(meshes))),
        materials=(*plain.materials, *more),
        lights=lights,
        camera=replace(camera, medium=around),
        media=media,
    )
