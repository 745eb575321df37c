"""What a render has learnt about where light comes from: lights, parts of the sky, and caustics."""

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


@dataclass(frozen=True, eq=False)
class CausticGuide:
    """Regions of space, and where paths go on in each to find caustics (kernels.camera.caustic_guide).

    Attributes:
        axis, split: of the kd-tree whose leaves are the regions, as of LightGuide; shape [regions - 1].
        first: of each region's lobes, and one more past the last, int32, shape [regions + 1]; empty for no regions.
        target: that a lobe's middle leads to from anywhere in its region, float32, shape [lobes, 3].
        rim: 1 - cos of the angle between a lobe's middle and its rim, above 0 and at most 1, float32, shape [lobes].
        share: probability of each lobe, float32, shape [lobes]; those of a region sum to 1.
        part: of the rays that go on in a region by diffuse parts, drawn from its lobes, below 1, float32, [regions].
    """

    axis: NDArray[np.int32]
    split: NDArray[np.float32]
    first: NDArray[np.int32]
    target: NDArray[np.float32]
    rim: NDArray[np.float32]
    share: NDArray[np.float32]
    part: NDArray[np.float32]

    def __len__(self) -> int:
        """How many regions there are; 0 where nothing was learnt."""
        return max(len(self.first) - 1, 0)


NO_CAUSTIC_GUIDE = CausticGuide(
    np.empty(0, np.int32),
    np.empty(0, np.float32),
    np.empty(0, np.int32),
    np.empty((0, 3), np.float32),
    np.empty(0, np.float32),
    np.empty(0, np.float32),
    np.empty(0, np.float32),
)
"""Of a view whose paths go on from diffuse surfaces by the cosine alone."""
