"""A view of a room from inside, for models that come without a camera: where there is space, along the longest way."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.meshes.several import BLOCK, in_threads
from wdpm.scenes.model.bounds import bounding_box
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Camera, Solid
from wdpm.scenes.model.transforms import look_at

Array = NDArray[np.float64]

INTERIOR_FOV = 75.0  # degrees: a wide lens, as rooms are photographed with
_BACKED = 0.8  # of the free way behind: how far the camera steps back from the middle
_LAMP_HEIGHT = 0.8  # of the free way up from the middle
_ROUND = 24  # horizontal directions that are looked along
_TRIANGLES_AT_ONCE = 1 << 14
MOST_TRIANGLES = 1 << 22
"""Of a model that is looked at: beyond, that takes longer than to read it, and copies of shapes might fill memory."""


@dataclass(frozen=True)
class Interior:
    """A view from inside.

    Attributes:
        lamp: for a room in which nothing shines, where it lights all of it.
    """

    camera: Camera
    lamp: PointLight


def is_room(meshes: Sequence[Solid], box: tuple[Array, Array] | None = None) -> bool:
    """Whether a model is a closed room: along the axes and the diagonals from its middle, there are fronts all about.

    Of a solid thing, one would see the backs. A model of more than MOST_TRIANGLES is not asked.

    Args:
        box: the bounding box, if it is known.
    """
    if sum(len(mesh.faces) for mesh in meshes) > MOST_TRIANGLES:
        return False
    low, high = box or bounding_box(meshes)
    diagonals = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / math.sqrt(3.0)
    ways = np.concatenate([np.eye(3), -np.eye(3), diagonals])
    middle = (low + high) / 2.0
    # most models are none, and show it along the first way
    return all(bool(free_ways(_parts(_astride(meshes, middle, way)), middle, way[None])[1][0]) for way in ways)


def interior_view(meshes: Sequence[Solid], size: tuple[int, int]) -> Interior:
    """The view from a place with much space around it, near the middle, along the longest horizontal way; +y is up."""
    corners = list(_parts((mesh, mesh.faces) for mesh in meshes))
    low, high = bounding_box(meshes)
    reach = float(np.linalg.norm(high - low)) or 1.0
    place = _free_place(corners, low, high, reach)
    angles = np.arange(_ROUND) * (2.0 * math.pi / _ROUND)
    around = np.stack([np.sin(angles), np.zeros(_ROUND), np.cos(angles)], axis=1)
    ways = np.minimum(free_ways(corners, place, around)[0], reach)
    longest = int(np.argmax(ways + np.roll(ways, _ROUND // 2)))  # both ahead and behind, to step back
    eye = place - around[longest] * _BACKED * float(ways[(longest + _ROUND // 2) % _ROUND])
    near = max(1e-5 * reach, 1e-12)
    camera = Camera(
        look_at(eye, eye + around[longest], (0.0, 1.0, 0.0)), INTERIOR_FOV, *size, near_clip=near, far_clip=10.0 * reach
    )
    up = min(float(free_ways(corners, place, np.array([[0.0, 1.0, 0.0]]))[0][0]), reach)
    x, y, z = (float(axis) for axis in place + np.array([0.0, _LAMP_HEIGHT * up, 0.0]))
    strength = math.pi * float(np.mean(ways)) ** 2  # irradiance pi at the mean distance
    return Interior(camera, PointLight("room lamp", (x, y, z), (strength, strength, strength)))


def _free_place(corners: Sequence[Array], low: Array, high: Array, reach: float) -> Array:
    """Of some places about the middle, the one that is farthest from what is nearest to it; the middle where equal."""
    ways = np.concatenate([np.eye(3), -np.eye(3)])
    best, clearance = (low + high) / 2.0, -1.0
    for y in (0.5, 0.35):
        for x in (0.5, 0.35, 0.65):
            for z in (0.5, 0.35, 0.65):
                place = low + np.array([x, y, z]) * (high - low)
                nearest = float(np.minimum(free_ways(corners, place, ways)[0], reach).min())
                if nearest > clearance * (1.0 + 1e-6):
                    best, clearance = place, nearest
    return best


def free_ways(parts: Iterable[Array], origin: Array, ways: Array) -> tuple[Array, NDArray[np.bool_]]:
    """How far one gets from a point, and whether what one meets there is a front.

    Seen along a way, a triangle is in it if the point lies on the same side of its three edges.

    Args:
        parts: corners of some triangles each, shape [N, 3, 3].
        ways: unit directions, shape [D, 3].

    Returns:
        Distances, infinite where nothing is in the way, and whether the first triangle's corners go counter-clockwise,
        shape [D] each.
    """
    far = np.full(len(ways), np.inf)
    front = np.zeros(len(ways), dtype=bool)
    for corners in parts:
        relative = np.ascontiguousarray((corners - origin).transpose(2, 1, 0))
        for number, way in enumerate(ways):
            met = _met(relative, way)
            if met is not None and met[0] < far[number]:
                far[number], front[number] = met
    return far, front


def _met(corners: Array, way: Array) -> tuple[float, bool] | None:
    """The nearest triangle on the way from the origin: its distance, and whether its front is seen; None for none.

    Args:
        corners: shape [axis, corner, N].
    """
    flat = corners.reshape(3, -1)
    x, y = ((axis @ flat).reshape(3, -1) for axis in _across(way))
    edges = [x[a] * y[b] - x[b] * y[a] for a, b in ((1, 2), (2, 0), (0, 1))]
    counter = (edges[0] >= 0.0) & (edges[1] >= 0.0) & (edges[2] >= 0.0)
    clockwise = (edges[0] <= 0.0) & (edges[1] <= 0.0) & (edges[2] <= 0.0)
    (inside,) = np.nonzero(counter | clockwise)
    weights = np.stack([edge[inside] for edge in edges])
    area = weights.sum(axis=0)
    inside, weights, area = inside[area != 0.0], weights[:, area != 0.0], area[area != 0.0]
    distance = (weights * np.tensordot(way, corners[:, :, inside], axes=(0, 0))).sum(axis=0) / area
    ahead = distance > 0.0
    if not ahead.any():
        return None
    nearest = int(np.argmin(np.where(ahead, distance, np.inf)))
    return float(distance[nearest]), bool(area[nearest] < 0.0)


def _across(way: Array) -> tuple[Array, Array]:
    """Two directions that are perpendicular to a way and to each other, so that the three are right-handed."""
    least = np.eye(3)[int(np.argmin(np.abs(way)))]
    first = np.cross(least, way)
    first /= np.linalg.norm(first)
    return first, np.cross(way, first)


def _astride(meshes: Sequence[Solid], origin: Array, way: Array) -> Iterator[tuple[Solid, NDArray[np.int64]]]:
    """Each mesh, and those of its faces that do not lie all to one side of a way; the others are not in it."""
    for mesh in meshes:
        relative = mesh.vertices - origin
        sides = np.zeros(len(relative), np.uint8)  # to which a vertex lies beyond, a bit each
        for number, across in enumerate(_across(way)):
            offset = relative @ across
            slack = 1e-12 * float(np.abs(offset).max(initial=0.0))  # more than roundings
            sides |= (offset > slack).view(np.uint8) << np.uint8(2 * number)
            sides |= (offset < -slack).view(np.uint8) << np.uint8(2 * number + 1)
        yield mesh, mesh.faces[_spread(sides, mesh.faces)]


def _spread(sides: NDArray[np.uint8], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of the faces whose corners have no bit in common."""

    def of_block(first: int) -> NDArray[np.int64]:
        corners = sides[faces[first : first + BLOCK]]
        common = corners[:, 0] & corners[:, 1]
        common &= corners[:, 2]
        return np.flatnonzero(common == 0) + first

    return np.concatenate([np.zeros(0, np.int64), *in_threads(of_block, range(0, len(faces), BLOCK))])


def _parts(meshes: Iterable[tuple[Solid, NDArray[np.int64]]]) -> Iterator[Array]:
    """Corners of faces of meshes, some at a time, shape [N, 3, 3] each.

    They go counter-clockwise seen from the front, which shading normals say if there are any.
    """
    small: list[Array] = []
    for mesh, chosen in meshes:
        vertices, normals = mesh.vertices, mesh.normals
        for first in range(0, len(chosen), _TRIANGLES_AT_ONCE):
            faces = chosen[first : first + _TRIANGLES_AT_ONCE]
            corners = vertices[faces]
            if normals is not None:
                flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
                behind = np.einsum("nd,nd->n", flat, normals[faces].sum(axis=1)) < 0.0
                corners[behind] = corners[behind][:, [0, 2, 1]]
            small.append(corners)
            if sum(map(len, small)) >= _TRIANGLES_AT_ONCE:
                yield np.concatenate(small)
                small = []
    if small:
        yield np.concatenate(small)
