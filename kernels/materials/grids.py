"""Grids of numbers in space: what is at a point, and blocks of voxels that are of one value throughout.

The lattices are those of scenes.flat.grids. A lattice of nodes has cells between them; where values are interpolated,
the nodes of a cell are its corners, and where each voxel has one value, a cell has one node. Blocks are BLOCK cells a
side: their least and largest values let a walk step over what is empty, or of one value, at once (grid_walks).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.scenes.flat.grids import WRAPS
from wdpm.scenes.flat.grids import Grids as GridTable
from wdpm.scenes.model.textures import Wrap

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK: Final = 8
"""Cells of a block's side."""

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))

_CLAMP, _REPEAT = wp.constant(WRAPS.index(Wrap.CLAMP)), wp.constant(WRAPS.index(Wrap.REPEAT))


@wp.struct
class Grids:
    """All grids of a scene on a device, one an element; scenes.flat.grids says what most of this is.

    Attributes:
        rotation, shift: to_lattice.
        last: the last cell along each axis.
        start, block_start: the first element of each grid in `values`, and in `least` and `most`.
        blocks: blocks along each axis.
        least, most: of the nodes of each block, those on its faces included; of grids with one channel.
    """

    rotation: wp.array[wp.mat33d]
    shift: wp.array[wp.vec3d]
    low: wp.array[wp.vec3d]
    high: wp.array[wp.vec3d]
    size: wp.array[wp.vec3i]
    last: wp.array[wp.vec3i]
    blocks: wp.array[wp.vec3i]
    nearest: wp.array[wp.int32]
    wrap: wp.array[wp.int32]
    channels: wp.array[wp.int32]
    start: wp.array[wp.int32]
    block_start: wp.array[wp.int32]
    values: wp.array[wp.float32]
    least: wp.array[wp.float32]
    most: wp.array[wp.float32]


@wp.struct
class Corners:
    """Values at the corners of a cell, x before y: near with the lower z, far with the higher."""

    near: wp.vec4d
    far: wp.vec4d


def upload(table: GridTable, device: str) -> Any:
    """The grids on a device.

    Returns:
        Grids.
    """
    blocks = [_blocks(table.lattice(number), bool(table.nearest[number])) for number in range(len(table))]
    cells = table.size - np.where(table.nearest, 0, 1)[:, None] if len(table) else table.size
    counts = [least.size for least, _ in blocks]
    grids = Grids()
    grids.rotation = wp.array(table.to_lattice[:, :, :3], dtype=wp.mat33d, device=device)
    grids.shift = wp.array(table.to_lattice[:, :, 3], dtype=wp.vec3d, device=device)
    grids.low = wp.array(table.low, dtype=wp.vec3d, device=device)
    grids.high = wp.array(table.high, dtype=wp.vec3d, device=device)
    grids.size = wp.array(table.size, dtype=wp.vec3i, device=device)
    grids.last = wp.array(np.maximum(cells - 1, 0), dtype=wp.vec3i, device=device)
    sides = np.array([least.shape[::-1] for least, _ in blocks], np.int32).reshape(-1, 3)
    grids.blocks = wp.array(sides, dtype=wp.vec3i, device=device)
    grids.nearest = wp.array(table.nearest, dtype=wp.int32, device=device)
    grids.wrap = wp.array(table.wrap, dtype=wp.int32, device=device)
    grids.channels = wp.array(table.channels, dtype=wp.int32, device=device)
    grids.start = wp.array(table.starts[:-1].astype(np.int32), dtype=wp.int32, device=device)
    grids.block_start = wp.array(np.cumsum([0, *counts])[:-1].astype(np.int32), dtype=wp.int32, device=device)
    grids.values = wp.array(table.values, dtype=wp.float32, device=device)
    grids.least = wp.array(_joined([least for least, _ in blocks]), dtype=wp.float32, device=device)
    grids.most = wp.array(_joined([most for _, most in blocks]), dtype=wp.float32, device=device)
    return grids


def _joined(parts: list[NDArray[np.float32]]) -> NDArray[np.float32]:
    return np.concatenate([part.reshape(-1) for part in parts] or [np.zeros(0, np.float32)])


def _blocks(nodes: NDArray[np.float32], nearest: bool) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Least and largest value of each block, shape [z, y, x]; of colours none are made."""
    if nodes.shape[3] != 1:
        return np.zeros((0, 0, 0), np.float32), np.zeros((0, 0, 0), np.float32)
    least = most = nodes[..., 0]
    for axis in range(3):
        least = _along(np.minimum, least, axis, nearest)
        most = _along(np.maximum, most, axis, nearest)
    return least, most


def _along(extreme: Any, values: NDArray[np.float32], axis: int, nearest: bool) -> NDArray[np.float32]:
    """The extreme of each BLOCK cells along one axis; the node that two blocks share counts in both."""
    nodes = values.shape[axis]
    starts = np.arange(0, max(nodes - (0 if nearest else 1), 1), BLOCK)
    inner = extreme.reduceat(values, starts, axis=axis)
    if nearest:
        return np.asarray(inner)
    return np.asarray(extreme(inner, np.take(values, np.minimum(starts + BLOCK, nodes - 1), axis=axis)))


@wp.func
def cell_at(place: wp.vec3d, least: wp.vec3i, most: wp.vec3i) -> wp.vec3i:
    """The cell that a place of a lattice lies in, or the nearest of a box of cells."""
    return wp.vec3i(
        wp.int32(wp.clamp(wp.floor(place[0]), wp.float64(least[0]), wp.float64(most[0]))),
        wp.int32(wp.clamp(wp.floor(place[1]), wp.float64(least[1]), wp.float64(most[1]))),
        wp.int32(wp.clamp(wp.floor(place[2]), wp.float64(least[2]), wp.float64(most[2]))),
    )


@wp.func
def within(place: wp.vec3d, cell: wp.vec3i) -> wp.vec3d:
    """A place as shares of a cell's sides, each in [0, 1]."""
    return wp.vec3d(
        wp.clamp(place[0] - wp.float64(cell[0]), _ZERO, _ONE),
        wp.clamp(place[1] - wp.float64(cell[1]), _ZERO, _ONE),
        wp.clamp(place[2] - wp.float64(cell[2]), _ZERO, _ONE),
    )


@wp.func
def corners_of(grids: wp.ref[Grids], grid: wp.int32, cell: wp.vec3i, channel: wp.int32) -> Corners:
    """The values of one channel at a cell's corners; of a voxel's one value eight times that."""
    size = grids.size[grid]
    channels = grids.channels[grid]
    first = grids.start[grid] + channels * ((cell[2] * size[1] + cell[1]) * size[0] + cell[0]) + channel
    c = Corners()
    if grids.nearest[grid] == 1:
        value = wp.float64(grids.values[first])
        c.near = wp.vec4d(value, value, value, value)
        c.far = c.near
        return c
    # A lattice of one node along an axis (a flat grid whose values lie at corners) has no second.
    x = channels * wp.min(size[0] - 1, 1)
    y = channels * size[0] * wp.min(size[1] - 1, 1)
    z = channels * size[0] * size[1] * wp.min(size[2] - 1, 1)
    c.near = wp.vec4d(
        wp.float64(grids.values[first]),
        wp.float64(grids.values[first + x]),
        wp.float64(grids.values[first + y]),
        wp.float64(grids.values[first + x + y]),
    )
    first += z
    c.far = wp.vec4d(
        wp.float64(grids.values[first]),
        wp.float64(grids.values[first + x]),
        wp.float64(grids.values[first + y]),
        wp.float64(grids.values[first + x + y]),
    )
    return c


@wp.func
def value_of(c: Corners, share: wp.vec3d) -> wp.float64:
    """Trilinear interpolation: never outside of what the corners have."""
    p = (_ONE - share[2]) * c.near + share[2] * c.far
    x = share[0]
    low = (_ONE - x) * p[0] + x * p[1]
    high = (_ONE - x) * p[2] + x * p[3]
    return (_ONE - share[1]) * low + share[1] * high


@wp.func
def lattice_place(grids: wp.ref[Grids], grid: wp.int32, position: wp.vec3) -> wp.vec3d:
    """A point of the scene in the coordinates of a lattice."""
    point = wp.vec3d(wp.float64(position[0]), wp.float64(position[1]), wp.float64(position[2]))
    return grids.rotation[grid] * point + grids.shift[grid]


@wp.func
def _wrapped(place: wp.float64, low: wp.float64, high: wp.float64, wrap: wp.int32) -> wp.float64:
    """The place between low and high that one along an axis stands for."""
    side = high - low
    if wrap == _CLAMP or (place >= low and place <= high) or side <= _ZERO or not wp.isfinite(place):
        return wp.clamp(place, low, high)
    turns = (place - low) / side
    if wrap == _REPEAT:
        turns -= wp.floor(turns)
    else:
        turns -= _TWO * wp.floor(turns / _TWO)
    if turns > _ONE:
        turns = _TWO - turns
    return wp.clamp(low + turns * side, low, high)


@wp.func
def color_at(grids: wp.ref[Grids], grid: wp.int32, position: wp.vec3) -> wp.vec3:
    """What a grid has at a point, or at the place of its box that stands for it: a number as grey."""
    inside = lattice_place(grids, grid, position)
    for axis in range(3):
        inside[axis] = _wrapped(inside[axis], grids.low[grid][axis], grids.high[grid][axis], grids.wrap[grid])
    cell = cell_at(inside, wp.vec3i(0, 0, 0), grids.last[grid])
    share = within(inside, cell)
    red = wp.float32(value_of(corners_of(grids, grid, cell, 0), share))
    if grids.channels[grid] == 1:
        return wp.vec3(red, red, red)
    green = wp.float32(value_of(corners_of(grids, grid, cell, 1), share))
    return wp.vec3(red, green, wp.float32(value_of(corners_of(grids, grid, cell, 2), share)))
