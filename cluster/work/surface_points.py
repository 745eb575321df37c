"""Points spread evenly over the surfaces of a cell: a gather divides by the area that those within it stand for."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import MapPlan
from wdpm.kernels.photons.surface_points import even_runs, points_of, spread
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.instance_areas import InstanceAreas
from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.instances import Instances

POINTS_AT_ONCE = 1 << 20
"""Surface points that are spread at once, about."""

Rows = Callable[[NDArray[np.intp]], NDArray[np.int32]]
"""Rows of chosen triangles, as kernels.rays.instanced_triangles has them, shape [N, 2]."""


class PointSpreader:
    """Spreads points over one cell.

    Args:
        cell: number of the cell.
        surfaces: its triangles on the device.
        area_before: what area comes before each (scenes.flat.surface_order), float64, shape [T].
        instances: those of them that are held once and stand in several places.
        areas: of these.
    """

    def __init__(
        self,
        cell: int,
        surfaces: Surfaces,
        area_before: NDArray[np.float64],
        instances: Instances,
        areas: InstanceAreas,
        replica: Replica,
    ) -> None:
        self._cell = cell
        self._surfaces = surfaces
        self._area_before = area_before
        self._instances = instances
        self._areas_of_instances = areas
        self._replica = replica

    def spread(self, plans: Mapping[int, MapPlan]) -> Iterator[tuple[int, NDArray[np.float32], NDArray[np.float32]]]:
        """The points of some maps that lie in the cell, some at a time.

        Args:
            plans: of the maps, by number.

        Yields:
            number of the map, positions [scene units] and unit normals, float32, shape [N, 3].
        """
        replica, surfaces = self._replica, self._surfaces
        for rows, area, before in self._areas() if plans else ():
            for number, plan in plans.items():
                first, counts = points_of(area, before, plan.point_area, plan.point_set)
                for some in even_runs(counts, POINTS_AT_ONCE):
                    of_map = first[some], counts[some], replica.launcher, plan.point_set
                    yield number, *spread(surfaces, replica.cells, self._cell, rows(some), *of_map)

    def _areas(self) -> Iterator[tuple[Rows, NDArray[np.float64], NDArray[np.float64]]]:
        """Of the cell's triangles, some at a time: the rows of chosen ones; areas of all, and those before them."""
        yield _plain_rows, triangle_areas(self._surfaces.corners.numpy()), self._area_before
        areas = self._areas_of_instances
        for begin, end in areas.blocks():
            yield functools.partial(self._instance_rows, begin), areas.of(begin, end), areas.before(begin, end)

    def _instance_rows(self, begin: int, chosen: NDArray[np.intp]) -> NDArray[np.int32]:
        """Rows of triangles by how many numbers come before theirs from `begin` on, shape [N, 2]."""
        instances, prims = self._instances, chosen + begin
        which = instances.base.searchsorted(prims, side="right") - 1
        row = instances.shapes.first[instances.shape[which]] + prims - instances.base[which]
        return np.stack([row + len(self._surfaces.ids), which], axis=1).astype(np.int32)


def _plain_rows(chosen: NDArray[np.intp]) -> NDArray[np.int32]:
    """Rows of triangles of no instance."""
    return np.stack([chosen, np.full(len(chosen), -1)], axis=1).astype(np.int32)
