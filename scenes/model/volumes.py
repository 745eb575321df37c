"""Volumes: numbers or colours in a grid of voxels, and where the grid lies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.model.textures import Wrap


@dataclass(frozen=True, eq=False)
class Volume:
    """A grid of voxels that fills a box. Outside of its box there is nothing.

    Attributes:
        name: for messages: the file it came from.
        values: float32, shape [z, y, x, 1] for numbers, [z, y, x, 3] for linear RGB.
        to_world: where the unit cube lies that the grid fills, float64, shape [4, 4].
        nearest: each voxel has one value throughout; else values are interpolated between voxels, trilinearly.
        at_corners: the outermost values lie on the box's faces (Mitsuba 0.6), not half a voxel within (Mitsuba 3).
        wrap: how a colour goes on beyond the box, and what is interpolated with, half a voxel from the box's faces. The
            latter means nothing where `nearest` or `at_corners`.
    """

    name: str
    values: NDArray[np.float32]
    to_world: NDArray[np.float64]
    nearest: bool = False
    at_corners: bool = False
    wrap: Wrap = Wrap.CLAMP

    def __post_init__(self) -> None:
        """Values of another type become float32: kernels and the wire take nothing else."""
        object.__setattr__(self, "values", np.ascontiguousarray(self.values, np.float32))
