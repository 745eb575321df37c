"""Top trees of one's own, for renders that must not depend on them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wdpm.cluster.plan import render_plan
from wdpm.cluster.world import TopTree
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.bounds import bounding_box
from wdpm.scenes.model.scene import Scene


@contextmanager
def with_tree(axis: Sequence[int], split: Sequence[float]) -> Iterator[None]:
    """Renders within use this top tree, in the renderer's coordinates; ask them for len(axis) + 1 cells."""
    tree = TopTree(np.array(axis, np.int32), np.array(split, np.float32))
    own = render_plan.build_top_tree
    render_plan.build_top_tree = lambda *_: tree  # type: ignore[assignment]
    try:
        yield
    finally:
        render_plan.build_top_tree = own


def planes(scene: Scene, levels: Sequence[tuple[int, float]]) -> tuple[list[int], list[float]]:
    """Axes and planes of a top tree that has the same plane in all nodes of a level: 2^len(levels) cells.

    Args:
        levels: axis and coordinate in the scene of each level's plane.
    """
    axes, splits = [], []
    for level, (axis, coordinate) in enumerate(levels):
        point = np.zeros(3)
        point[axis] = coordinate
        axes += [axis] * 2**level
        splits += [float(in_renderer(scene, point)[axis])] * 2**level
    return axes, splits


def in_renderer(scene: Scene, point: ArrayLike) -> NDArray[np.float32]:
    """A place of the scene in the renderer's coordinates, which are moved, and may be scaled: by the scene's box."""
    low, high = bounding_box(scene.meshes)
    corners = flatten(scene).triangles.positions.reshape(-1, 3).astype(np.float64)
    axis = int(np.argmax(high - low))
    scale = np.ptp(corners[:, axis]) / (high - low)[axis]
    scale = 1.0 if abs(scale - 1.0) < 1e-6 else scale
    return ((np.asarray(point, np.float64) - (low + high) / 2.0) * scale).astype(np.float32)
