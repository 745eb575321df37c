"""What is asked of all of a scene's triangles, instances included: as a scene of copies answers, bit for bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.instances import Instances
from wdpm.scenes.flat.reach import instance_boxes

BLOCK = 1 << 20
"""Triangles whose areas are in memory at once, at most."""


AreasOf = Callable[[int, int], NDArray[np.float64]]
"""Areas of the triangles with the global numbers begin to end - 1, 0 for those of no instance."""


def total_area(triangles: Triangles, of_instances: AreasOf) -> float:
    """The sum that NumPy makes of the areas of all triangles, in the order of their numbers.

    Args:
        of_instances: kernels.rays.instance_areas has it.
    """
    if not len(triangles.instances):
        return float(triangle_areas(triangles.positions).sum())
    return _pairwise(triangles, of_instances, 0, triangles.total)


def area_by_material(triangles: Triangles, materials: int, of_instances: AreasOf) -> NDArray[np.float64]:
    """The area of each material, shape [materials]; added in any order, so not to decide bits by."""
    area = np.zeros(materials)
    area += np.bincount(triangles.material, triangle_areas(triangles.positions), materials)
    instances = triangles.instances
    ends = instances.base.astype(np.int64) + instances.sizes
    for run in _runs(instances.base.tolist(), ends.tolist()):
        begin = int(instances.base[run[0]])
        areas = of_instances(begin, int(ends[run[-1]]))
        for instance in run:
            own = slice(int(instances.base[instance]) - begin, int(ends[instance]) - begin)
            area += np.bincount(instances.shapes.material[instances.rows(instance)], areas[own], materials)
    return area


def _runs(begins: list[int], ends: list[int]) -> Iterator[range]:
    """Instances one after another whose numbers are within a block, but for those that are larger themselves."""
    first = 0
    for number, end in enumerate(ends):
        if number > first and end - begins[first] > BLOCK:
            yield range(first, number)
            first = number
    if ends:
        yield range(first, len(ends))


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


def _pairwise(triangles: Triangles, of_instances: AreasOf, begin: int, end: int) -> float:
    """NumPy's sum of a range of the areas: halved as NumPy does it, until a part is short enough to be computed."""
    count = end - begin
    if count <= BLOCK:
        areas = of_instances(begin, end)
        rows = slice(int(triangles.ids.searchsorted(begin)), int(triangles.ids.searchsorted(end)))
        areas[triangles.ids[rows] - begin] = triangle_areas(triangles.positions[rows])
        return float(areas.sum())
    half = count // 2
    half -= half % 8
    return _pairwise(triangles, of_instances, begin, begin + half) + _pairwise(
        triangles, of_instances, begin + half, end
    )
