"""A forest of one tree: its wood and its leaves are held once, and stand in as many places as one asks for.

For tests of scale: ten thousand trees are a thousand million triangles, of which a hundred thousand are in memory.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.meshes.primitives import rectangle
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.scene import Camera, Instance, Mesh, Scene, Solid, diffuse
from wdpm.scenes.model.transforms import look_at, rotation, scaling, translation

Array = NDArray[np.float64]

DEFAULT_TREES, MOST_TREES = 100, 20_000
"""More have too many triangles to be numbered (scenes.flat.flatten)."""

TREE_TRIANGLES = 100_000

SPACING = 6.0
"""Metres between trees."""

HEIGHT, CROWN, BARE = 11.0, 3.2, 3.0
"""Of a tree, the radius of its crown, and how much of the trunk is bare [m]."""

BRANCHES, TWIGS = 70, 12
"""Of a tree, and of a branch."""

LEAF = 0.16
"""Length of a leaf [m]."""

SKY_ROWS = np.array([[0.9, 1.4, 2.2], [1.1, 1.5, 2.0], [1.6, 1.6, 1.6], [0.3, 0.28, 0.25]])
"""Radiance of the sky from the zenith down, and of what is below the horizon."""


def forest(trees: int = DEFAULT_TREES, size: tuple[int, int] | None = None) -> Scene:
    """So many trees on a meadow under a bright sky, in rows that are not quite straight, seen from above their edge.

    Raises:
        SceneError: fewer than one tree, or more than MOST_TREES.
    """
    if not 1 <= trees <= MOST_TREES:
        raise SceneError(f"forest: {trees} trees; expected 1 to {MOST_TREES}")
    random = np.random.default_rng(7)
    wood, leaves = _tree(random)
    side = math.ceil(math.sqrt(trees))
    half = side * SPACING / 2.0
    width, height = size or (640, 400)
    ground = translation((0.0, 0.0, 0.0)) @ rotation((1.0, 0.0, 0.0), -90.0) @ scaling((half + 20.0, half + 20.0, 1.0))
    meadow = rectangle().transformed(ground)
    shapes = (
        Mesh("wood", wood.vertices, wood.faces, None, None, 1),
        Mesh("leaves", leaves.vertices, leaves.faces, None, None, 2),
    )
    meshes: list[Solid] = [Mesh("meadow", meadow.vertices, meadow.faces, None, None, 0)]
    for number in range(trees):
        row, column = divmod(number, side)
        place = np.array([column + 0.5, 0.0, row + 0.5]) * SPACING - (half, 0.0, half)
        place[[0, 2]] += random.uniform(-0.3, 0.3, 2) * SPACING
        turn = rotation((0.0, 1.0, 0.0), float(random.uniform(0.0, 360.0)))
        to_world = translation(place) @ turn @ scaling(random.uniform(0.75, 1.25) * random.uniform(0.92, 1.08, 3))
        meshes += [Instance(f"{shape.name} {number}", shape, to_world) for shape in shapes]
    camera = Camera(
        look_at((0.1 * half, 1.3 * HEIGHT, half + 12.0), (0.0, 0.55 * HEIGHT, half - 24.0), (0.0, 1.0, 0.0)),
        60.0,
        width,
        height,
        far_clip=1e5,
    )
    materials = (
        diffuse("meadow", (0.14, 0.2, 0.06), twosided=True),
        diffuse("wood", (0.2, 0.14, 0.09), twosided=True),
        diffuse("leaf", (0.13, 0.3, 0.07), twosided=True),
    )
    rows = np.repeat(SKY_ROWS, (2, 1, 1, 4), axis=0)
    sky = Environment("sky", np.broadcast_to(rows[:, None], (8, 16, 3)).astype(np.float32))
    return Scene("forest", tuple(meshes), materials, (sky,), camera)


def _tree(random: np.random.Generator) -> tuple[MeshData, MeshData]:
    """The wood and the leaves of a tree that stands at the origin; +y is up."""
    limbs = [_limb(np.zeros(3), np.array([0.0, HEIGHT, 0.0]), 0.22, 0.03, 12, 40)]
    twigs = []
    for number in range(BRANCHES):
        share = (number + 0.5) / BRANCHES
        level = BARE + (HEIGHT - BARE - 0.3) * share
        start = np.array([0.0, level, 0.0])
        reach = CROWN * math.sqrt(max(1.0 - share, 0.04)) * random.uniform(0.8, 1.1)
        angle = number * 2.399963  # the golden angle
        end = start + reach * np.array([math.cos(angle), random.uniform(0.1, 0.45), math.sin(angle)])
        limbs.append(_limb(start, end, 0.06 * (1.2 - share), 0.015, 8, 12))
        for part in range(TWIGS):
            root = start + (end - start) * (0.25 + 0.75 * (part + 0.5) / TWIGS)
            tip = root + random.normal(size=3) * (0.35, 0.25, 0.35)
            limbs.append(_limb(root, tip, 0.012, 0.005, 5, 2))
            twigs.append((root, tip))
    wood = MeshData(*_joined(limbs))
    return wood, _leaves(np.array(twigs), (TREE_TRIANGLES - len(wood.faces)) // 2, random)


def _limb(
    start: Array, end: Array, thick: float, thin: float, around: int, rings: int
) -> tuple[Array, NDArray[np.int64]]:
    """A tapered tube without caps. Its triangles are no longer than need be: a shape is the faster for it."""
    axis = (end - start) / np.linalg.norm(end - start)
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    angle = np.arange(around) * 2.0 * math.pi / around
    ring = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(axis, side)
    along = np.linspace(0.0, 1.0, rings + 1)[:, None, None]
    vertices = start + (end - start) * along + ring * (thick + (thin - thick) * along)
    row, column = np.divmod(np.arange(rings * around), around)
    a, b = row * around + column, row * around + (column + 1) % around
    faces = np.concatenate([np.stack([a, a + around, b], axis=1), np.stack([b, a + around, b + around], axis=1)])
    return vertices.reshape(-1, 3), faces


def _leaves(twigs: Array, count: int, random: np.random.Generator) -> MeshData:
    """So many leaves of two triangles about twigs, given by their ends, shape [N, 2, 3]."""
    twig = twigs[random.integers(0, len(twigs), count)]
    place = twig[:, 0] + (twig[:, 1] - twig[:, 0]) * random.uniform(0.2, 1.1, (count, 1))
    place += random.normal(size=(count, 3)) * 0.12
    along = random.normal(size=(count, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, random.normal(size=(count, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    size = LEAF * random.uniform(0.7, 1.2, (count, 1))
    corners = [place, place + size * (0.5 * along + 0.3 * across), place + size * along]
    corners.append(place + size * (0.5 * along - 0.3 * across))
    first = 4 * np.arange(count)[:, None]
    faces = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    return MeshData(np.stack(corners, axis=1).reshape(-1, 3), faces)


def _joined(parts: list[tuple[Array, NDArray[np.int64]]]) -> tuple[Array, NDArray[np.int64]]:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [faces + start for (_, faces), start in zip(parts, starts[:-1], strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)
