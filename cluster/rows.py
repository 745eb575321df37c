"""Rows of arrays: taken, put, compared and added, each in the way that NumPy does fastest.

Most arrays of a batch have a vector in each row. There, indexing and reductions along the short axis cost six to
twenty-five times what these do, which give the same bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Indices = NDArray[np.integer[Any]]

_BITS = 63
"""Of numbers from 0 on, as NumPy sorts them."""


def take_rows(array: Array, rows: Indices) -> Array:
    """Some rows, as a copy; IndexError if there is no such row."""
    return array.take(rows, axis=0)


def put_rows(array: Array, rows: Indices, values: Array) -> None:
    """Set some rows.

    Args:
        array: contiguous, shape [N] or [N, 3].
        values: one row each.
    """
    if array.ndim == 1:
        array[rows] = values
    else:
        _whole_rows(array)[rows] = _whole_rows(np.ascontiguousarray(values, array.dtype))


def _whole_rows(vectors: Array) -> Array:
    """Each row as one item, shape [N] for [N, 3]."""
    return vectors.view(np.dtype((np.void, vectors.itemsize * vectors.shape[1]))).reshape(len(vectors))


def any_of(vectors: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which vectors are not 0, shape [N] for [N, 3]; those with a NaN are not."""
    lit: NDArray[np.bool_] = (vectors[:, 0] != 0) | (vectors[:, 1] != 0) | (vectors[:, 2] != 0)
    return lit


def largest_of(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """The largest component of each vector, shape [N] for [N, 3]; NaN where one is."""
    return np.maximum(np.maximum(vectors[:, 0], vectors[:, 1]), vectors[:, 2])


def in_order(slot: NDArray[np.int32], place: NDArray[np.int32]) -> NDArray[np.intp]:
    """Rows by slot, then by place, equal ones as they come. Neither may be negative."""
    places, rows = (int(number).bit_length() for number in (place.max(initial=0), len(place)))
    slots = int(slot.max(initial=0)).bit_length()
    if slots + places + rows > _BITS:
        return np.argsort((slot.astype(np.int64) << np.int64(32)) | place, kind="stable")
    # Numbers that say slot, place and row, all different: NumPy sorts those several times as fast.
    key = (slot.astype(np.int64) << np.int64(places)) | place
    key = (key << np.int64(rows)) | np.arange(len(key))
    key.sort()
    return key & np.int64((1 << rows) - 1)


def summed(slot: NDArray[np.int32], vectors: NDArray[np.float32], slots: int) -> NDArray[np.float64]:
    """What the vectors of each slot add up to, one after another, float64, shape [slots, 3]."""
    if not len(slot):  # of which NumPy makes whole numbers
        return np.zeros((slots, 3))
    return np.stack([np.bincount(slot, vectors[:, channel], slots) for channel in range(3)], axis=1)
