"""How those who hold the same cell share the sorting of its trees, which is most of what building them takes.

A tree of photons or of surface points is laid out by an order of its items (`kd_order.sort`). All holders of the cell
have the same items and number them alike; each sorts some of the places of all trees and is sent the rest. What gathers
return depends on no tree's shape (docs/exactness.md, item 5), so a wrong order would cost time and change no bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays, Kind, concatenate, zeros
from wdpm.kernels.photons import kd_order
from wdpm.kernels.photons.kd_order import Launch
from wdpm.kernels.ray_fields import PLACES_A_RUN
from wdpm.scenes.errors import ProtocolError

PLACES_A_PART = 1 << 14
"""Places that are worth a part: sorting them takes some 5 ms, as long as a batch to a few others and their batches."""


def worth_sharing(counts: Sequence[int], parts: int) -> bool:
    """Whether sorting trees of so many items each is worth so many parts."""
    return parts > 1 and sum(counts) >= PLACES_A_PART * parts


class Positions(Protocol):
    """Where the items of a tree are: an array of float32, shape [N, 3], or what makes one when it is needed."""

    def __len__(self) -> int: ...

    def __array__(self, *, copy: bool | None = None) -> NDArray[np.float32]: ...


def sort_part(
    positions: Sequence[Positions], part: int, parts: int, launch: Launch | None = None
) -> dict[str, NDArray[np.int32]]:
    """What stands at the places of one part, as COPIED_ORDER.

    Args:
        positions: of the items of each tree.
        part, parts: which, from 0, and of how many.
    """
    first = np.concatenate([[0], np.cumsum([len(each) for each in positions])])
    whole = int(first[-1])
    begin, end = whole * part // parts, whole * (part + 1) // parts
    runs = [zeros(Kind.COPIED_ORDER)]
    for position, start in zip(positions, first, strict=False):
        low, high = (_cut(len(position), place - int(start)) for place in (begin, end))
        if low < high:
            runs.append(_runs(int(start) + low, kd_order.sort(np.asarray(position), low, high, launch)))
    return concatenate(runs, Kind.COPIED_ORDER)


def _runs(place: int, items: NDArray[np.int32]) -> dict[str, NDArray[np.int32]]:
    """What stands at some places from one on, as COPIED_ORDER."""
    count = -(-len(items) // PLACES_A_RUN)
    padded = np.full(count * PLACES_A_RUN, -1, np.int32)
    padded[: len(items)] = items
    return {
        "place": (place + PLACES_A_RUN * np.arange(count)).astype(np.int32),
        "items": padded.reshape(count, PLACES_A_RUN),
    }


def _cut(count: int, place: int) -> int:
    """Where a tree is cut that a part ends in, before or after."""
    return kd_order.leaf_from(count, place) if 0 < place < count else min(max(place, 0), count)


def joined(parts: Sequence[Arrays], counts: Sequence[int]) -> list[NDArray[np.int32]]:
    """The order of each tree, of all parts; ProtocolError if they are not one place for every item of every tree."""
    items = np.full(sum(counts), -1, np.int32)
    came, beyond = 0, False
    for part in parts:
        there = part["items"] >= 0
        place = (part["place"][:, None] + np.arange(PLACES_A_RUN))[there]
        came += len(place)
        beyond |= bool(place.max(initial=-1) >= len(items))
        if not beyond:
            items[place] = part["items"][there]
    if beyond or came != len(items):
        raise ProtocolError(f"the order of {came} places of trees came; expected one of {len(items)}")
    orders = np.split(items, np.cumsum(counts)[:-1])
    for number, (order, count) in enumerate(zip(orders, counts, strict=True)):
        found = np.zeros(count, bool)
        found[order[(order >= 0) & (order < count)]] = True
        if not found.all():
            missing = count - np.count_nonzero(found)
            raise ProtocolError(f"the order of tree {number} that came leaves out {missing} of {count} items")
    return orders
