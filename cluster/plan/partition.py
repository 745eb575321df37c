"""What each cell holds of the triangles: those that overlap it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.world import TopTree
from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.launch import Launcher
from wdpm.kernels.rays.cells import cell_boxes
from wdpm.kernels.rays.overlap import triangles_in_boxes
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.instances import Instances
from wdpm.scenes.flat.reach import instance_boxes


def instances_of_cells(instances: Instances, tree: TopTree, extent: float) -> list[NDArray[np.intp]]:
    """For each cell, the instances whose boxes meet it, ascending: it holds their shapes whole.

    Boxes and cells are both grown by far more than roundings, so a cell has whatever a ray in it can hit.
    """
    if tree.cells == 1:
        return [np.arange(len(instances))]
    low, high = cell_boxes(tree.axis, tree.split)
    own_low, own_high = instance_boxes(instances)
    grow = 2.0 * PAD_SHARE * extent
    return [
        np.flatnonzero(((own_low <= high[cell] + grow) & (own_high >= low[cell] - grow)).all(axis=1))
        for cell in range(tree.cells)
    ]


def places_to_cut(triangles: Triangles) -> NDArray[np.float32]:
    """What planes are weighed by: the triangles that are held, and a triangle across the box of each instance.

    Returns:
        float32, shape [N, 3, 3].
    """
    if not len(triangles.instances):
        return triangles.positions
    low, high = (corner.astype(np.float32) for corner in instance_boxes(triangles.instances))
    return np.concatenate([triangles.positions, np.stack([low, high, low], axis=1)])


def rows_of_cells(
    corners: NDArray[np.float32], tree: TopTree, extent: float, launcher: Launcher
) -> list[NDArray[np.intp]]:
    """For each cell, the rows of the triangles that overlap it, ascending.

    Cells are grown by twice the pad: routing grows them once, so a ray whose interval in a cell is rounded outwards
    still finds there every triangle that it can hit.
    """
    if tree.cells == 1:
        return [np.arange(len(corners))]
    low, high = cell_boxes(tree.axis, tree.split)
    grow = 2.0 * PAD_SHARE * extent
    reach = 4.0 * extent  # beyond everything, and near enough for the test's arithmetic
    inside = triangles_in_boxes(
        corners,
        np.maximum(low.astype(np.float64) - grow, -reach),
        np.minimum(high.astype(np.float64) + grow, reach),
        launcher,
    )
    return [np.flatnonzero(inside[:, cell]) for cell in range(tree.cells)]
