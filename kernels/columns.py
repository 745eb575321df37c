"""Structures of arrays, between numpy and a device: one array a field, all equally long."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray


def upload(struct: wp.Struct, arrays: Mapping[str, NDArray[Any]], device: str) -> Any:
    """An instance of a Warp struct whose array fields hold the arrays of the same names.

    On the CPU they share memory with arrays that may be written to, so a kernel that refines them in place refines the
    caller's; what came over a wire is read-only, and is copied.
    """
    columns = struct()
    for name, var in struct.vars.items():
        array = np.ascontiguousarray(arrays[name])
        copy = not array.flags.writeable
        setattr(columns, name, wp.array(array, dtype=var.type.dtype, device=device, copy=copy))
    return columns


def empty(struct: wp.Struct, count: int, device: str) -> Any:
    """An instance of a Warp struct whose array fields have `count` items of no particular value."""
    return _none(struct, device) if count == 0 else _empty(struct, count, device)


@functools.cache
def _none(struct: wp.Struct, device: str) -> Any:
    """Columns without items are all alike: kernels that a scene has no use for some of their outputs get these."""
    return _empty(struct, 0, device)


def _empty(struct: wp.Struct, count: int, device: str) -> Any:
    columns = struct()
    for name, var in struct.vars.items():
        setattr(columns, name, wp.empty(count, dtype=var.type.dtype, device=device))
    return columns


def zeros(struct: wp.Struct, count: int, device: str) -> Any:
    """An instance of a Warp struct whose array fields have `count` zeros."""
    columns = struct()
    for name, var in struct.vars.items():
        setattr(columns, name, wp.zeros(count, dtype=var.type.dtype, device=device))
    return columns


def chosen(struct: wp.Struct, columns: Any, rows: NDArray[np.intp], device: str) -> Any:
    """Some items of an instance of a Warp struct, as another instance."""
    return upload(struct, {name: getattr(columns, name).numpy()[rows] for name in struct.vars}, device)


def download(columns: Any, names: Iterable[str]) -> dict[str, NDArray[Any]]:
    """The named arrays as numpy arrays; on the CPU they share memory with the device's."""
    return {name: getattr(columns, name).numpy() for name in names}
