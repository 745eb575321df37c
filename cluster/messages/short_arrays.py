"""The arrays of a batch as the wire has them: in the order of its kind's fields, each in the form that suits it."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Arrays, Kind
from wdpm.cluster.messages.short_columns import ALIGNMENT, RAW, Bytes, Column, ColumnReader, ColumnWriter
from wdpm.kernels.ray_fields import HIT
from wdpm.scenes.errors import ProtocolError

SHORT_BYTES = 1 << 15
"""Bytes of a batch below which its columns travel as they are: looking at them and undoing that takes 50 us (of rays
from the camera, light) to 150 us (of paths), whatever their length, and each kilobyte that it saves 3.3 us with CURVE,
0.3 over a socket of one machine. At this size the looks cost 3 to 12 us for each that they save."""

LONG_ROWS = 1 << 20
"""Rows above which they do so too: photons and ghosts of a whole map, whose columns then need no memory of their own
while they wait to be sent, once for each receiver, nor while they are looked at."""

_MET = "prim"
"""Says which rows have met something; the other fields of a hit are of those, and come after it."""

_ORDER = {kind: sorted(fields, key=lambda name: name != _MET) for kind, fields in SCHEMAS.items()}
_PLAIN = {
    kind: [
        (name, np.dtype(field.dtype), field.shape, math.prod(field.shape) * np.dtype(field.dtype).itemsize)
        for name, field in ((name, fields[name]) for name in _ORDER[kind])
    ]
    for kind, fields in SCHEMAS.items()
}
"""Columns in the order in which they travel: name, type, shape and bytes of an item."""

ROW_BYTES = {kind: sum(item for *_, item in columns) for kind, columns in _PLAIN.items()}
"""Of all columns of a row."""

_GAPS = [bytes(size) for size in range(ALIGNMENT)]
"""What lies between two columns, by its length."""

_DTYPES = {dtype: np.dtype(dtype) for dtype in ("<f4", "<f8", "<i4", "<i8")}


@dataclass(frozen=True, eq=False)
class ShortArrays:
    """What stands for a batch's arrays in a message.

    Attributes:
        rows: how many; no more than blocks have bytes.
        forms: of each column two hexadecimal digits (short_columns), `prim` first; none where all are as they are.
        blocks: bytes of the columns, one behind another.
    """

    rows: int
    forms: str
    blocks: tuple[NDArray[np.uint8], ...]


def shorten(kind: Kind, arrays: Arrays) -> ShortArrays:
    """The arrays for the wire.

    Args:
        arrays: those of the kind, as Batch.check holds.
    """
    rows = len(arrays[next(iter(arrays))]) if arrays else 0
    few = rows * ROW_BYTES[kind] < SHORT_BYTES
    if rows and few:
        return ShortArrays(rows, "", (_one_behind_another(kind, arrays, rows),))
    columns = [np.ascontiguousarray(arrays[name]) for name in _ORDER[kind]]
    forms, blocks = _shorter(_ORDER[kind], columns, rows) if not few and rows <= LONG_ROWS else ("", [])
    if sum(map(len, blocks)) < rows:  # as they are not yet, or fewer bytes than a receiver believes
        forms, blocks = "", _as_they_are(columns)
    return ShortArrays(rows, forms, tuple(blocks))


def _shorter(names: Sequence[str], columns: Sequence[Column], rows: int) -> tuple[str, list[Bytes]]:
    writer = ColumnWriter(rows)
    forms = bytes(_put(writer, name, column) for name, column in zip(names, columns, strict=True))
    return forms.hex(), writer.blocks()


def _one_behind_another(kind: Kind, arrays: Arrays, rows: int) -> Bytes:
    """Columns of few rows, as they are: what ColumnWriter puts into one block, in a third of the time."""
    pieces = []
    for name, _, _, item in _PLAIN[kind]:
        pieces.append(arrays[name].tobytes())
        if gap := -(rows * item) % ALIGNMENT:
            pieces.append(_GAPS[gap])
    return np.frombuffer(b"".join(pieces), np.uint8)


def _as_they_are(columns: Sequence[Column]) -> list[Bytes]:
    writer = ColumnWriter(0)
    for column in columns:
        writer.raw(column)
    return writer.blocks()


def _put(writer: ColumnWriter, name: str, column: Column) -> int:
    if name == _MET:
        return writer.pick(column)
    if name in HIT and (form := writer.of_picked(column)) is not None:
        return form
    return writer.floats(column) if column.dtype.kind == "f" else writer.whole(column)


def lengthen(kind: Kind, short: ShortArrays, where: str) -> dict[str, Column]:
    """The arrays that came; they are read-only where they share memory with the blocks.

    Raises:
        ProtocolError: these are no columns of so many rows. Nothing is made that is longer than the rows, of which no
            more are believed than there are bytes.
    """
    fields, order = SCHEMAS[kind], _ORDER[kind]
    size = sum(map(len, short.blocks))
    if not 0 <= short.rows <= size or any(block.ndim != 1 for block in short.blocks):
        raise ProtocolError(f"{where} have {short.rows} rows in {size} bytes")
    if len(short.forms) != (2 * len(order) if short.forms else 0):
        raise ProtocolError(f"{where} have forms '{short.forms:.80}'; expected 2 digits for each of {len(order)}")
    try:
        if not short.forms and len(short.blocks) == 1:
            return _as_it_came(kind, short.rows, short.blocks[0])
        forms = bytes.fromhex(short.forms) or bytes([RAW]) * len(order)
        reader = ColumnReader(short.rows, short.blocks)
        taken = {
            name: reader.column(form, _DTYPES[fields[name].dtype], fields[name].shape)
            for name, form in zip(order, forms, strict=True)
        }
        reader.finish()
    except (ProtocolError, ValueError) as error:  # ValueError: of fromhex
        raise ProtocolError(f"{where}: columns of {short.rows} rows: {error}") from None
    return {name: taken[name] for name in fields}


def _as_it_came(kind: Kind, rows: int, block: Bytes) -> dict[str, Column]:
    """The columns of few rows, as they are, one behind another: what ColumnReader finds, in a fifth of the time."""
    columns, least, most = _standing(kind, rows)
    if len(block) < least:
        raise ProtocolError("a piece of a column is cut short")
    if len(block) > most:
        raise ProtocolError("there is more than their forms say")
    return {name: np.ndarray(shape, dtype, block, place) for name, dtype, shape, place in columns}


@functools.lru_cache(maxsize=1 << 12)
def _standing(kind: Kind, rows: int) -> tuple[list[tuple[str, np.dtype[Any], tuple[int, ...], int]], int, int]:
    """How columns of so many rows stand in a block, one behind another.

    Returns:
        name, type, shape and place of each, in the order of the kind's fields; and the least and the most bytes that
        the block has, without the gap after the last one and with it.
    """
    found, end, place = {}, 0, 0
    for name, dtype, shape, item in _PLAIN[kind]:
        found[name] = (name, dtype, (rows, *shape), place)
        end = place + rows * item
        place = -(-end // ALIGNMENT) * ALIGNMENT
    return [found[name] for name in SCHEMAS[kind]], end, place
