"""Checks of the top tree and of what its cells hold in outline."""

from __future__ import annotations

import numpy as np

from wdpm.cluster.messages.demands import Shape, indices, require
from wdpm.cluster.world import Outlines, TopTree

SHAPES_OF_CELLS: dict[type, dict[str, Shape]] = {
    TopTree: {"axis": ("inner nodes",), "split": ("inner nodes",)},
    Outlines: {
        "first": ("cells",),
        "low": ("boxes", 3),
        "high": ("boxes", 3),
        "plane": ("boxes",),
        "normal": ("planes", 3),
        "slab": ("planes", 3),
    },
}


def check_top_tree(tree: TopTree, where: str) -> None:
    """A power of two of cells, each with its boxes if any has."""
    require(tree.cells & (tree.cells - 1) == 0, where, f"{tree.cells} cells; expected a power of two")
    indices(tree.axis, 0, 3, f"{where}.axis")
    known = len(tree.outlines.first)
    require(known in (0, tree.cells + 1), where, f"outlines of {known - 1} cells; there are {tree.cells}")


def check_outlines(outlines: Outlines, where: str) -> None:
    """Boxes in order, none of them inside out; planes that are there."""
    first = outlines.first
    begins_and_ends = first[[0, -1]].tolist() if len(first) else [0, 0]
    ordered = begins_and_ends == [0, len(outlines)] and not np.any(np.diff(first.astype(np.int64)) < 0)
    require(ordered, where, f"boxes of cells are not in order, or not {len(outlines)}")
    for name in ("low", "high", "normal", "slab"):
        require(bool(np.isfinite(getattr(outlines, name)).all()), where, f"{name} has a value that is no number")
    require(not np.any(outlines.low > outlines.high), where, "a box ends before it begins")
    require(not np.any(outlines.slab[:, 0] > outlines.slab[:, 1]), where, "a slab ends before it begins")
    indices(outlines.plane, -1, len(outlines.normal), f"{where}.plane")
