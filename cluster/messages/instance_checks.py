"""Checks of instances that came over the wire."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.messages.demands import Shape, indices, require
from wdpm.scenes.flat.instances import Instances, Shapes

MOST_AREA = 1e15
"""Of all surfaces, in the renderer's space, where no coordinate is above 1: far more than triangles can have."""

SHAPES_OF_INSTANCES: dict[type, dict[str, Shape]] = {
    Shapes: {
        "first": ("shapes + 1",),
        "corners": ("triangles", 3, 3),
        "normals": ("triangles", 3, 3),
        "uvs": ("triangles", 3, 2),
        "material": ("triangles",),
        "colors": ("colored", 3, 3),
        "share_before": ("triangles",),
    },
    Instances: {
        "shape": ("instances",),
        "base": ("instances",),
        "matrix": ("instances", 3, 4),
        "normal_matrix": ("instances", 3, 3),
        "mirrored": ("instances",),
        "area_before": ("instances",),
        "area": ("instances",),
    },
}
"""Shapes of arrays by class and field, as checks.SHAPES."""


def check_shapes(shapes: Shapes, where: str) -> None:
    first, count = shapes.first, len(shapes.material)
    require(len(first) > 0 and first[0] == 0 and first[-1] == count, where, "first does not go from 0 to all triangles")
    require(bool((np.diff(first) > 0).all()), where, "first is not ascending")
    require(len(shapes.colors) in (0, count), where, f"colours of {len(shapes.colors)} triangles; there are {count}")
    sound = np.isfinite(shapes.corners).all() and np.isfinite(shapes.normals).all()
    require(bool(sound), where, "corners or normals that are not finite")
    within = (shapes.share_before >= 0) & (shapes.share_before <= 1)
    require(bool(within.all()), where, "share_before is not between 0 and 1")


def check_instances(instances: Instances, where: str) -> None:
    indices(instances.shape, 0, len(instances.shapes), f"{where}.shape")
    indices(instances.mirrored, 0, 2, f"{where}.mirrored")
    ends = instances.base.astype(np.int64) + instances.sizes
    require(bool((instances.base[1:] >= ends[:-1]).all()), where, "numbers of triangles overlap")
    indices(instances.base, 0, 2**31, f"{where}.base")
    indices(ends, 0, 2**31, f"{where}: last numbers")
    check_area_before(instances.area_before, where)
    check_area_before(instances.area, where)
    with np.errstate(all="ignore"):
        size = np.abs(np.linalg.det(instances.matrix[:, :, :3]))
        sound = np.isfinite(instances.matrix).all() and np.isfinite(instances.normal_matrix).all()
    require(bool(sound and (size > 0).all()), where, "a matrix that is not finite, or without an inverse")


def check_area_before(area: NDArray[np.float64], where: str) -> None:
    """Raise ProtocolError unless areas can be divided into points."""
    require(bool(((area >= 0) & (area <= MOST_AREA)).all()), where, "an area before a triangle that cannot be")
