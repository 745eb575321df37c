"""The records of an irradiance cache in a tree of boxes.

Records lie in the order of a kd-tree (kernels/photons/kd_order.py), eight to a leaf; each node above has eight
children, and the boxes of what their records reach. The tree is complete, so there are no pointers: the children of
node i are nodes 8 i + 1 .. 8 i + 8. What an interpolation returns never depends on this shape (see cache.py).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.photons.kd_order import sort
from wdpm.kernels.photons.photon_map import vec8
from wdpm.scenes.errors import WdpmError

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LEAF_ROWS = wp.constant(7)  # position x, y, z, normal x, y, z, 1 / radius² of the eight records

MAX_RECORDS = 8**8
"""Records of a cache, at most: seven levels of inner nodes (cache.STACK_CAPACITY)."""

BOX_SHARE = 2.0**-18
"""Growth of a record's box, as a share of its radius: |x - x_i|² / R_i² is off by less than 8 roundings of 2^-24."""

Arrays = Mapping[str, NDArray[Any]]

_DERIVATIVES = ("rotation", "translation")


@wp.struct
class IrradianceCache:
    """The records of one partition, on one device.

    `place` counts records through the leaves, `rank` in the order of their numbers.
    """

    inner_count: wp.int32  # inner nodes; the children of node i are nodes 8 i + 1 .. 8 i + 8, the rest are leaves
    nodes: wp.array[vec8]  # boxes of the children, as in photon_map; empty ones are +inf .. -inf  [6 * inner_count]
    leaves: wp.array[vec8]  # unused places have normal 0, which reaches nothing  [7 * leaf count]
    rank: wp.array[wp.int32]  # by place  [8 * leaf count]
    position: wp.array[wp.vec3]  # by rank, like all below  [record count]
    normal: wp.array[wp.vec3]
    irradiance: wp.array[wp.vec3]
    grazing: wp.array[wp.float32]
    rotation: wp.array[wp.mat33]
    translation: wp.array[wp.mat33]


def build(records: Arrays, device: str = "cpu") -> Any:
    """The cache of N >= 0 records: leaves of eight, and eight boxes a node above them.

    Args:
        records: arrays of N: "number", integers unique among all records of the view; "position"; "normal", the
            shading normal, unit; "radius" > 0; "irradiance" [N, 3]; "grazing"; "rotation" and "translation" [N, 3, 3],
            as of records.make_records.

    Returns:
        IrradianceCache.

    Raises:
        WdpmError: a value is not finite, a radius not above 0, a number comes twice, or there are too many records.
    """
    _check(records)
    by_rank, count = _by_rank(records), len(records["number"])
    levels = 0
    while 8 ** (levels + 1) < count:
        levels += 1
    along = sort(by_rank["position"], 0, count) if count else np.zeros(0, np.int32)
    leaf_count = max(1, -(-count // 8))

    cache = IrradianceCache()
    cache.inner_count = (8**levels - 1) // 7
    cache.rank = wp.array(_padded(along, 8 * leaf_count, 0), dtype=wp.int32, device=device)
    cache.leaves = wp.array(_leaves(by_rank, along, leaf_count), dtype=vec8, device=device)
    cache.nodes = wp.array(_nodes(by_rank, along, levels), dtype=vec8, device=device)
    kinds = dict.fromkeys(("position", "normal", "irradiance"), wp.vec3) | dict.fromkeys(_DERIVATIVES, wp.mat33)
    kinds["grazing"] = wp.float32
    for name, kind in kinds.items():
        column = by_rank[name]
        setattr(cache, name, wp.array(column, dtype=kind, device=device, copy=not column.flags.writeable))
    return cache


def _check(records: Arrays) -> None:
    number = records["number"]
    count = len(number)
    if count > MAX_RECORDS:
        raise WdpmError(f"irradiance cache: {count} records, expected at most {MAX_RECORDS}")
    shapes: dict[str, tuple[int, ...]] = {"radius": (count,), "grazing": (count,)}
    shapes |= dict.fromkeys(("position", "normal", "irradiance"), (count, 3))
    shapes |= dict.fromkeys(_DERIVATIVES, (count, 3, 3))
    for name, shape in shapes.items():
        value = records[name]
        if value.shape != shape:
            raise WdpmError(f"irradiance cache: {name} has shape {value.shape}, expected {shape}")
        # A sum is finite only if its terms are; of what may be larger than any sum all are looked at.
        if not np.isfinite(value.sum(dtype=np.float64)):
            bad = np.flatnonzero(~np.isfinite(value.reshape(count, math.prod(shape[1:]))).all(axis=1))
            if len(bad):
                raise WdpmError(f"irradiance cache: {name} of record {number[bad[0]]} is {value[bad[0]].tolist()}")
    small = np.flatnonzero(~(records["radius"] > 0))
    if len(small):
        raise WdpmError(
            f"irradiance cache: the radius of record {number[small[0]]} is {records['radius'][small[0]]}, expected > 0"
        )


def _by_rank(records: Arrays) -> dict[str, NDArray[np.float32]]:
    """All columns but the numbers in the order of these: as they are, where that is the order that they come in."""
    number = records["number"]
    if (number[1:] > number[:-1]).all():
        return {name: np.ascontiguousarray(column, np.float32) for name, column in records.items() if name != "number"}
    order = np.argsort(number)
    twice = np.flatnonzero(np.diff(number[order]) == 0)
    if len(twice):
        raise WdpmError(f"irradiance cache: record {number[order[twice[0]]]} comes twice, expected unique numbers")
    return {
        name: np.ascontiguousarray(column[order], np.float32) for name, column in records.items() if name != "number"
    }


def _padded(values: NDArray[Any], size: int, filler: float) -> NDArray[Any]:
    out = np.full((size, *values.shape[1:]), filler, values.dtype)
    out[: len(values)] = values
    return out


def _leaves(by_rank: Arrays, along: NDArray[np.int32], leaf_count: int) -> NDArray[np.float32]:
    """Rows of the leaves, shape [7 * leaf count, 8]."""
    inverse2 = 1.0 / by_rank["radius"].astype(np.float64) ** 2
    columns = np.column_stack([by_rank["position"], by_rank["normal"], inverse2])[along].astype(np.float32)
    leaves = _padded(columns, 8 * leaf_count, 0.0).reshape(leaf_count, 8, LEAF_ROWS)
    return np.ascontiguousarray(leaves.transpose(0, 2, 1)).reshape(-1, 8)


def _nodes(by_rank: Arrays, along: NDArray[np.int32], levels: int) -> NDArray[np.float32]:
    """Rows of the inner nodes, the root first, shape [6 * inner count, 8]."""
    position = by_rank["position"][along].astype(np.float64)
    reach = by_rank["radius"][along].astype(np.float64)[:, None] * (1.0 + BOX_SHARE)
    # Rounded outwards: the float32 beyond the nearest one.
    boxes = np.column_stack(
        [
            np.nextafter((position - reach).astype(np.float32), np.float32(-np.inf)),
            np.nextafter((position + reach).astype(np.float32), np.float32(np.inf)),
        ]
    )
    rows: list[NDArray[np.float32]] = []
    for level in range(levels, 0, -1):
        groups = _padded_boxes(boxes, -(-len(boxes) // 8) * 8).reshape(-1, 8, 6)
        # Side by side, since NumPy is slow where what it goes along is short.
        low, high = groups[:, :, :3], groups[:, :, 3:]
        boxes = np.column_stack(
            [
                np.minimum.reduce([low[:, child] for child in range(8)]),
                np.maximum.reduce([high[:, child] for child in range(8)]),
            ]
        )
        of_nodes = _padded_boxes(boxes, 8**level).reshape(-1, 8, 6)
        rows.insert(0, of_nodes.transpose(0, 2, 1).reshape(-1, 8))
    return np.concatenate(rows) if rows else np.zeros((0, 8), np.float32)


def _padded_boxes(boxes: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    """Boxes, and behind them empty ones, `size` in all."""
    out = np.empty((size, 6), np.float32)
    out[: len(boxes)] = boxes
    out[len(boxes) :, :3], out[len(boxes) :, 3:] = np.inf, -np.inf
    return out
