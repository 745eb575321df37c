"""Shapes that are held once and stand in several places: their triangles where they stand, by one function.

An instance is nothing but its triangles. Each has the number that it would have in a scene of copies, and its corners
are the very floats that a copy would be made of: whether it is held as a copy or computed when a ray comes near it
(kernels.rays.instances), it is the same triangle, bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.renderer_space import NOTHING
from wdpm.scenes.model.transforms import placed


@dataclass(frozen=True, eq=False)
class Shapes:
    """Triangles in spaces of their own, shape after shape.

    Attributes:
        first: of each shape the row of its first triangle, and the number of all, int32, shape [S + 1].
        corners: float64, shape [G, 3, 3] (triangle, corner, axis).
        normals: unit shading normals at the corners, float64, shape [G, 3, 3]; zero rows where the mesh is flat.
        uvs: texture coordinates at the corners, float32, shape [G, 3, 2].
        material: index of the material, int32, shape [G].
        colors: linear RGB at the corners, float32, shape [G, 3, 3]; [0, 3, 3] in a scene without vertex colours.
        share_before: of the shape's area, what comes before each triangle (surface_order), float64, shape [G].
    """

    first: NDArray[np.int32]
    corners: NDArray[np.float64]
    normals: NDArray[np.float64]
    uvs: NDArray[np.float32]
    material: NDArray[np.int32]
    colors: NDArray[np.float32]
    share_before: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.first) - 1

    @property
    def sizes(self) -> NDArray[np.int32]:
        """Triangles of each shape, shape [S]."""
        return np.diff(self.first)


@dataclass(frozen=True, eq=False)
class Instances:
    """Shapes where they stand, in the order of their triangles' numbers.

    Attributes:
        shapes: what stands there.
        shape: index of the shape, int32, shape [I].
        base: global number of its first triangle, int32, shape [I], ascending; the others follow.
        matrix: from the shape's space to the renderer's, float64, shape [I, 3, 4].
        normal_matrix: what normals are multiplied by, up to their length, float64, shape [I, 3, 3].
        mirrored: 1 where left and right change places, so that corners go the other way round, int32, shape [I].
        area_before: what comes before its triangles, and ...
        area: ... what they have together, about, float64, shape [I].
    """

    shapes: Shapes
    shape: NDArray[np.int32]
    base: NDArray[np.int32]
    matrix: NDArray[np.float64]
    normal_matrix: NDArray[np.float64]
    mirrored: NDArray[np.int32]
    area_before: NDArray[np.float64]
    area: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.shape)

    @property
    def sizes(self) -> NDArray[np.int32]:
        """Triangles of each instance, shape [I]."""
        return self.shapes.sizes[self.shape]

    @property
    def triangles(self) -> int:
        """How many there are in all."""
        return int(self.sizes.sum(dtype=np.int64))

    @property
    def nbytes(self) -> int:
        """Of all arrays, those of the shapes included."""
        own = sum(array.nbytes for array in vars(self).values() if isinstance(array, np.ndarray))
        return own + sum(array.nbytes for array in vars(self.shapes).values())

    def rows(self, instance: int) -> slice:
        """The rows of an instance's triangles in the arrays of `shapes`."""
        shape = self.shape[instance]
        return slice(int(self.shapes.first[shape]), int(self.shapes.first[shape + 1]))

    def ids(self, instance: int) -> NDArray[np.int32]:
        """Global numbers of an instance's triangles, shape [F]."""
        rows = self.rows(instance)
        return np.arange(rows.stop - rows.start, dtype=np.int32) + self.base[instance]

    def positions(self, instance: int) -> NDArray[np.float32]:
        """Corners of an instance's triangles in the renderer's space, shape [F, 3, 3]."""
        corners = self.shapes.corners[self.rows(instance)]
        return placed_corners(self.matrix[instance], bool(self.mirrored[instance]), corners)

    def triangle(self, number: int) -> tuple[int, int] | None:
        """Instance and row in its shape of a triangle by its global number; None for one of no instance."""
        instance = int(np.searchsorted(self.base, number, side="right")) - 1
        if instance < 0 or number >= int(self.base[instance]) + int(self.sizes[instance]):
            return None
        return instance, number - int(self.base[instance])

    def take(self, chosen: NDArray[np.intp]) -> Instances:
        """Some of the instances, ascending, and of the shapes only those that they need."""
        used, shape = np.unique(self.shape[chosen], return_inverse=True)
        held = self.shapes
        rows = [np.arange(held.first[s], held.first[s + 1]) for s in used]
        every = np.concatenate(rows) if rows else np.zeros(0, np.intp)
        shapes = Shapes(
            np.cumsum([0, *(len(r) for r in rows)]).astype(np.int32),
            held.corners[every],
            held.normals[every],
            held.uvs[every],
            held.material[every],
            held.colors[every] if len(held.colors) else held.colors,
            held.share_before[every],
        )
        return Instances(
            shapes,
            shape.astype(np.int32),
            self.base[chosen],
            self.matrix[chosen],
            self.normal_matrix[chosen],
            self.mirrored[chosen],
            self.area_before[chosen],
            self.area[chosen],
        )


def placed_corners(matrix: NDArray[np.float64], mirrored: bool, corners: NDArray[np.float64]) -> NDArray[np.float32]:
    """Corners of triangles where they stand, shape [F, 3, 3]; kernels.rays.instances computes the same floats."""
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is dropped as such
        moved = placed(matrix, corners)
        moved[np.abs(moved) <= NOTHING] = 0.0
        stands = moved.astype(np.float32)
    return np.ascontiguousarray(stands[:, ::-1]) if mirrored else stands


def placed_normals(
    normal_matrix: NDArray[np.float64], mirrored: bool, normals: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Unit normals at the corners of triangles where they stand, shape [F, 3, 3]; zero stays zero."""
    x, y, z = normals[..., 0], normals[..., 1], normals[..., 2]
    turned = np.stack([m[0] * x + m[1] * y + m[2] * z for m in normal_matrix], axis=-1)
    x, y, z = turned[..., 0], turned[..., 1], turned[..., 2]
    length = np.sqrt(x * x + y * y + z * z)[..., None]
    unit = np.divide(turned, length, out=np.zeros_like(turned), where=length > 0).astype(np.float32)
    return np.ascontiguousarray(unit[:, ::-1]) if mirrored else unit


NO_SHAPES = Shapes(
    np.zeros(1, np.int32),
    np.zeros((0, 3, 3)),
    np.zeros((0, 3, 3)),
    np.zeros((0, 3, 2), np.float32),
    np.zeros(0, np.int32),
    np.zeros((0, 3, 3), np.float32),
    np.zeros(0),
)
NO_INSTANCES = Instances(
    NO_SHAPES,
    np.zeros(0, np.int32),
    np.zeros(0, np.int32),
    np.zeros((0, 3, 4)),
    np.zeros((0, 3, 3)),
    np.zeros(0, np.int32),
    np.zeros(0),
    np.zeros(0),
)
