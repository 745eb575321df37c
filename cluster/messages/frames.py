"""Frames of arrays: the bytes of each, in pieces that are not too long."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from wdpm.scenes.errors import ProtocolError

FRAME_BYTES = 4 << 20
"""Longest frame. Larger arrays span several: a receiver's socket refuses longer frames before it reads them, so that
whoever has not even shown a key has little to fill memory with."""

Frame = bytes | bytearray | memoryview


def split(array: np.ndarray[Any, Any]) -> Sequence[memoryview]:
    """Frames of a contiguous array; none for an empty one."""
    size = array.nbytes
    if size:
        whole = array.data.cast("B")
        if size <= FRAME_BYTES:
            return (whole,)
        return [whole[start : start + FRAME_BYTES] for start in range(0, size, FRAME_BYTES)]
    return ()


class Frames:
    """Array frames, taken one after another."""

    def __init__(self, frames: Sequence[Frame]) -> None:
        self._frames = frames
        self._next = 0

    def array(self, dtype: np.dtype[Any], shape: tuple[int, ...], where: str) -> np.ndarray[Any, Any]:
        """The next array; ProtocolError if its frames are missing or of other lengths."""
        size = math.prod(shape) * dtype.itemsize
        if (
            0 < size <= FRAME_BYTES
            and self._next < len(self._frames)
            and len(frame := self._frames[self._next]) == size
        ):
            self._next += 1
            return np.ndarray(shape, dtype, frame)
        taken: list[Frame] = []
        for start in range(0, size, FRAME_BYTES):
            expected = min(FRAME_BYTES, size - start)
            if self._next == len(self._frames):
                raise ProtocolError(f"{where}: its frame is missing")
            frame = self._frames[self._next]
            if len(frame) != expected:
                raise ProtocolError(f"{where}: a frame of {len(frame)} bytes; {dtype} {shape} takes {expected}")
            self._next += 1
            taken.append(frame)
        whole = np.empty(size, np.uint8)
        for index, frame in enumerate(taken):
            whole[index * FRAME_BYTES : index * FRAME_BYTES + len(frame)] = np.frombuffer(frame, np.uint8)
        return whole.view(dtype).reshape(shape)

    def finish(self) -> None:
        """Raise ProtocolError if there are frames that no array took."""
        if self._next != len(self._frames):
            raise ProtocolError(f"{len(self._frames) - self._next} frames too many")
