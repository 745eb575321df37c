"""Batches have the same bits when their columns have travelled in short forms; damaged ones are ProtocolErrors."""

from __future__ import annotations

import contextlib
from typing import Any

import msgpack
import numpy as np
import pytest
from fake_worker import arrays
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, Batch, Kind, zeros
from wdpm.cluster.messages import packing, short_arrays, short_columns
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.runs import Runs
from wdpm.kernels.fields import Field
from wdpm.scenes.errors import ProtocolError

ALL = packing.by_name(p.Message)
SPECIAL_BITS = (0, 1, 0x7FC00000, 0x7FC00001, 0xFFC00000, 0x80000000, 0x7F800000, 0x3F800000, 0xFFFFFFFF, 0x7FFFFFFF)
"""Of 32: zero, the smallest, several NaNs, -0, infinity, one, -1, the largest whole number."""


def over_the_wire(batch: Batch) -> Batch:
    frames = [bytes(frame) for frame in packing.encode(p.PeerBatches(1, (batch,)))]
    arrived: Batch = packing.decode(frames, ALL).batches[0]
    return arrived


def size_of(batch: Batch) -> int:
    return sum(len(bytes(frame)) for frame in packing.encode(p.PeerBatches(1, (batch,))))


def require_same(arrived: Batch, sent: Batch) -> None:
    assert list(arrived.arrays) == list(SCHEMAS[sent.kind])
    for name, column in sent.arrays.items():
        other = arrived.arrays[name]
        assert (other.dtype, other.shape, other.tobytes()) == (column.dtype, column.shape, column.tobytes()), name


def column_of(rng: np.random.Generator, field: Field, count: int, manner: str) -> NDArray[Any]:
    """A column of a field that is of one manner, with bits that are no ordinary numbers among them."""
    channels = int(np.prod(field.shape, dtype=int))
    words = np.dtype(field.dtype).itemsize // 4
    bits = rng.integers(0, 1 << 32, (count, channels * words), dtype=np.uint64).astype(np.uint32)
    bits[rng.random(bits.shape) < 0.2] = rng.choice(np.array(SPECIAL_BITS, np.uint32))
    match manner:
        case "one":
            bits[:] = bits[0]
        case "runs":
            bits = bits[np.sort(rng.integers(0, max(1, count // 9), count))]
        case "first channel" if channels > 1:
            bits[rng.random(count) < 0.6, words:] = 0
        case "mostly none":
            bits[rng.random(count) < 0.7] = rng.choice(np.array(SPECIAL_BITS, np.uint32))
    column = np.ascontiguousarray(bits).view(field.dtype).reshape(count, *field.shape)
    if field.dtype[1] != "i" or manner not in ("near", "steps", "backwards"):
        return column
    base, far = int(rng.integers(-(2**31), 2**31)), int(rng.choice([3, 200, 60_000, 2**20]))
    steps = rng.integers(0 if manner != "backwards" else -far, far, column.shape)
    numbers = base + (steps if manner == "near" else np.cumsum(steps, axis=0))
    return numbers.astype(field.dtype)


MANNERS = ("any", "one", "runs", "first channel", "mostly none", "near", "steps", "backwards")


@settings(max_examples=150, deadline=None)
@given(
    kind=st.sampled_from([kind for kind in Kind if SCHEMAS[kind]]),
    more=st.sampled_from([-1, 0, 300, 1001]),
    seed=st.integers(0, 2**32 - 1),
    data=st.data(),
)
def test_bits_are_those_that_were_sent(kind: Kind, more: int, seed: int, data: st.DataObject) -> None:
    rng = np.random.default_rng(seed)
    count = -(-short_arrays.SHORT_BYTES // short_arrays.ROW_BYTES[kind]) + more  # from 0 on they are shortened
    columns = {}
    for name, field in SCHEMAS[kind].items():
        columns[name] = column_of(rng, field, count, data.draw(st.sampled_from(MANNERS), label=name))
    if "prim" in columns:
        missed = rng.random(count) < data.draw(st.sampled_from([0.0, 0.5, 0.99, 1.0]))
        for name in ("prim", "t", "u", "v", "owner"):
            columns[name][missed] = -1 if columns[name].dtype.kind == "i" else columns[name][0]
    batch = Batch.of_task(kind, 1, 0, 0, 1, columns)
    require_same(over_the_wire(batch), batch)


@pytest.mark.parametrize(
    ("column", "form"),
    [
        (np.full(1000, -(2**31), np.int32), short_columns.ONE),
        (np.arange(1000, dtype=np.int32)[::-1] % 256, short_columns.OVER_8),
        (np.arange(1000, dtype=np.int32) * 7919 % 60_000 - 30_000, short_columns.OVER_16),
        (np.arange(1000, dtype=np.int64) * 7919**2 % 2**32 - 2**31, short_columns.OVER_32),
        (np.arange(1000, dtype=np.int32) * 200 + np.arange(1000, dtype=np.int32) // 500 * 2**30, short_columns.STEPS_8),
        (np.arange(1000, dtype=np.int64) * 60_000, short_columns.STEPS_16),
        (np.arange(1000, dtype=np.int32) * 7919**2, short_columns.RAW),
        (np.repeat(np.arange(100, dtype=np.int32) * 7919**2, 10), short_columns.RUNS | short_columns.RAW),
        (np.repeat(np.arange(100, dtype=np.int32), 10), short_columns.RUNS | short_columns.OVER_8),
    ],
)
def test_whole_numbers_have_the_form_that_suits_them(column: NDArray[Any], form: int) -> None:
    writer = short_columns.ColumnWriter(len(column))
    assert writer.whole(column) == form
    reader = short_columns.ColumnReader(len(column), writer.blocks())
    np.testing.assert_array_equal(reader.column(form, column.dtype, ()), column)
    reader.finish()


def test_floats_are_compared_as_bits() -> None:
    writer = short_columns.ColumnWriter(40)
    assert writer.floats(np.zeros(40, np.float32)) == short_columns.ONE
    assert writer.floats(np.full(40, np.nan, np.float32)) == short_columns.ONE
    assert writer.floats(np.tile(np.float32([0.0, -0.0]), 20)) == short_columns.RAW
    distances = np.zeros((40, 3), np.float32)
    distances[:, 0] = np.arange(40)
    assert writer.floats(distances) == short_columns.FIRST
    assert writer.floats(np.float32(-0.0) - distances) == short_columns.RAW


def gather_rays(count: int) -> Batch:
    """Rays of records, ten each, as they are sent most: one in eight has met something."""
    columns = arrays(Kind.PATH, count)
    record = np.arange(count) // 10
    for name in ("origin", "anchor", "throughput"):
        columns[name] = columns[name][record]
    columns["pixel"] = columns["pixel"][record]
    columns |= {name: np.ones(count, np.int32) for name in ("bounce", "edges", "diffuse")}
    missed = np.arange(count) % 8 != 0
    for name, none in (("t", 3.4e38), ("u", 0), ("v", 0), ("prim", -1), ("owner", -1)):
        columns[name][missed] = none
    columns["pdf"] = np.zeros(count, np.float32)
    columns["left"] = np.zeros((count, 3), np.float32)  # in no medium
    return Batch.of_task(Kind.PATH, 1, 0, 0, count, columns)


def test_gather_rays_take_a_quarter() -> None:
    rays = gather_rays(2000)
    require_same(over_the_wire(rays), rays)
    assert size_of(rays) < rays.nbytes / 4


def test_a_short_batch_is_few_frames() -> None:
    assert len(packing.encode(p.PeerBatches(1, (gather_rays(10),)))) == 3
    assert len(packing.encode(p.PeerBatches(1, (Batch.of_task(Kind.ENDED, 1, 0, 0, 9, {}),)))) == 2


def test_large_columns_are_not_copied() -> None:
    directions = np.random.default_rng(0).random((50_000, 3), np.float32)
    points = arrays(Kind.GHOST_POINTS, len(directions))
    points["position"] = directions
    frames = packing.encode(p.PeerBatches(1, (Batch.of_task(Kind.GHOST_POINTS, -1, 0, 0, 0, points),)))
    assert any(np.shares_memory(np.frombuffer(frame, np.uint8), directions) for frame in frames[1:])


def test_very_long_columns_need_no_memory_of_their_own() -> None:
    rows = short_arrays.LONG_ROWS + 1
    sites = zeros(Kind.COPIED_IRRADIANCE, rows)
    sites["id"] = np.arange(rows, dtype=np.int64)
    told_as = short_arrays.shorten(Kind.COPIED_IRRADIANCE, sites)
    assert told_as.forms == ""
    assert all(np.shares_memory(block, column) for block, column in zip(told_as.blocks, sites.values(), strict=True))
    arrived = short_arrays.lengthen(Kind.COPIED_IRRADIANCE, told_as, "arrays")
    assert all(np.array_equal(arrived[name], column) for name, column in sites.items())


@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        ({}, "expected"),
        ({**arrays(Kind.LIT, 2), "more": np.zeros(2, np.int32)}, "more"),
        ({**arrays(Kind.LIT, 2), "slot": np.zeros(3, np.int32)}, r"lit\.place"),
        ({**arrays(Kind.LIT, 2), "slot": np.zeros(2, np.int64)}, r"lit\.slot is int64"),
    ],
)
def test_other_arrays_than_those_of_the_kind_are_not_sent(columns: dict[str, NDArray[Any]], reason: str) -> None:
    with pytest.raises(ProtocolError, match=reason):
        packing.encode(p.PeerBatches(1, (Batch.of_task(Kind.LIT, 1, 0, 0, 1, columns),)))


def told(kind: str, rows: int, forms: str, *blocks: bytes) -> Any:
    """What is read of a batch that somebody put together."""
    described = [["|u1", [len(block)]] for block in blocks]
    batch = [kind, 0, [["<i8", [1, 4]]], [rows, forms, described]]
    header = [packing.MAGIC, p.PROTOCOL, "PeerBatches", [1, [batch]]]
    return packing.decode([msgpack.packb(header), Runs.one(0, 1, max(0, rows), 1).table.tobytes(), *blocks], ALL)


@pytest.mark.parametrize(
    ("kind", "rows", "forms", "blocks", "reason"),
    [
        ("lit", -1, "", [bytes(40)], "-1 rows in 40 bytes"),
        ("lit", 2**40, "010101", [bytes(40)], "rows in 40 bytes"),
        ("lit", 41, "010101", [bytes(40)], "41 rows in 40 bytes"),
        ("ended", 8, "", [bytes(8)], "more than their forms say"),
        ("lit", 2, "0101", [bytes(40)], "2 digits for each of 3"),
        ("lit", 2, "01010g", [bytes(40)], "non-hexadecimal"),
        ("lit", 2, "01 01 ", [bytes(40)], "columns of 2 rows"),
        ("lit", 2, "010101", [bytes(24)], "cut short"),
        ("lit", 2, "010101", [bytes(8), bytes(8)], "less than"),
        ("lit", 2, "010101", [bytes(32), bytes(8)], "more than"),
        ("lit", 2, "010101", [bytes(40)], "more than"),
        ("lit", 2, "060102", [bytes(40)], "02 is no form of a column of float32"),
        ("lit", 2, "080101", [bytes(40)], "08 is no form"),
        ("lit", 2, "600101", [bytes(40)], "60 is no form"),
        ("lit", 2, "500101", [bytes(40)], "50 is no form"),
        ("lit", 2, "010151", [bytes(40)], "51 is no form"),
        ("lit", 2, "010130", [bytes(40)], "30 is no form"),
        ("lit", 2, "100101", [b"\x40" + bytes(39)], "runs begin behind"),
        ("lit", 2, "100101", [bytes(40)], "runs begin behind"),
        ("lit", 2, "200101", [bytes(40)], "no runs before"),
        ("lit", 2, "400101", [bytes(40)], "no rows were picked"),
        ("lit", 2, "020101", [b"\0" * 7 + b"\x7f" + bytes(32)], "is no int32"),
        ("lit", 8, "050101", [bytes(8) + b"\xff" * 8], "less than"),
    ],
)
def test_columns_that_are_none_are_refused(kind: str, rows: int, forms: str, blocks: list[bytes], reason: str) -> None:
    with pytest.raises(ProtocolError, match=reason):
        told(kind, rows, forms, *blocks)


def test_blocks_that_have_shapes_are_refused() -> None:
    batch = ["lit", 0, [["<i8", [1, 4]]], [2**30, "", [["|u1", [2**30, 0]]]]]
    header = [packing.MAGIC, p.PROTOCOL, "PeerBatches", [1, [batch]]]
    with pytest.raises(ProtocolError, match="is of shape"):
        packing.decode([msgpack.packb(header), Runs.one(0, 1, 2**30, 1).table.tobytes()], ALL)


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_a_damaged_batch_is_a_protocol_error_or_another_batch(data: st.DataObject) -> None:
    """Of the right arrays, as many rows as it says, and no more than it has bytes."""
    frames = [bytearray(frame) for frame in packing.encode(p.PeerBatches(1, (gather_rays(512),)))]
    header = msgpack.unpackb(bytes(frames[0]))
    told_of = header[3][1][0][-1]
    for _ in range(data.draw(st.integers(1, 3))):
        match data.draw(st.sampled_from(["rows", "forms", "bytes", "bits"])):
            case "rows":
                told_of[0] = data.draw(st.integers(0, 700) | st.sampled_from([-1, 2**31, 2**62]))
            case "forms":
                at = 2 * data.draw(st.integers(0, len(told_of[1]) // 2 - 1))
                form = data.draw(st.integers(0, 5)) << 4 | data.draw(st.integers(0, 7))
                told_of[1] = told_of[1][:at] + f"{form:02x}" + told_of[1][at + 2 :]
            case "bytes":
                del frames[2][data.draw(st.integers(0, len(frames[2]))) :]
                told_of[2] = [["|u1", [len(frames[2])]]]
            case "bits" if frames[2]:
                frames[2][data.draw(st.integers(0, len(frames[2]) - 1))] ^= data.draw(st.integers(1, 255))
    with contextlib.suppress(ProtocolError):
        sent = [msgpack.packb(header), bytes(frames[1]), *([bytes(frames[2])] if frames[2] else [])]
        arrived = packing.decode(sent, ALL).batches[0]
        arrived.check()
        assert len(arrived) <= len(frames[2])
