"""Which sides of a material photons are stored on: those where a diffuse part may be gathered."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat import material_table as mt
from wdpm.scenes.flat.material_table import MaterialTable

FRONT: Final = 1
BACK: Final = 2
THROUGH: Final = 4
"""Bit of what may show the light of its other side."""


def gathering_sides(table: MaterialTable) -> NDArray[np.int32]:
    """FRONT, BACK and THROUGH bits of every node, int32, shape [N].

    A surface whose diffuse part is black, whatever the textures, stores nothing: nobody would ask.
    """
    sides = np.zeros(len(table), np.int32)
    for node in reversed(range(len(table))):  # children come after their parents
        sides[node] = _sides_of(table, node, sides)
    return sides


def even_sides(table: MaterialTable) -> NDArray[np.int32]:
    """FRONT and BACK bits of every node, int32, shape [N]: sides whose diffuse part, if any, is even and unbent.

    What becomes of irradiance on such a side hardly depends on where the light came from. Sheets between two media
    count as none: what is seen of them is irradiance in the medium on the other side, and records know but the
    camera's.
    """
    other = np.zeros(len(table), np.int32)
    sides = gathering_sides(table)
    for node in reversed(range(len(table))):
        kind, leaf = int(table.kind[node]), table.leaf(node)
        bent = kind in (mt.BUMP_MAP, mt.NORMAL_MAP)
        own = sides[node] if bent or (leaf is not None and not leaf[0].even(leaf[1])) else 0
        other[node] = own | _sides_of(table, node, other) if kind in _INNER else own
    between_media = table.medium[:, 0] != table.medium[:, 1]
    other[between_media & ((sides & THROUGH) != 0)] = FRONT | BACK
    return sides & ~(other | THROUGH)


_INNER: Final = (mt.TWO_SIDED, mt.BLEND, mt.MASK, mt.BUMP_MAP, mt.NORMAL_MAP)


def _sides_of(table: MaterialTable, node: int, sides: NDArray[np.int32]) -> int:
    kind, child = int(table.kind[node]), table.child[node]
    if kind == mt.TWO_SIDED:
        through = int(sides[child[0]] | sides[child[1]]) & THROUGH
        return (int(sides[child[0]]) & FRONT) | (BACK if sides[child[1]] & FRONT else 0) | through
    if kind == mt.BLEND:
        return int(sides[child[0]] | sides[child[1]])
    if kind in (mt.MASK, mt.BUMP_MAP, mt.NORMAL_MAP):
        return int(sides[child[0]])
    leaf = table.leaf(node)
    if leaf is None or not leaf[0].gathers(leaf[1]):
        return 0
    return FRONT | BACK | THROUGH if leaf[0].through else FRONT
