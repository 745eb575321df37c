"""Triangles and media as flat arrays: what kernels read and what travels to slaves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.grids import Grids
from wdpm.scenes.flat.instances import NO_INSTANCES, Instances
from wdpm.scenes.flat.room import let_go


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles in the renderer's space (renderer_space), sorted by their global number.

    Attributes:
        ids: global triangle numbers, int32, shape [T], strictly ascending.
        positions: float32, shape [T, 3, 3] (triangle, corner, axis).
        normals: unit shading normals at the corners, float32, shape [T, 3, 3]; a zero row where the mesh is flat.
        uvs: texture coordinates at the corners, float32, shape [T, 3, 2].
        material: index of the material, int32, shape [T].
        emitter: index of the emitter's radiance, int32, shape [T]; -1 where nothing is emitted.
        colors: linear RGB at the corners, float32, shape [T, 3, 3]; [0, 3, 3] in a scene without vertex colours.
        area_before: by which surface points are given to triangles (surface_order), float64, shape [T].
        instances: further triangles, of shapes that are held once; their numbers lie between those of `ids`.
    """

    ids: NDArray[np.int32]
    positions: NDArray[np.float32]
    normals: NDArray[np.float32]
    uvs: NDArray[np.float32]
    material: NDArray[np.int32]
    emitter: NDArray[np.int32]
    colors: NDArray[np.float32]
    area_before: NDArray[np.float64]
    instances: Instances = NO_INSTANCES

    def __len__(self) -> int:
        """Those that have arrays of their own: not those of instances."""
        return len(self.ids)

    @property
    def total(self) -> int:
        """How many there are, each instance's counted where it stands."""
        return len(self.ids) + self.instances.triangles

    @property
    def held(self) -> int:
        """How many are in memory, shapes counted once."""
        return len(self.ids) + len(self.instances.shapes.material)

    @property
    def nbytes(self) -> int:
        """Of all arrays."""
        return sum(getattr(self, name).nbytes for name in ARRAYS) + self.instances.nbytes

    @cached_property
    def materials(self) -> NDArray[np.int32]:
        """Those that any triangle has, ascending; looked for once, since a plan asks for them some twenty times."""
        blocks = [self.material[first : first + _AT_ONCE] for first in range(0, len(self), _AT_ONCE)]
        return np.unique(np.concatenate([*map(np.unique, blocks), self.instances.shapes.material]))

    def let_go(self) -> None:
        """Have what lies in files leave memory until it is looked at again (scenes.flat.room)."""
        let_go(*(getattr(self, name) for name in ARRAYS))

    def with_arrays(self, arrays: Mapping[str, NDArray[Any]]) -> Triangles:
        """The same instances, with other arrays: by the names of ARRAYS."""
        changes: dict[str, Any] = dict(arrays)
        return replace(self, **changes)

    def with_instances(self, instances: Instances) -> Triangles:
        """The same, with other instances."""
        return replace(self, instances=instances)

    def take(self, rows: NDArray[np.intp]) -> Triangles:
        """Some of the triangles; rows ascending, each once. No instances. All of them are not copied."""
        if len(rows) == len(self):
            return replace(self, instances=NO_INSTANCES)
        return Triangles(
            self.ids[rows],
            self.positions[rows],
            self.normals[rows],
            self.uvs[rows],
            self.material[rows],
            self.emitter[rows],
            self.colors[rows] if len(self.colors) else self.colors,
            self.area_before[rows],
        )


_AT_ONCE = 1 << 20
"""Triangles whose materials are sorted together."""

ARRAYS = tuple(each.name for each in fields(Triangles) if each.name != "instances")
"""What a triangle with arrays of its own has."""

NO_TRIANGLES = Triangles(
    np.zeros(0, np.int32),
    np.zeros((0, 3, 3), np.float32),
    np.zeros((0, 3, 3), np.float32),
    np.zeros((0, 3, 2), np.float32),
    np.zeros(0, np.int32),
    np.zeros(0, np.int32),
    np.zeros((0, 3, 3), np.float32),
    np.zeros(0),
)


@dataclass(frozen=True, eq=False)
class Media:
    """Participating media, one a row.

    Attributes:
        sigma_t: extinction per unit of the renderer's space, where density is 1, float32, shape [K, 3].
        albedo: float32, shape [K, 3]; the largest of each channel where it lies in a grid.
        g: mean cosine of scattering, float32, shape [K].
        density_grid: the lattice of each one's density, int32, shape [K]; -1 for a homogeneous one, of density 1.
        albedo_grid: the lattice of its albedo, or -1, int32, shape [K].
        grids: those lattices.
    """

    sigma_t: NDArray[np.float32]
    albedo: NDArray[np.float32]
    g: NDArray[np.float32]
    density_grid: NDArray[np.int32]
    albedo_grid: NDArray[np.int32]
    grids: Grids

    @property
    def heterogeneous(self) -> NDArray[np.bool_]:
        """Of each, whether its density changes from place to place, shape [K]."""
        return self.density_grid >= 0
