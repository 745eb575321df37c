"""What each cell holds of the triangles: those that overlap it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.world import TopTree
from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.launch import Launcher
from wdpm.kernels.rays.cells import cell_boxes
from wdpm.kernels.rays.overlap import triangles_in_boxes


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


def deal(burdens: NDArray[np.float64], workers: int) -> list[int]:
    """Hand cells to workers so that the heaviest load is light: heaviest cell first, to whoever has least.

    Args:
        burdens: what each cell weighs, shape [cells]; at least as many cells as workers.

    Returns:
        The worker that holds each cell. Every worker gets a cell.
    """
    load = np.zeros(workers)
    holders = [0] * len(burdens)
    for cell in np.argsort(-burdens, kind="stable"):
        empty = np.flatnonzero(load == 0)
        worker = int(empty[0]) if len(empty) else int(np.argmin(load))
        holders[cell] = worker
        load[worker] += max(float(burdens[cell]), np.finfo(np.float64).tiny)
    return holders
