"""What a render has learnt about where light comes from: which lights, and which parts of the sky, reach where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class LightGuide:
    """Regions of space, and how lights and directions to the environment are chosen in each (kernels.lights.guide).

    Attributes:
        axis, split: of the kd-tree whose leaves are the regions, in heap order, as of a TopTree; int32 and float32,
            shape [regions - 1].
        chance: probability of each tile of the environment, float32, shape [regions, rows, columns]; sums to 1.
            [regions, 0, 0] where only lights were learnt.
        starts: by which factor the heads of the light tree, and last all that is infinitely far away, count in a
            region, float32, shape [regions, choices of the light tree]; [regions, 0] where only tiles were learnt.
        distant: share of each light infinitely far away among these, float32, shape [regions, lights]; as `starts`.
    """

    axis: NDArray[np.int32]
    split: NDArray[np.float32]
    chance: NDArray[np.float32]
    starts: NDArray[np.float32]
    distant: NDArray[np.float32]

    def __len__(self) -> int:
        """How many regions there are; 0 where nothing was learnt."""
        return len(self.chance)


NO_GUIDE = LightGuide(
    np.empty(0, np.int32),
    np.empty(0, np.float32),
    np.empty((0, 0, 0), np.float32),
    np.empty((0, 0), np.float32),
    np.empty((0, 0), np.float32),
)
"""Of a view whose lights are chosen by what they would send if nothing stood in between."""
