"""Cells on their way from the master: parts that are joined, until all that a setup promises is here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wdpm.cluster.messages import checks, protocol
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.arrays import ARRAYS, Triangles


class ArrivingCells:
    """The cells of a setup that a slave is to have.

    Args:
        number: the slave's.
        had: cells of the worker that it has built.
    """

    def __init__(self, setup: protocol.Setup, number: int, had: frozenset[int]) -> None:
        check_setup(setup, number, had)
        self._setup = setup
        self._parts: dict[int, list[Triangles]] = {}
        self._whole: dict[int, Triangles] = {}
        own = {cell for cell, holder in enumerate(setup.holders) if holder == number}
        self._missing = own - set(setup.kept)

    @property
    def complete(self) -> bool:
        """Whether all are here."""
        return not self._missing

    def take(self) -> dict[int, Triangles]:
        """Those that came; whoever takes them holds them alone."""
        whole, self._whole = self._whole, {}
        return whole

    def receive(self, message: protocol.Partition) -> bool:
        """Take in a part of a cell. Returns whether the cell is complete; ProtocolError if the part cannot be."""
        if message.cell not in self._missing:
            raise ProtocolError(f"the master sent cell {message.cell}, which is not expected here")
        parts = self._parts.setdefault(message.cell, [])
        if message.part != len(parts) or message.parts <= message.part:
            raise ProtocolError(f"part {message.part} of {message.parts} of cell {message.cell} is out of order")
        parts.append(message.triangles)
        if len(parts) < message.parts:
            return False
        triangles = join(self._parts.pop(message.cell))
        checks.check_triangles(triangles, self._setup.world, f"cell {message.cell}")
        self._whole[message.cell] = triangles
        self._missing.remove(message.cell)
        return True


def check_setup(setup: protocol.Setup, number: int, had: frozenset[int]) -> None:
    """Raise ProtocolError if a setup names cells or slaves that cannot be."""
    cells, known = setup.world.top_tree.cells, len(setup.peers)
    if len(setup.holders) != cells:
        raise ProtocolError(f"Setup names holders of {len(setup.holders)} cells; its top tree has {cells}")
    if not all(0 <= holder < known and setup.peers[holder] for holder in setup.holders):
        raise ProtocolError(f"Setup names a holder without an endpoint among {known} slaves")
    if not (number < known and setup.peers[number]):
        raise ProtocolError(f"Setup has no endpoint for slave {number}")
    if not set(setup.kept) <= had:
        raise ProtocolError(f"Setup says that this slave keeps cells {sorted(setup.kept)}; it has {sorted(had)}")


def join(parts: Sequence[Triangles]) -> Triangles:
    """Triangles of several parts of a cell as one."""
    whole = parts[0]
    if len(parts) > 1:
        whole = whole.with_arrays({name: np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS})
    return whole
