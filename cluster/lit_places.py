"""Where light straight from the lights falls: what reflects most of the light that gather rays look for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class LitPlaces:
    """A sample of such places, which together stand for all of that light.

    Attributes:
        position: float32, shape [P, 3].
        normal: unit geometric normal on the lit side, float32, shape [P, 3].
        power: that each stands for, mean of RGB [W], float32, shape [P].
        radius: how far its nearest neighbours lie, float32, shape [P]. Places and lengths are in the renderer's space.
    """

    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    power: NDArray[np.float32]
    radius: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.power)


NO_LIT_PLACES = LitPlaces(
    np.empty((0, 3), np.float32), np.empty((0, 3), np.float32), np.empty(0, np.float32), np.empty(0, np.float32)
)
"""Of a view whose irradiance records do without."""
