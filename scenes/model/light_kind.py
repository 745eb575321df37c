"""What each kind of light without area says of itself: its number, what it calls for, what it writes into the table.

The kind of a data class is its KIND (lights.py); what kernels do for it is in its module of kernels.lights.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

NUMBERS: Final = 4
"""Numbers of a row of the light table that each kind of light gives its own meaning."""

ALL_AROUND: Final = -1.0
"""Cosine of the half angle of a light that shines in all directions."""


@dataclass(frozen=True, eq=False)
class LightKind:
    """A kind of light without area (a "delta light": one direction leads to it, which no other sampling finds).

    Attributes:
        number: in LightTable.delta_kind; those of distant kinds are above those of all others.
        name: what people call such a light.
        feature: the field of kernels.features.Features with which its code is compiled.
        distant: whether it is infinitely far away.
        numbers: names of the numbers of its rows, at most NUMBERS.
    """

    number: int
    name: str
    feature: str
    distant: bool = False
    numbers: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class LightRow:
    """A delta light as a row of the light table.

    Attributes:
        color: its strength: intensity [W/sr]; of one infinitely far away the irradiance across its direction [W/m²].
        position: zero for one that is infinitely far away.
        axes: rows are its axes in the world; it shines along the third. Zero where it has none.
        cutoff: cosine of the half angle about its axis beyond which there is no light.
        numbers: as LightKind.numbers names them.
    """

    color: tuple[float, float, float]
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axes: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 3)))
    cutoff: float = ALL_AROUND
    numbers: tuple[float, ...] = ()
