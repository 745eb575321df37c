"""The coats of all plastics of a table, computed once: a fit in double, which other machines might round otherwise."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from wdpm.scenes.flat.material_table import MaterialTable
from wdpm.scenes.flat.plastic_coat import coat
from wdpm.scenes.model.bsdfs import Distribution, Plastic

OUTER: Final = 6
"""Slot of c0, c1 and c2 of the coat's transmittance (scenes/flat/plastic_coat.py)."""
INNER: Final = 7
"""Slot of c3, c4 and c5."""
INTERNAL: Final = 8
"""Slot of the internal reflectance, of 1 where the coat has been computed, and of the mean transmittance."""
GRAZING: Final = 9
"""Slot of the grazing gain."""


def with_coats(table: MaterialTable) -> MaterialTable:
    """The table with the coats of its plastics; those that are there stay."""
    missing = np.nonzero((table.kind == Plastic.KIND.number) & (table.value[:, INTERNAL, 1] == 0.0))[0]
    if len(missing) == 0:
        return table
    value, slots = table.value.copy(), Plastic.KIND.slots
    for row in missing:
        distribution = Distribution.GGX if table.distribution[row] == 1 else Distribution.BECKMANN
        found = coat(float(value[row, slots["eta"], 0]), float(value[row, slots["alpha"], 0]), distribution)
        value[row, OUTER] = found.coefficients[:3]
        value[row, INNER] = found.coefficients[3:]
        value[row, INTERNAL] = (found.internal_reflectance, 1.0, found.mean_transmittance)
        value[row, GRAZING] = found.grazing_gain
    return replace(table, value=value)
