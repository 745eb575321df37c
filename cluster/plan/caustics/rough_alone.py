"""Materials of which only what is rough is glossy."""

from __future__ import annotations

from dataclasses import replace

from wdpm.kernels.materials.types import DIFFUSE
from wdpm.scenes.flat.material_table import MaterialTable
from wdpm.scenes.model.leaf_kind import BLACK

GREY = 0.5
"""Photons are stored on it; what it reflects of them is no caustic any more."""


def rough_alone(table: MaterialTable) -> MaterialTable | None:
    """The same materials, but what is smooth reflects by diffuse parts alone; None if nothing glossy is rough.

    Panes, through which light goes straight on, stay as they are.
    """
    kind, value, texture = table.kind.copy(), table.value.copy(), table.texture.copy()
    rough = False
    for node in range(len(table)):
        leaf = table.leaf(node)
        if leaf is None or not leaf[0].glossy:
            continue
        of, row = leaf
        if of.always_rough or of.is_rough(row):
            rough = True
        elif not of.straight:
            kind[node] = int(DIFFUSE) if of.gathers(row) else BLACK
            value[node], texture[node] = GREY, -1
    return replace(table, kind=kind, value=value, texture=texture) if rough else None
