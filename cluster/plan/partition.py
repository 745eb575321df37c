"""What each cell holds of the triangles: those that overlap it; and boxes around them, for all to know."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.world import NO_OUTLINES, Outlines, TopTree
from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.launch import Launcher
from wdpm.kernels.rays.cells import cell_boxes
from wdpm.kernels.rays.outline_build import NO_ITEMS, Items, build_outlines
from wdpm.kernels.rays.overlap import triangles_in_boxes
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.instances import Instances
from wdpm.scenes.flat.reach import instance_boxes
from wdpm.scenes.flat.room import let_go

MOST_WEIGHED = 1 << 20
"""Triangles that planes are weighed by."""

AT_ONCE = 1 << 20
"""Triangles that are held against all cells in one launch, so that its arrays stay small."""


def instances_of_cells(instances: Instances, tree: TopTree, extent: float, band: float = 0.0) -> list[NDArray[np.intp]]:
    """For each cell, the instances whose boxes meet it, or the band about it, ascending: it holds their shapes whole.

    Boxes and cells are both grown by far more than roundings, so a cell has whatever a ray in it can hit.
    """
    if tree.cells == 1:
        return [np.arange(len(instances))]
    low, high = cell_boxes(tree.axis, tree.split)
    own_low, own_high = instance_boxes(instances)
    grow = 2.0 * PAD_SHARE * extent + band
    return [
        np.flatnonzero(((own_low <= high[cell] + grow) & (own_high >= low[cell] - grow)).all(axis=1))
        for cell in range(tree.cells)
    ]


def places_to_cut(triangles: Triangles) -> NDArray[np.float32]:
    """What planes are weighed by: the triangles that are held, and a triangle across the box of each instance.

    Of very many these are some at even distances, which weigh as well.

    Returns:
        float32, shape [N, 3, 3].
    """
    places = triangles.positions
    if len(triangles.instances):
        low, high = (corner.astype(np.float32) for corner in instance_boxes(triangles.instances))
        places = np.concatenate([places, np.stack([low, high, low], axis=1)])
    return places[:: -(-len(places) // MOST_WEIGHED)] if len(places) > MOST_WEIGHED else places


def rows_of_cells(
    corners: NDArray[np.float32], tree: TopTree, extent: float, launcher: Launcher, band: float = 0.0
) -> list[NDArray[np.intp]]:
    """For each cell, the rows of the triangles that overlap it, or the band about it, ascending.

    Cells are grown by twice the pad: routing grows them once, so a ray whose interval in a cell is rounded outwards
    still finds there every triangle that it can hit.

    Args:
        band: how wide it is: walls are felt for from photons there (kernels.photons.walls) [scene units].
    """
    if tree.cells == 1:
        return [np.arange(len(corners))]
    low, high = cell_boxes(tree.axis, tree.split)
    grow = 2.0 * PAD_SHARE * extent + band
    reach = 4.0 * extent  # beyond everything, and near enough for the test's arithmetic
    grown_low = np.maximum(low.astype(np.float64) - grow, -reach)
    grown_high = np.minimum(high.astype(np.float64) + grow, reach)
    rows: list[list[NDArray[np.intp]]] = [[] for _ in range(tree.cells)]
    for first in range(0, len(corners), AT_ONCE):
        inside = triangles_in_boxes(corners[first : first + AT_ONCE], grown_low, grown_high, launcher)
        for cell, found in enumerate(rows):
            found.append(np.flatnonzero(inside[:, cell]) + first)
        let_go(corners[first : first + AT_ONCE])
    return [np.concatenate(found) for found in rows]


def outlines_of(
    triangles: Triangles,
    tree: TopTree,
    rows: Sequence[NDArray[np.intp]],
    instances: Sequence[NDArray[np.intp]],
    extent: float,
) -> Outlines:
    """What cells hold in outline; nothing is known where there is one cell.

    Args:
        rows: of the triangles that each cell holds.
        instances: that each cell holds.
    """
    if tree.cells == 1:
        return NO_OUTLINES
    standing = [NO_ITEMS] * tree.cells
    if len(triangles.instances):
        low, high = instance_boxes(triangles.instances)
        standing = [Items(low[held], high[held], np.full(len(held), -1)) for held in instances]
    boxes = cell_boxes(tree.axis, tree.split)
    return Outlines(**build_outlines(triangles.positions, triangles.emitter, boxes, rows, standing, extent))
