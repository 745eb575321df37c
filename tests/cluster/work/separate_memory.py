"""A device with memory of its own, played by the CPU: what a GPU would copy is copied and counted.

On the CPU arrays of Warp and of numpy share memory. Here `wp.array(data)` and `array.numpy()` always copy, as between a
host and a GPU, so that a render which rests on shared memory gives another image.
"""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.work.cell import Cell
from wdpm.cluster.work.replica import Replica
from wdpm.kernels import blocks


@dataclass
class Copies:
    """Copies between host and device.

    Attributes:
        up, down: to the device and from it, so far.
        bytes_up, bytes_down: of these.
    """

    up: int = 0
    down: int = 0
    bytes_up: int = 0
    bytes_down: int = 0

    def minus(self, other: Copies) -> Copies:
        """What was added since."""
        return Copies(*(getattr(self, name) - getattr(other, name) for name in vars(self)))

    def add(self, other: Copies) -> None:
        """Count these as well."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)

    def of_now(self) -> Copies:
        """As they are now."""
        return Copies(**vars(self))


@dataclass
class Ledger:
    """What was copied.

    Attributes:
        total: of everything while the memory is separate.
        batches: by kind of batch, what a cell copied for each.
        items: by kind of batch, how many items those had.
        once: what was copied for the tree of irradiance records, once a round by whichever batch is first to read it:
            in `total`, and in no batch.
        sites: by place in cluster/work/, file and line: how often, and bytes.
    """

    total: Copies = field(default_factory=Copies)
    batches: dict[Kind, list[Copies]] = field(default_factory=lambda: defaultdict(list))
    items: Counter[Kind] = field(default_factory=Counter)
    once: Copies = field(default_factory=Copies)
    sites: dict[tuple[str, int], list[int]] = field(default_factory=lambda: defaultdict(lambda: [0, 0]))

    def most(self, kind: Kind) -> tuple[int, int]:
        """Most copies up and down of any one batch of a kind."""
        every = self.batches[kind]
        return max(each.up for each in every), max(each.down for each in every)

    def bytes_an_item(self, kind: Kind) -> tuple[int, int]:
        """Bytes up and down, over the items of a kind's batches."""
        every, items = self.batches[kind], max(self.items[kind], 1)
        return round(sum(each.bytes_up for each in every) / items), round(
            sum(each.bytes_down for each in every) / items
        )

    def note(self, direction: str, size: int) -> None:
        """Count a copy that the caller's caller asked for."""
        setattr(self.total, direction, getattr(self.total, direction) + 1)
        setattr(self.total, f"bytes_{direction}", getattr(self.total, f"bytes_{direction}") + size)
        frame = sys._getframe(2)
        while frame.f_back is not None and Path(frame.f_code.co_filename).parent.name != "work":
            frame = frame.f_back
        site = self.sites[Path(frame.f_code.co_filename).name, frame.f_lineno]
        site[0] += 1
        site[1] += size


@contextmanager
def separate_memory() -> Iterator[Ledger]:
    """Have host and device share no memory meanwhile."""
    ledger = Ledger()
    make, to_numpy, advance = wp.array.__init__, wp.array.numpy, Cell.advance
    send, fetch = blocks.send, blocks.fetch
    record_tree = Replica.cache.fget
    assert record_tree is not None

    def make_copied(array: wp.array, data: Any = None, *args: Any, **kwargs: Any) -> None:
        make(array, data, *args, **(kwargs if data is None else {**kwargs, "copy": True}))
        if data is not None and array.size:
            ledger.note("up", array.size * wp.types.type_size_in_bytes(array.dtype))

    def numpy_copied(array: wp.array, **kwargs: Any) -> NDArray[Any]:
        result = np.array(to_numpy(array, **kwargs))
        if result.size:
            ledger.note("down", result.nbytes)
        return result

    def advance_counted(cell: Cell, batch: Batch) -> Iterator[Batch]:
        copies, follows = Copies(), advance(cell, batch)
        while True:
            before, once = ledger.total.of_now(), ledger.once.of_now()
            follow = next(follows, None)
            copies.add(ledger.total.minus(before).minus(ledger.once.minus(once)))
            if follow is None:
                break
            yield follow
        ledger.batches[batch.kind].append(copies)
        ledger.items[batch.kind] += len(batch)

    def record_tree_once(replica: Replica) -> Any:
        before = ledger.total.of_now()
        tree = record_tree(replica)
        ledger.once.add(ledger.total.minus(before))
        return tree

    def sent(block: Any, staged: Any, size: int) -> None:
        ledger.note("up", size)
        send(block, staged, size)

    def fetched(staged: Any, block: Any, first: int, size: int) -> None:
        ledger.note("down", size)
        fetch(staged, block, first, size)

    with (
        mock.patch.object(blocks, "shares_memory", return_value=False),
        mock.patch.object(blocks, "send", sent),
        mock.patch.object(blocks, "fetch", fetched),
        mock.patch.object(wp.array, "__init__", make_copied),
        mock.patch.object(wp.array, "numpy", numpy_copied),
        mock.patch.object(Cell, "advance", advance_counted),
        mock.patch.object(Replica, "cache", property(record_tree_once)),
    ):
        yield ledger
