"""An array of rows that grows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray


class Growing:
    """Rows, one after another in memory, of which there is one copy at any time: a bytearray moves its pages.

    Args:
        width: of a row; None for single values.
    """

    def __init__(self, dtype: DTypeLike, width: int | None = None) -> None:
        self._dtype = np.dtype(dtype)
        self._shape = () if width is None else (width,)
        self._bytes = bytearray()
        self._length = 0

    def __len__(self) -> int:
        return self._length

    def add(self, rows: NDArray[Any]) -> None:
        """Appends rows."""
        if len(rows):
            self._bytes += np.ascontiguousarray(rows, self._dtype).data.cast("B")
            self._length += len(rows)

    def copied(self) -> NDArray[Any]:
        """A copy of all rows."""
        return np.frombuffer(bytes(self._bytes), self._dtype).reshape(-1, *self._shape)

    def taken(self) -> NDArray[Any]:
        """All rows; nothing is left."""
        rows = np.frombuffer(self._bytes, self._dtype).reshape(-1, *self._shape)
        self._bytes, self._length = bytearray(), 0
        return rows
