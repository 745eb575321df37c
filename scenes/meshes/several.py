"""Several parts of a file or of an array at a time."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

Part = TypeVar("Part")
Read = TypeVar("Read")


_AHEAD: Final = 2
"""Parts that are read for each thread before what is read of the first is taken: so that no thread waits for that."""


def in_threads(read: Callable[[Part], Read], parts: Iterable[Part]) -> Iterator[Read]:
    """What is read of each part, in order, in as many threads as there are cores: whole arrays let others compute.

    A few parts are in memory at a time. A single part is read without a thread; all have ended when this ends.

    Raises:
        Whatever `read` raises, for the first part of which it does.
    """
    remaining = iter(parts)
    ahead: list[Part] = []
    for part in remaining:
        ahead.append(part)
        if len(ahead) == 2:
            break
    threads = available_cores()
    if len(ahead) < 2 or threads == 1:
        yield from map(read, ahead)
        yield from map(read, remaining)
        return
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[Read]] = deque(pool.submit(read, part) for part in ahead)
        try:
            for part in remaining:
                waiting.append(pool.submit(read, part))
                if len(waiting) > _AHEAD * threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for each in waiting:
                each.cancel()


BLOCK: Final = 1 << 17
"""Rows of an array that are worth a thread's attention."""


def converted(columns: Sequence[NDArray[Any]], dtype: DTypeLike) -> NDArray[Any]:
    """Columns side by side, shape [rows, all columns], each value converted.

    Args:
        columns: of shape [rows] or [rows, width], in whatever layout.
    """
    widths = [1 if column.ndim == 1 else column.shape[1] for column in columns]
    ends = np.cumsum(widths).tolist()
    rows = len(columns[0])
    out = np.empty((rows, ends[-1]), dtype)

    def fill(first: int) -> None:
        block = slice(first, first + BLOCK)
        for column, width, end in zip(columns, widths, ends, strict=True):
            out[block, end - width : end] = column[block].reshape(-1, width)

    for _ in in_threads(fill, range(0, rows, BLOCK)):
        pass
    return out


_TAKEN: Final = 1 << 13
"""Numbers that a thread looks up at a time; NumPy copies them to 64 bits."""
_MANY: Final = 1 << 18
"""Numbers that are worth several threads."""


def at_numbers(values: NDArray[Any], numbers: NDArray[np.signedinteger[Any]]) -> NDArray[Any]:
    """Values, or rows, by number from 0, as `values[numbers]`; the first one's where it is negative."""
    out = np.empty((len(numbers), *values.shape[1:]), values.dtype)

    def fill(first: int) -> None:
        block = slice(first, first + _TAKEN)
        values.take(numbers[block], axis=0, out=out[block], mode="clip")  # which writes straight into it

    blocks = range(0, len(numbers), _TAKEN)
    for _ in in_threads(fill, blocks) if len(numbers) >= _MANY else map(fill, blocks):
        pass
    return out


def available_cores() -> int:
    """Cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
