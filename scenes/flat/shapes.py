"""Which instances are held as instances, which become copies, and which of their triangles are dropped."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.dropped import DUPLICATE, KEPT, degenerate_cause, repeated
from wdpm.scenes.flat.instances import NO_INSTANCES, Instances, Shapes, placed_corners, placed_normals
from wdpm.scenes.flat.renderer_space import RendererSpace
from wdpm.scenes.flat.surface_order import along_curve
from wdpm.scenes.model.scene import Instance, Mesh, Solid
from wdpm.scenes.model.transforms import normalized


class Instancing(Enum):
    """What is done with instances. The image has the same bits."""

    AUTO = "auto"
    """Shapes are held once where that saves much memory; others become copies, which rays find faster."""
    KEEP = "keep"
    """Shapes are held once."""
    EXPAND = "expand"
    """All become copies."""


WORTH_KEEPING = 1 << 18
"""Triangles that are not held, from which on it is worth it: about 100 MB."""

TINY = float(np.finfo(np.float64).tiny)

_NEXT, _LAST = np.array([[1], [2], [0]]), np.array([[2], [0], [1]])
"""Of three, those that are left out of a cofactor by row, and by column their transposes."""

DOUBTFUL = 2.0**-18
"""Triangles whose height is less, where they stand, or less of their length, might be dropped there: each is looked at.

The height of others is at least 64 roundings of a coordinate, which is at most 1, and their cross product in single
precision is not 0."""


@dataclass(eq=False)
class _Shape:
    """A shape as flatten needs it.

    Attributes:
        corners, normals: float64, shape [F, 3, 3].
        uvs, colors: at the corners, float32; colours are None where the mesh has none.
        height, length: of each triangle, its least height and its longest side; of all, the least and the largest.
        cause: why each triangle is dropped where the shape stands first, int8, shape [F].
        glows: whether it is a light.
    """

    mesh: Mesh
    corners: NDArray[np.float64]
    normals: NDArray[np.float64]
    uvs: NDArray[np.float32]
    colors: NDArray[np.float32] | None
    height: NDArray[np.float64]
    length: NDArray[np.float64]
    least_height: float
    largest_length: float
    glows: bool
    cause: NDArray[np.int8] | None = None
    places: set[bytes] = field(default_factory=set)

    @cached_property
    def kept(self) -> NDArray[np.intp]:
        """Rows of triangles that are not dropped where the shape stands first."""
        return np.flatnonzero(self.cause == KEPT)

    @cached_property
    def along_curve(self) -> tuple[NDArray[np.float64], float]:
        """What share of its area comes before each triangle (surface_order), shape [F], 0 if it is dropped; and all."""
        share = np.zeros(len(self.corners))
        before, area = along_curve(self.corners[self.kept])
        share[self.kept] = before / area if area > 0.0 else 0.0
        return share, area

    @cached_property
    def facing(self) -> NDArray[np.float64]:
        """Mean of n n', the outer products of its triangles' normals, by their areas, shape [3, 3]."""
        corners = self.corners[self.kept]
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            twice = np.linalg.norm(across, axis=1)
            normals = across / twice[:, None]
        sound = np.isfinite(twice) & np.isfinite(normals).all(axis=1)
        weights = twice[sound] / max(float(twice[sound].sum()), TINY)
        return np.einsum("t,ti,tj->ij", weights, normals[sound], normals[sound])


@dataclass(frozen=True, eq=False)
class Standing:
    """An instance where it stands.

    Attributes:
        matrix, normal_matrix, mirrored: as of Instances.
        cause: why each triangle is dropped, int8, shape [F].
        alike: whether the very triangles are dropped that are dropped of the shape's other instances.
    """

    shape: _Shape
    matrix: NDArray[np.float64]
    normal_matrix: NDArray[np.float64]
    mirrored: bool
    cause: NDArray[np.int8]
    alike: bool

    @property
    def positions(self) -> NDArray[np.float32]:
        """Of all triangles, shape [F, 3, 3]."""
        return placed_corners(self.matrix, self.mirrored, self.shape.corners)

    @cached_property
    def area(self) -> float:
        """Of all triangles, about: as if each grew by the root of the mean of all squared growths.

        A normal n of a unit area becomes one of the cofactors' matrix times n, whose length is the area's growth.
        """
        m = self.matrix
        cofactors = m[_NEXT, _NEXT.T] * m[_LAST, _LAST.T] - m[_NEXT, _LAST.T] * m[_LAST, _NEXT.T]
        growth = math.sqrt(float(np.sum(cofactors @ self.shape.facing * cofactors)))
        return growth * self.shape.along_curve[1]

    @property
    def area_before(self) -> NDArray[np.float64]:
        """What area of it comes before each triangle, shape [F]."""
        return self.area * self.shape.along_curve[0]

    def copy(self, material: int, emitter: int) -> Triangles:
        """All triangles, as those of a mesh; what goes by their place among all is given later."""
        shape, count = self.shape, len(self.cause)
        turn = slice(None, None, -1 if self.mirrored else 1)
        return Triangles(
            np.zeros(count, np.int32),
            self.positions,
            placed_normals(self.normal_matrix, self.mirrored, shape.normals),
            np.ascontiguousarray(shape.uvs[:, turn]),
            np.full(count, material, np.int32),
            np.full(count, emitter, np.int32),
            np.zeros((0, 3, 3), np.float32),
            np.zeros(count),
        )


class Stage:
    """Instances of a scene, one after another.

    Args:
        glows: whether a mesh is a light.
    """

    def __init__(self, space: RendererSpace, glows: Callable[[Solid], bool]) -> None:
        self._space = space
        self._glows = glows
        self._shapes: dict[int, _Shape] = {}

    def stand(self, instance: Instance) -> Standing:
        """An instance where it stands."""
        key = id(instance.shape)
        if key not in self._shapes:
            self._shapes[key] = _read(instance.shape, self._glows(instance.shape))
        shape = self._shapes[key]
        matrix = self._space.placing(instance.to_world)
        normal_matrix = _normal_matrix(instance)
        cause = _cause(shape, matrix, instance.mirrors)
        if shape.cause is None:
            shape.cause = cause
        alike = cause is shape.cause or bool(np.array_equal(cause, shape.cause))
        if alike:
            cause = shape.cause  # one array for all
        if not shape.glows and matrix.tobytes() in shape.places:
            cause, alike = np.where(cause == KEPT, np.int8(DUPLICATE), cause), False
        shape.places.add(matrix.tobytes())
        return Standing(shape, matrix, normal_matrix, instance.mirrors, cause, alike)


def choose(meshes: Sequence[Solid], standing: Sequence[Standing | None], instancing: Instancing) -> list[bool]:
    """Which of a scene's meshes are held as instances; those without a standing never are.

    Lights are tables of triangles, and a boundary of a medium may have any light in it: such become copies.
    """
    may = [
        each is not None and each.alike and not (each.shape.glows or mesh.bounds or mesh.material < 0)
        for mesh, each in zip(meshes, standing, strict=True)
    ]
    if instancing is Instancing.EXPAND:
        return [False] * len(meshes)
    saved: dict[int, int] = {}
    for each, chosen in zip(standing, may, strict=True):
        if chosen and each is not None:
            saved[id(each.shape)] = saved.get(id(each.shape), -len(each.cause)) + len(each.cause)
    if instancing is Instancing.AUTO and sum(saved.values()) < WORTH_KEEPING:
        return [False] * len(meshes)
    # A shape that stands in one place is a mesh like any other.
    return [
        chosen and each is not None and saved[id(each.shape)] > 0 for each, chosen in zip(standing, may, strict=True)
    ]


def hold(chosen: Sequence[tuple[Standing, int, int, float]], colored: bool) -> Instances:
    """Instances as arrays.

    Args:
        chosen: each with the row of its material, the number of its first triangle, and the area before that.
        colored: whether the scene has vertex colours.
    """
    if not chosen:
        return NO_INSTANCES
    numbers: dict[int, int] = {}
    held: list[tuple[_Shape, int]] = []
    for each, material, *_ in chosen:
        if id(each.shape) not in numbers:
            numbers[id(each.shape)] = len(held)
            held.append((each.shape, material))
    return Instances(
        _joined(held, colored),
        np.array([numbers[id(each.shape)] for each, *_ in chosen], np.int32),
        np.array([base for _, _, base, _ in chosen], np.int32),
        np.array([each.matrix for each, *_ in chosen]),
        np.array([each.normal_matrix for each, *_ in chosen]),
        np.array([each.mirrored for each, *_ in chosen], np.int32),
        np.array([before for *_, before in chosen]),
        np.array([each.area for each, *_ in chosen]),
    )


def _joined(held: Sequence[tuple[_Shape, int]], colored: bool) -> Shapes:
    """The arrays of shapes, without what is dropped."""
    kept = [shape.kept for shape, _ in held]
    white = [np.ones((len(shape.corners), 3, 3), np.float32) if colored else None for shape, _ in held]
    colors = [
        (back if shape.colors is None else shape.colors)[rows]
        for (shape, _), back, rows in zip(held, white, kept, strict=True)
        if back is not None
    ]
    pairs = list(zip((shape for shape, _ in held), kept, strict=True))
    return Shapes(
        np.cumsum([0, *(len(rows) for rows in kept)]).astype(np.int32),
        np.concatenate([shape.corners[rows] for shape, rows in pairs]),
        np.concatenate([shape.normals[rows] for shape, rows in pairs]),
        np.concatenate([shape.uvs[rows] for shape, rows in pairs]),
        np.repeat(np.array([material for _, material in held], np.int32), [len(rows) for rows in kept]),
        np.concatenate(colors) if colored else np.zeros((0, 3, 3), np.float32),
        np.concatenate([shape.along_curve[0][rows] for shape, rows in pairs]),
    )


def _read(mesh: Mesh, glows: bool) -> _Shape:
    count = len(mesh.faces)
    if count and not (mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)):
        raise SceneError(f'mesh "{mesh.name}": a face names a vertex out of range (there are {len(mesh.vertices)})')
    corners = mesh.vertices[mesh.faces]
    normals = np.zeros_like(corners)
    if mesh.normals is not None:
        normals = normalized(mesh.normals)[mesh.faces]
        # as of any mesh: where one corner has none, the triangle is flat
        normals[~np.any(normals != 0, axis=2).all(axis=1)] = 0.0
    uvs = np.zeros((count, 3, 2), np.float32) if mesh.uvs is None else mesh.uvs.astype(np.float32)[mesh.faces]
    colors = None if mesh.colors is None else mesh.colors.astype(np.float32)[mesh.faces]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        length = sides.max(axis=1, initial=0.0)
        twice = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        height = np.nan_to_num(twice / length)
    least, largest = float(height.min(initial=np.inf)), float(np.nan_to_num(length).max(initial=0.0))
    return _Shape(mesh, corners, normals, uvs, colors, height, length, least, largest, glows)


def _normal_matrix(instance: Instance) -> NDArray[np.float64]:
    """The inverse transpose of the matrix.

    Raises:
        SceneError: there is none.
    """
    linear = instance.to_world[:3, :3]
    if not np.isfinite(instance.to_world).all() or not np.linalg.matrix_rank(linear) == 3:
        raise SceneError(f'instance "{instance.name}": its transform flattens space: the matrix has no inverse')
    return np.ascontiguousarray(np.linalg.inv(linear).T)


def _cause(shape: _Shape, matrix: NDArray[np.float64], mirrored: bool) -> NDArray[np.int8]:
    """Why triangles of a shape are dropped where it stands."""
    scales = np.linalg.svd(matrix[:, :3], compute_uv=False)
    certain = shape.least_height * scales[2] > max(DOUBTFUL, DOUBTFUL * scales[0] * shape.largest_length)
    if certain and shape.cause is not None:
        return shape.cause
    cause = np.full(len(shape.corners), KEPT, np.int8)
    high = np.maximum(DOUBTFUL, DOUBTFUL * scales[0] * shape.length)
    doubtful = np.flatnonzero(~(shape.height * scales[2] > high))
    if len(doubtful):
        cause[doubtful] = degenerate_cause(placed_corners(matrix, mirrored, shape.corners[doubtful]))
    if shape.cause is None:
        if not shape.glows:
            same = repeated(placed_corners(matrix, mirrored, shape.corners))
            cause[same & (cause == KEPT)] = DUPLICATE
    else:
        cause[(shape.cause == DUPLICATE) & (cause == KEPT)] = DUPLICATE
    return cause
