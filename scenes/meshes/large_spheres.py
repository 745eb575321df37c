"""Spheres that are large beside all else, such as a ground of radius 1000 under balls of 0.2, made finer under those.

Evenly spaced triangles would lie below such a ground by more than the balls' size: they would float, or sink. So the
lines of longitude and latitude come closer together towards the place on the sphere that is nearest to all else: at a
distance d from it steps are at most a tenth of d, and triangles lie below the round surface by at most d² / (400 R).
Vertices lie on the round surface, of lamps as well: to have its area (primitives) a lamp would have to move.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.meshes.primitives import sphere_of
from wdpm.scenes.model.bounds import boxes_around
from wdpm.scenes.model.scene import Mesh, Solid
from wdpm.scenes.model.transforms import Matrix, apply_to_points

Point = NDArray[np.float64]

LARGE = 4.0
"""Radius of a large sphere over the reach of all that is not: then even triangles are off by 0.1 % of that reach."""

NEAR = 4.0
"""How far from the sphere's surface the middle of all else may be, in its reach: not so in a ball around the scene."""

STEP = 0.1
"""Of lines of longitude and latitude, over their distance from the place that is looked at."""

FINEST = 0.05
"""The smallest step, over the reach of all else."""

MOST_LARGE = 32
"""Spheres that are made finer: with a radius of a thousand times the reach of all else, each has 120,000 triangles."""


@dataclass(frozen=True, eq=False)
class RoundShape:
    """A sphere as it was read, and how to read it again.

    Attributes:
        vertices: of its mesh, by which the mesh is known.
        to_world: from the unit sphere.
        placed: puts a unit sphere of other triangles where this one is, and turns it as this one.
    """

    vertices: NDArray[np.float64]
    to_world: Matrix
    placed: Callable[[MeshData], MeshData]


def with_finer_spheres(meshes: Sequence[Solid], spheres: Sequence[RoundShape], around: int) -> list[Solid]:
    """The scene with finer triangles for spheres that are large beside all else, where all else is.

    Args:
        spheres: those that may be among the meshes.
        around: segments of a sphere, which are as many where nothing else is.
    """
    known = {id(sphere.vertices): sphere for sphere in spheres}
    found = list(meshes)
    if not known:
        return found
    large, rest = _large_among(meshes, known)
    for at, sphere in large:
        mesh = meshes[at]
        assert isinstance(mesh, Mesh)
        place, reach = _looked_at(sphere, rest)
        if abs(float(np.linalg.norm(place)) - 1.0) < NEAR * reach:
            finer = sphere.placed(_finer(place, reach, around))
            found[at] = replace(mesh, vertices=finer.vertices, faces=finer.faces, normals=finer.normals, uvs=finer.uvs)
    return found


def _large_among(
    meshes: Sequence[Solid], known: dict[int, RoundShape]
) -> tuple[list[tuple[int, RoundShape]], tuple[Point, Point]]:
    """Spheres that are large beside all that is smaller, with their places among the meshes; and a box around the rest.

    As many as can be: a sphere may be large beside balls and another large sphere, or beside balls alone.
    """
    boxes = {at: box for at, box in enumerate(boxes_around(meshes)) if box is not None}
    order = sorted(boxes, key=lambda at: -float(np.linalg.norm(boxes[at][1] - boxes[at][0])))
    nothing: tuple[Point, Point] = (np.zeros(3), np.zeros(3))
    if not order:
        return [], nothing
    # of each and all that are smaller
    lows = np.minimum.accumulate([boxes[at][0] for at in reversed(order)])[::-1]
    highs = np.maximum.accumulate([boxes[at][1] for at in reversed(order)])[::-1]
    large: list[tuple[int, RoundShape]] = []
    several, rest = 0, nothing
    for rank, at in enumerate(order[: min(MOST_LARGE, len(order) - 1)], start=1):
        sphere = _sphere_of(meshes[at], known)
        if sphere is None:
            break
        large.append((at, sphere))
        smaller = (lows[rank], highs[rank])
        if _looked_at(sphere, smaller)[1] * LARGE < 1.0:
            several, rest = rank, smaller
    return large[:several], rest


def _sphere_of(mesh: Solid, known: dict[int, RoundShape]) -> RoundShape | None:
    return known.get(id(mesh.vertices)) if isinstance(mesh, Mesh) and mesh.colors is None else None


def _looked_at(sphere: RoundShape, box: tuple[Point, Point]) -> tuple[Point, float]:
    """The middle of a box and how far it reaches from there, in the space of the unit sphere."""
    corners = np.array(list(product(*zip(*box, strict=True))))
    to_unit: Matrix = np.linalg.inv(sphere.to_world).astype(np.float64)
    corners = apply_to_points(to_unit, corners)
    middle = corners.mean(axis=0)
    return middle, float(np.linalg.norm(corners - middle, axis=1).max())


def _finer(place: Point, reach: float, around: int) -> MeshData:
    """The unit sphere with fine triangles below a place."""
    theta = math.acos(np.clip(place[2] / np.linalg.norm(place), -1.0, 1.0))
    phi = math.atan2(place[1], place[0])
    step, most = FINEST * reach, 2.0 * math.pi / around
    offsets = _offsets(step, most)
    thetas = theta + offsets
    # what is close around a pole is on all sides of it
    phis = phi + _offsets(min(step / max(math.sin(theta), step), most), most)
    phis = phis[np.abs(phis - phi) < math.pi] % (2.0 * math.pi)
    least = step / (4.0 * math.pi)
    return sphere_of(_between(phis / (2.0 * math.pi), least / 2.0), _between(thetas / math.pi, least))


def _offsets(step: float, most: float) -> NDArray[np.float64]:
    """Distances from 0 to beyond pi, and the same below 0, with steps that grow with them."""
    found = [0.0]
    while found[-1] < math.pi:
        found.append(found[-1] + min(max(step, STEP * found[-1]), most))
    return np.array([-each for each in reversed(found[1:])] + found)


def _between(values: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """Those between 0 and 1 in order, and these two; none closer to the next than the least."""
    inside = np.sort(values[(values > least) & (values < 1.0 - least)])
    inside = inside[np.append(True, np.diff(inside) > least)[: len(inside)]]
    return np.concatenate([[0.0], inside, [1.0]])
