"""Batches to frames and back, by code of their own.

A cluster whose scene is divided sends some thousand a second; what packing.py derives from type hints takes half as
long again for each. What is said is what the norm says of any record.
"""

from __future__ import annotations

import operator
from typing import Any, Final

import numpy as np

from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.messages import checks
from wdpm.cluster.messages.frames import Frames
from wdpm.cluster.messages.short_arrays import ShortArrays, lengthen, shorten
from wdpm.cluster.runs import COLUMNS, Runs
from wdpm.scenes.errors import ProtocolError

_KINDS: Final = {kind.value: kind for kind in Kind}
_DTYPES: Final = {name: np.dtype(name) for name in ("<i8", "|u1")}
_NUMBERS: Final = _DTYPES["<i8"]

MOST_ITEMS: Final = 1 << 40
"""Of a block, or runs of a table: more than any machine has room for."""


def pack_batch(value: Any, where: str, arrays: list[np.ndarray[Any, Any]]) -> list[Any]:
    """What stands in the header; the arrays are appended to those of the message.

    Raises:
        ProtocolError: this is no batch whose fields hold what they should.
    """
    if type(value) is not Batch:
        raise ProtocolError(f"{where} is a {type(value).__name__}; expected Batch")
    value.check()
    table = value.runs.table
    try:
        cell = operator.index(value.cell)
    except TypeError:
        raise ProtocolError(f"{where}.cell is {value.cell!r}; expected int") from None
    if table.dtype != _NUMBERS:
        raise ProtocolError(f"{where}.runs.table is {table.dtype}; expected {_NUMBERS}")
    short = shorten(value.kind, value.arrays)
    arrays.append(np.ascontiguousarray(table))
    arrays += short.blocks
    blocks = [["|u1", [len(block)]] for block in short.blocks]
    return [value.kind.value, cell, [["<i8", list(table.shape)]], [short.rows, short.forms, blocks]]


def unpack_batch(value: Any, where: str, frames: Frames) -> Batch:
    """The batch that a header and frames tell of; its arrays are read-only where they share memory with those.

    Raises:
        ProtocolError: anything at all is wrong.
    """
    name, cell, runs, short = _list(value, 4, where)
    kind = _KINDS.get(name) if type(name) is str else None
    if kind is None:
        raise ProtocolError(f"{where}.kind is {name!r:.80}; expected one of {sorted(_KINDS)}")
    if type(cell) is not int or not -(2**63) <= cell < 2**63:
        raise ProtocolError(f"{where}.cell is {cell!r:.80}; expected int")
    [table] = _list(runs, 1, f"{where}.runs")
    of_tasks = Runs(_array(table, "<i8", (COLUMNS,), f"{where}.runs.table", frames))
    checks.check(of_tasks, f"{where}.runs")
    rows, forms, blocks = _list(short, 3, f"{where}.arrays")
    if type(rows) is not int or type(forms) is not str or not isinstance(blocks, list):
        raise ProtocolError(f"{where}.arrays are not a number of rows, forms and blocks")
    came = tuple([_array(block, "|u1", (), f"{where}.arrays.blocks", frames) for block in blocks])
    batch = Batch(kind, cell, of_tasks, lengthen(kind, ShortArrays(rows, forms, came), f"{where}.arrays"))
    checks.check(batch, where)
    return batch


def _list(value: Any, length: int, where: str) -> list[Any]:
    if not isinstance(value, list) or len(value) != length:
        raise ProtocolError(f"{where} is not a list of {length} fields")
    return value


def _array(value: Any, name: str, item: tuple[int, ...], where: str, frames: Frames) -> np.ndarray[Any, Any]:
    """The array of items of this shape that [name, lengths] tells of."""
    told, shape = _list(value, 2, where)
    if told != name:
        raise ProtocolError(f"{where} is {told!r:.80}; expected {name!r}")
    if not isinstance(shape, list) or len(shape) != 1 + len(item) or tuple(shape[1:]) != item:
        raise ProtocolError(f"{where} is of shape {shape!r:.80}; expected {['N', *item]}")
    if type(shape[0]) is not int or not 0 <= shape[0] < MOST_ITEMS:
        raise ProtocolError(f"{where}: {shape!r:.80} is no shape")
    return frames.array(_DTYPES[name], (shape[0], *item), where)
