"""Volumes as lattices in one array: what kernels read and what travels to slaves.

A lattice has nodes at whole coordinates. Where values are interpolated, a node is a value; what a wrap mode says of the
half voxel at the faces is told by one more layer of nodes around the grid. Where each voxel has one value, voxel i is
what lies between the coordinates i and i + 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.model.textures import Wrap
from wdpm.scenes.model.volumes import Volume

MOST_VALUES = 2**31 - 1
"""Values of all grids together: kernels count them with 32 bits. 8 GB, on every slave."""

WRAPS = (Wrap.CLAMP, Wrap.REPEAT, Wrap.MIRROR)
"""By the numbers that kernels know them by."""

_PADDING = {Wrap.CLAMP: "edge", Wrap.REPEAT: "wrap", Wrap.MIRROR: "symmetric"}


@dataclass(frozen=True, eq=False)
class Grids:
    """The lattices of a scene, one a row.

    Attributes:
        size: nodes along x, y and z, int32, shape [G, 3].
        to_lattice: from the renderer's space to coordinates of the lattice, float64, shape [G, 3, 4].
        low, high: opposite corners of the box that the grid fills, in those coordinates, float64, shape [G, 3].
        nearest: 1 where voxels have one value each, 0 where values are interpolated, int32, shape [G].
        wrap: how a colour goes on beyond the box, a number of WRAPS, int32, shape [G].
        channels: 1 or 3, int32, shape [G].
        values: of all lattices one after another, by z, y, x and channel, float32, shape [N].
    """

    size: NDArray[np.int32]
    to_lattice: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    nearest: NDArray[np.int32]
    wrap: NDArray[np.int32]
    channels: NDArray[np.int32]
    values: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.size)

    @property
    def voxels(self) -> int:
        """Values of all lattices."""
        return len(self.values)

    def lattice(self, number: int) -> NDArray[np.float32]:
        """The nodes of one lattice, shape [z, y, x, channels]."""
        x, y, z = self.size[number]
        channels = self.channels[number]
        start = int(self.starts[number])
        return self.values[start : start + int(x) * int(y) * int(z) * int(channels)].reshape(z, y, x, channels)

    @property
    def starts(self) -> NDArray[np.int64]:
        """Where each lattice begins in `values`, and where they end, shape [G + 1]."""
        counts = self.size.astype(np.int64).prod(axis=1) * self.channels
        return np.concatenate([[0], np.cumsum(counts)])


def tabulate_grids(volumes: Sequence[Volume]) -> Grids:
    """The lattices of volumes that lie in the renderer's space.

    Raises:
        SceneError: a volume fills no space, or there are too many values.
    """
    lattices = [_nodes(volume) for volume in volumes]
    if sum(nodes.size for nodes in lattices) > MOST_VALUES:
        raise SceneError(f"the grids of the scene have more than {MOST_VALUES:,} values; give them less resolution")
    boxes = [_box(volume) for volume in volumes]
    return Grids(
        size=np.array([nodes.shape[2::-1] for nodes in lattices], np.int32).reshape(-1, 3),
        to_lattice=np.array([_to_lattice(volume, *box) for volume, box in zip(volumes, boxes, strict=True)]).reshape(
            -1, 3, 4
        ),
        low=np.array([low for low, _ in boxes]).reshape(-1, 3),
        high=np.array([high for _, high in boxes]).reshape(-1, 3),
        nearest=np.array([volume.nearest for volume in volumes], np.int32),
        wrap=np.array([WRAPS.index(volume.wrap) for volume in volumes], np.int32),
        channels=np.array([nodes.shape[3] for nodes in lattices], np.int32),
        values=np.concatenate([nodes.reshape(-1) for nodes in lattices] or [np.zeros(0, np.float32)]),
    )


def _nodes(volume: Volume) -> NDArray[np.float32]:
    """Shape [z, y, x, channels]."""
    if volume.nearest or volume.at_corners:
        return volume.values
    around = ((1, 1), (1, 1), (1, 1), (0, 0))
    padded: NDArray[np.float32] = np.pad(volume.values, around, mode=_PADDING[volume.wrap])  # type: ignore[call-overload]
    return padded


def _box(volume: Volume) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lattice coordinates of the corners of the box that the volume fills."""
    voxels = np.array(volume.values.shape[2::-1], np.float64)
    if volume.nearest:
        return np.zeros(3), voxels
    if volume.at_corners:
        return np.zeros(3), voxels - 1.0
    return np.full(3, 0.5), voxels + 0.5


def _to_lattice(volume: Volume, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shape [3, 4]."""
    try:
        to_cube = np.linalg.inv(np.asarray(volume.to_world, np.float64))
    except np.linalg.LinAlgError:
        to_cube = np.full((4, 4), np.nan)
    matrix = (high - low)[:, None] * to_cube[:3]
    matrix[:, 3] += low
    if not np.isfinite(matrix).all():
        raise SceneError(f'volume "{volume.name}": its to_world transform leaves it no space')
    return np.asarray(matrix)
