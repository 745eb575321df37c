"""How far the triangles of a scene reach, instances included: only those are looked at that may reach farthest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.instances import Instances

Boxes = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Low and high corners of boxes, shape [I, 3] each."""

ROUNDINGS = 2.0**-22
"""By what boxes are grown, of their instance's largest coordinate: several roundings to single precision."""


def instance_boxes(instances: Instances) -> Boxes:
    """Boxes in the renderer's space that certainly hold each instance."""
    low = np.zeros((len(instances.shapes), 3))
    high = np.zeros((len(instances.shapes), 3))
    for shape, (start, end) in enumerate(zip(instances.shapes.first[:-1], instances.shapes.first[1:], strict=True)):
        low[shape] = instances.shapes.corners[start:end].min(axis=(0, 1))
        high[shape] = instances.shapes.corners[start:end].max(axis=(0, 1))
    low, high = low[instances.shape], high[instances.shape]
    linear, offset = instances.matrix[:, :, :3], instances.matrix[:, :, 3]
    middle = np.einsum("iab,ib->ia", linear, (low + high) / 2.0) + offset
    reach = np.einsum("iab,ib->ia", np.abs(linear), (high - low) / 2.0)
    size = np.einsum("iab,ib->ia", np.abs(linear), np.maximum(np.abs(low), np.abs(high))) + np.abs(offset)
    grow = ROUNDINGS * size.max(axis=1, initial=0.0, keepdims=True)
    return middle - reach - grow, middle + reach + grow


def largest_coordinate(triangles: Triangles) -> float:
    """The largest absolute coordinate of any corner."""
    return _farthest(triangles, lambda low, high: np.maximum(-low, high).max(axis=1), _coordinate)


def radius_about_origin(triangles: Triangles) -> float:
    """The largest distance of any corner from the origin."""
    return _farthest(
        triangles, lambda low, high: np.sqrt((np.maximum(np.abs(low), np.abs(high)) ** 2).sum(axis=1)), _distance
    )


def _farthest(
    triangles: Triangles,
    bound: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]],
    measure: Callable[[NDArray[np.float32]], float],
) -> float:
    found = measure(triangles.positions)
    instances = triangles.instances
    if len(instances):
        most = bound(*instance_boxes(instances)) * (1.0 + ROUNDINGS)
        for instance in np.argsort(-most):
            if most[instance] <= found:
                break
            found = max(found, measure(instances.positions(int(instance))))
    return found


def _coordinate(positions: NDArray[np.float32]) -> float:
    return float(max(positions.max(initial=0.0), -positions.min(initial=0.0)))


def _distance(positions: NDArray[np.float32]) -> float:
    blocks = (positions[first : first + _AT_ONCE] for first in range(0, len(positions), _AT_ONCE))
    squares = ((block.astype(np.float64) ** 2).sum(axis=2).max(initial=0.0) for block in blocks)
    return float(np.sqrt(max(squares, default=0.0)))


_AT_ONCE = 1 << 16
"""Triangles that are looked at together: in double, all would be held thrice."""
