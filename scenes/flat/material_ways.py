"""Facts about the trees of a MaterialTable that kernels rely on: parents, depth, and the ways straight through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat import material_table as mt
from wdpm.scenes.flat.material_table import MaterialTable
from wdpm.scenes.model.textures import Texture, VertexColors

DEPTH_MOST: Final = 16
"""Most nodes that are nested in one another above a leaf."""

STRAIGHT: Final = (*(number for number, kind in mt.LEAF_KINDS.items() if kind.straight), mt.MASK)
"""Kinds of nodes at which light may go straight through."""
_BENDING: Final = (mt.BUMP_MAP, mt.NORMAL_MAP)


@dataclass(frozen=True, eq=False)
class StraightWays:
    """The nodes at which light goes straight through, root by root.

    Attributes:
        parent: the node that each node is in, -1 for roots, int32, shape [N].
        end: where each row's nodes end in `node`, int32, shape [N]; they start where those of the row before end.
        node: of the kinds STRAIGHT, int32, shape [W]; in the order of their numbers.
    """

    parent: NDArray[np.int32]
    end: NDArray[np.int32]
    node: NDArray[np.int32]


def parents(table: MaterialTable) -> NDArray[np.int32]:
    """The node that each node is in, -1 for roots, int32, shape [N]."""
    parent = np.full(len(table), -1, np.int32)
    for place in (0, 1):
        inner = table.child[:, place]
        inside = inner >= 0
        parent[inner[inside]] = np.nonzero(inside)[0]
    return parent


def roots(table: MaterialTable) -> NDArray[np.intp]:
    """The rows of the materials themselves, which come first."""
    return np.nonzero(parents(table) < 0)[0]


def root_of(table: MaterialTable) -> NDArray[np.int32]:
    """The root of the tree that each node is in, int32, shape [N]."""
    parent = parents(table)
    root = np.arange(len(table), dtype=np.int32)
    for node in range(len(table)):  # children come after their parents
        if parent[node] >= 0:
            root[node] = root[parent[node]]
    return root


def straight_ways(table: MaterialTable) -> StraightWays:
    """The ways that light takes straight through each material; shared sides of a TWO_SIDED count once."""
    root = root_of(table)
    passing = np.nonzero(np.isin(table.kind, STRAIGHT))[0]
    node = passing[np.argsort(root[passing], kind="stable")]
    end = np.cumsum(np.bincount(root[passing], minlength=len(table)))
    return StraightWays(parents(table), end.astype(np.int32), node.astype(np.int32))


def follows_uv(table: MaterialTable) -> NDArray[np.bool_]:
    """Whether anything in each node's tree can tell the direction of the tangents, bool, shape [N]."""
    found = np.isin(table.kind, _BENDING)
    for node in range(len(table)):
        leaf = table.leaf(node)
        found[node] |= leaf is not None and leaf[0].tells_tangents(leaf[1])
    return _anywhere_inside(table, found)


def _anywhere_inside(table: MaterialTable, found: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether a property of nodes holds for one of each node's tree, bool, shape [N]."""
    inside = found.copy()
    for node in reversed(range(len(table))):
        for inner in table.child[node]:
            inside[node] |= inner >= 0 and inside[inner]
    return inside


def check_trees(table: MaterialTable) -> None:
    """What kernels cannot do is told.

    Raises:
        SceneError: nodes are nested deeper than DEPTH_MOST, or the two sides of a surface let light through, each in
            its own way.
    """
    depth = np.zeros(len(table), np.int64)
    for node in reversed(range(len(table))):
        inner = table.child[node]
        if (inner >= 0).any():
            depth[node] = 1 + depth[inner[inner >= 0]].max()
    if len(depth) and depth.max() > DEPTH_MOST:
        message = f"material {int(root_of(table)[int(np.argmax(depth))])}: {int(depth.max())} materials are nested"
        raise SceneError(f"{message} in one another; at most {DEPTH_MOST} are supported")
    passing = _anywhere_inside(table, np.isin(table.kind, STRAIGHT))
    for sides in np.nonzero(table.kind == mt.TWO_SIDED)[0]:
        front, back = table.child[sides]
        if front != back and (passing[front] or passing[back]):
            raise SceneError(
                f"material {int(root_of(table)[sides])}: the two sides of a surface cannot let light through, "
                "each in its own way; use one material for both"
            )


def check_bumps(table: MaterialTable, textures: Sequence[Texture]) -> None:
    """Raise SceneError for a bump map of heights at vertices: they have no slope by texture coordinates."""
    for node in np.nonzero(table.kind == mt.BUMP_MAP)[0]:
        height = textures[table.texture[node, 0]]
        if isinstance(height, VertexColors):
            raise SceneError(f'a bump map cannot read the vertex attribute "{height.name}": use an image')
