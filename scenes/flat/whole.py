"""What is asked of all of a scene's triangles, instances included: as a scene of copies answers, bit for bit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.instances import Instances
from wdpm.scenes.flat.reach import instance_boxes

BLOCK = 1 << 20
"""Triangles whose areas are in memory at once, at most."""


def total_area(triangles: Triangles) -> float:
    """The sum that NumPy makes of the areas of all triangles, in the order of their numbers."""
    if not len(triangles.instances):
        return float(triangle_areas(triangles.positions).sum())
    return _pairwise(_Areas(triangles), 0, triangles.total)


def area_by_material(triangles: Triangles, materials: int) -> NDArray[np.float64]:
    """The area of each material, shape [materials]; added in any order, so not to decide bits by."""
    area = np.zeros(materials)
    area += np.bincount(triangles.material, triangle_areas(triangles.positions), materials)
    shapes, sizes = triangles.instances.shapes, triangles.instances.sizes
    for instance in range(len(sizes)):
        own = shapes.material[triangles.instances.rows(instance)]
        area += np.bincount(own, triangle_areas(triangles.instances.positions(instance)), materials)
    return area


MOST_POSITIONS = 1 << 25
"""Triangles whose corners are in memory at once, at most: 1.2 GB."""


def positions_of(triangles: Triangles, chosen: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Corners of the triangles of some materials, in the order of their numbers, shape [N, 3, 3].

    Where there are more than anybody has room for, instances stand as the boxes that hold them, two triangles each.

    Args:
        chosen: whether each material is, shape [materials].
    """
    plain = chosen[triangles.material]
    instances = triangles.instances
    of_shapes = chosen[instances.shapes.material]
    some = [i for i in range(len(instances)) if of_shapes[instances.rows(i)].any()]
    if not some:
        return triangles.positions[plain]
    if sum(int(of_shapes[instances.rows(i)].sum()) for i in some) > MOST_POSITIONS:
        return np.concatenate([triangles.positions[plain], *_boxes(instances, some)])
    parts = [triangles.positions[plain], *(instances.positions(i)[of_shapes[instances.rows(i)]] for i in some)]
    ids = [triangles.ids[plain], *(instances.ids(i)[of_shapes[instances.rows(i)]] for i in some)]
    positions: NDArray[np.float32] = np.concatenate(parts)[np.argsort(np.concatenate(ids), kind="stable")]
    return positions


def _boxes(instances: Instances, some: list[int]) -> list[NDArray[np.float32]]:
    """Two triangles for each of some instances, whose corners span its box."""
    low, high = instance_boxes(instances)
    low, high = low[some].astype(np.float32), high[some].astype(np.float32)
    mixed = [np.where([axis == a for axis in range(3)], high, low) for a in range(3)]
    return [np.stack([low, mixed[0], mixed[1]], axis=1), np.stack([high, mixed[2], low], axis=1)]


def _pairwise(areas: _Areas, begin: int, end: int) -> float:
    """NumPy's sum of a range of the areas: halved as NumPy does it, until a part is short enough to be computed."""
    count = end - begin
    if count <= BLOCK:
        return float(areas.of(begin, end).sum())
    half = count // 2
    half -= half % 8
    return _pairwise(areas, begin, begin + half) + _pairwise(areas, begin + half, end)


class _Areas:
    """Areas by ranges of triangles' numbers."""

    def __init__(self, triangles: Triangles) -> None:
        self._triangles = triangles
        self._ends = triangles.instances.base.astype(np.int64) + triangles.instances.sizes
        self._last: tuple[int, NDArray[np.float64]] = (-1, np.zeros(0))

    def of(self, begin: int, end: int) -> NDArray[np.float64]:
        """The areas of triangles begin to end - 1."""
        areas = np.zeros(end - begin)
        plain = self._triangles
        rows = slice(int(plain.ids.searchsorted(begin)), int(plain.ids.searchsorted(end)))
        areas[plain.ids[rows] - begin] = triangle_areas(plain.positions[rows])
        for instance in self._touched(begin, end):
            base = int(plain.instances.base[instance])
            low, high = max(begin, base), min(end, int(self._ends[instance]))
            areas[low - begin : high - begin] = self._instance(instance)[low - base : high - base]
        return areas

    def _touched(self, begin: int, end: int) -> Iterator[int]:
        first = int(self._ends.searchsorted(begin, side="right"))
        last = int(self._triangles.instances.base.searchsorted(end))
        yield from range(first, last)

    def _instance(self, instance: int) -> NDArray[np.float64]:
        """Areas of an instance; the last one is often asked for again."""
        if self._last[0] != instance:
            self._last = instance, triangle_areas(self._triangles.instances.positions(instance))
        return self._last[1]
