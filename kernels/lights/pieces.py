"""Connected pieces of triangles: those that share corners, by the bits of their places (target_clusters).

One thread joins them one after another (union-find, Tarjan 1975): in a table of places each corner finds the first that
lies where it does, and two pieces become one under the smaller of their numbers, which is that of their first triangle.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_HASH_X = wp.constant(wp.uint64(0x9E3779B97F4A7C15))
_HASH_Y = wp.constant(wp.uint64(0xC2B2AE3D27D4EB4F))
_HASH_Z = wp.constant(wp.uint64(0x165667B19E3779F9))


@wp.func
def _slot(place: wp.array2d[wp.uint32], corner: wp.int32, shift: wp.uint64) -> wp.int32:
    """Where a search for a place begins: the upper bits of a hash."""
    x = wp.uint64(place[corner, 0]) * _HASH_X
    y = wp.uint64(place[corner, 1]) * _HASH_Y
    z = wp.uint64(place[corner, 2]) * _HASH_Z
    mixed = (x + y + z) ^ ((x + y + z) >> wp.uint64(29))
    return wp.int32((mixed * _HASH_X) >> shift)


@wp.func
def _root(piece: wp.array[wp.int32], triangle: wp.int32) -> wp.int32:
    """The first triangle of a piece; ways there become shorter on the way."""
    found = triangle
    while piece[found] != found:
        piece[found] = piece[piece[found]]
        found = piece[found]
    return found


@wp.kernel
def _join(
    place: wp.array2d[wp.uint32],
    shift: wp.uint64,
    table: wp.array[wp.int32],
    piece: wp.array[wp.int32],
) -> None:
    """Join all triangles that share a corner.

    Args:
        place: bits of the corners, three to a triangle, shape [3 T, 3].
        shift: bits of a hash that are left out to come to a slot of the table.
        table: -1 in each slot; more slots than corners, a power of two.
        piece: of each triangle its own number; in place, the first triangle of its piece.
    """
    mask = table.shape[0] - 1
    for corner in range(place.shape[0]):
        slot = _slot(place, corner, shift)
        other = table[slot]
        while other >= 0 and (
            place[other, 0] != place[corner, 0]
            or place[other, 1] != place[corner, 1]
            or place[other, 2] != place[corner, 2]
        ):
            slot = (slot + 1) & mask
            other = table[slot]
        if other < 0:
            table[slot] = corner
        else:
            one = _root(piece, corner // 3)
            two = _root(piece, other // 3)
            piece[wp.max(one, two)] = wp.min(one, two)
    for triangle in range(piece.shape[0]):
        piece[triangle] = _root(piece, triangle)


def pieces_of(corners: NDArray[np.float32]) -> NDArray[np.intp]:
    """Number of the first triangle of the connected piece that each triangle belongs to; shape [T].

    Args:
        corners: shape [T, 3, 3].
    """
    bits = np.ascontiguousarray(corners.reshape(-1, 3) + np.float32(0.0)).view(np.uint32)  # -0 becomes 0
    size = max(len(bits).bit_length() + 1, 8)
    piece = np.arange(len(corners), dtype=np.int32)
    table = np.full(1 << size, -1, np.int32)
    inputs = [
        wp.array(bits, dtype=wp.uint32, device="cpu", copy=False),
        wp.uint64(64 - size),
        wp.array(table, dtype=wp.int32, device="cpu", copy=False),
        wp.array(piece, dtype=wp.int32, device="cpu", copy=False),
    ]
    wp.launch(_join, 1, inputs=inputs, device="cpu")
    return piece.astype(np.intp)
