"""Structs of kernels as bytes that lie anywhere in memory, and back without a copy: for processes that share memory.

What is packed begins with a description: name, and of each number and each array, by its place in the structs, its
value, or type, shape and place in bytes. Whoever unpacks says what structs are expected, and takes nothing else.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

ALIGNMENT = 64
"""Bytes: a line of a processor's cache, at which each array begins."""

_LENGTH_BYTES = 8

Value = Any
"""An instance of a struct of kernels, on the CPU, or a dictionary of numpy arrays."""

Kind = Any
"""The struct; or `dict`."""


class NotAsExpectedError(Exception):
    """Bytes that do not hold what is expected."""


def pack(name: str, values: Sequence[Value]) -> list[memoryview]:
    """Parts that, one after another, are the values' bytes.

    Args:
        name: what they are, for who unpacks.
    """
    numbers: dict[str, float] = {}
    arrays: dict[str, NDArray[Any]] = {}
    for place, value in enumerate(values):
        _gather(str(place), value, numbers, arrays)
    sizes = [_aligned(array.nbytes) for array in arrays.values()]
    starts = [0, *itertools.accumulate(sizes)]
    described = {
        key: [array.dtype.str, list(array.shape), start]
        for (key, array), start in zip(arrays.items(), starts, strict=False)
    }
    head = json.dumps([name, numbers, described]).encode()
    head = len(head).to_bytes(_LENGTH_BYTES, "little") + head
    head += bytes(_aligned(len(head)) - len(head))
    parts = [memoryview(head)]
    for array in arrays.values():
        parts.append(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
        parts.append(memoryview(bytes(_aligned(array.nbytes) - array.nbytes)))
    return parts


def unpack(name: str, kinds: Sequence[Kind], memory: memoryview) -> list[Value]:
    """The values that memory holds, as views of it.

    Raises:
        NotAsExpectedError: it holds something else.
    """
    try:
        length = int.from_bytes(memory[:_LENGTH_BYTES], "little")
        found, numbers, described = json.loads(bytes(memory[_LENGTH_BYTES : _LENGTH_BYTES + length]))
        if found != name:
            raise NotAsExpectedError(f"{found} in place of {name}")
        reader = _Reader(memory[_aligned(_LENGTH_BYTES + length) :], numbers, described)
        return [reader.value(str(place), kind) for place, kind in enumerate(kinds)]
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise NotAsExpectedError(f"{name}: {error}") from None


class _Reader:
    """Reads values of a description and the bytes that follow it."""

    def __init__(self, memory: memoryview, numbers: Mapping[str, float], described: Mapping[str, Any]) -> None:
        self._memory = memory
        self._numbers = numbers
        self._described = described

    def value(self, place: str, kind: Kind) -> Value:
        if kind is dict:
            keys = [key for key in self._described if key.startswith(f"{place}.")]
            return {key.removeprefix(f"{place}."): self._array(key) for key in keys}
        made = kind()
        for name, var in kind.vars.items():
            at = f"{place}.{name}"
            if isinstance(var.type, type(kind)):
                setattr(made, name, self.value(at, var.type))
            elif hasattr(var.type, "ndim"):
                setattr(made, name, self._of_warp(at, var.type))
            else:
                setattr(made, name, self._numbers[at])
        return made

    def _array(self, key: str) -> NDArray[Any]:
        dtype, shape, start = self._described[key]
        if min(shape, default=0) < 0:
            raise NotAsExpectedError(f"{key}: an array of {shape}")
        count = math.prod(shape)
        if count == 0:
            return np.zeros(shape, dtype)
        return np.frombuffer(self._memory, dtype, count, start).reshape(shape)

    def _of_warp(self, key: str, kind: Any) -> Any:
        """An array of Warp over the bytes."""
        array, item = self._array(key), tuple(getattr(kind.dtype, "_shape_", ()))
        outer = array.shape[: kind.ndim]
        scalar = wp.dtype_to_numpy(getattr(kind.dtype, "_wp_scalar_type_", kind.dtype))
        if array.dtype != scalar or array.shape[kind.ndim :] != item or array.ndim != kind.ndim + len(item):
            raise NotAsExpectedError(f"{key}: an array of {array.dtype} {array.shape}")
        if not array.size:
            return wp.empty(outer, dtype=kind.dtype, device="cpu")
        made = wp.array(ptr=array.ctypes.data, dtype=kind.dtype, shape=outer, device="cpu", copy=False)
        made.whole = array  # which stays as long as this
        return made


def _gather(place: str, value: Value, numbers: dict[str, float], arrays: dict[str, NDArray[Any]]) -> None:
    """Put a value's numbers and arrays under their places."""
    for name, each in _members(value):
        at = f"{place}.{name}"
        if isinstance(each, wp.array):
            arrays[at] = each.numpy()
        elif isinstance(each, np.ndarray):
            arrays[at] = each
        elif isinstance(each, int | float):
            numbers[at] = each
        else:
            _gather(at, each, numbers, arrays)


def _members(value: Value) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        yield from value.items()
    else:
        for name in value._cls.vars:
            yield name, getattr(value, name)


def _aligned(size: int) -> int:
    return -(-size // ALIGNMENT) * ALIGNMENT
