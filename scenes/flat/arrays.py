"""Triangles and media as flat arrays: what kernels read and what travels to slaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.grids import Grids


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
    """

    ids: NDArray[np.int32]
    positions: NDArray[np.float32]
    normals: NDArray[np.float32]
    uvs: NDArray[np.float32]
    material: NDArray[np.int32]
    emitter: NDArray[np.int32]
    colors: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: NDArray[np.intp]) -> Triangles:
        """Some of the triangles; rows ascending."""
        return Triangles(
            self.ids[rows],
            self.positions[rows],
            self.normals[rows],
            self.uvs[rows],
            self.material[rows],
            self.emitter[rows],
            self.colors[rows] if len(self.colors) else self.colors,
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
