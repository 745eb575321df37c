"""Columns in one block: they hold what they were given, live as long as they are held, and travel in one copy."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from unittest import mock

import numpy as np
import pytest
import warp as wp

from wdpm.kernels import blocks, columns
from wdpm.kernels.camera.vertices import Coats
from wdpm.kernels.photons.deposits import StoredPhotons

ITEMS = 7
DTYPES = (wp.int32, wp.vec3, wp.float64, wp.bool, wp.int64)


@pytest.fixture
def device_of_its_own() -> Iterator[tuple[mock.Mock, mock.Mock]]:
    """The CPU as a device that shares no memory with the host; what copies a block up, and down."""
    with (
        mock.patch.object(blocks, "shares_memory", return_value=False),
        mock.patch.object(blocks, "send", wraps=blocks.send) as send,
        mock.patch.object(blocks, "fetch", wraps=blocks.fetch) as fetch,
    ):
        yield send, fetch


def some_photons() -> dict[str, np.ndarray]:
    """Columns with numbers of their own."""
    arrays = {}
    for name, var in StoredPhotons.vars.items():
        made = wp.zeros(ITEMS, dtype=var.type.dtype, device="cpu").numpy()
        arrays[name] = (np.arange(made.size).reshape(made.shape) + len(arrays)).astype(made.dtype)
    return arrays


def test_columns_do_not_overlap() -> None:
    made = blocks.room(DTYPES, ITEMS, "cpu")
    for number, column in enumerate(made):
        assert column.ptr % blocks.ALIGNMENT == made[0].ptr % blocks.ALIGNMENT
        column.numpy().view(np.uint8)[...] = number
    for number, column in enumerate(made):
        assert (column.numpy().view(np.uint8) == number).all()


def test_a_column_keeps_its_block() -> None:
    column = blocks.room(DTYPES, ITEMS, "cpu")[1]
    view = column.numpy()
    view[...] = 3.0
    del column
    gc.collect()
    others = [wp.full(4096, 1.0, dtype=wp.float32, device="cpu") for _ in range(8)]
    assert (view == 3.0).all()
    assert len(others) == 8


def test_no_items() -> None:
    assert [len(column) for column in blocks.room(DTYPES, 0, "cpu")] == [0] * len(DTYPES)
    assert [len(column) for column in blocks.from_host([np.zeros(0, np.int32)], [wp.int32], "cpu")] == [0]


def test_all_columns_travel_at_once(device_of_its_own: tuple[mock.Mock, mock.Mock]) -> None:
    send, fetch = device_of_its_own
    arrays = some_photons()
    photons = columns.upload(StoredPhotons, arrays, "cpu")
    arrays["id"] = arrays["id"].copy()
    back = columns.download(photons, arrays)
    assert send.call_count == 1
    assert fetch.call_count == 1
    for name, array in arrays.items():
        assert back[name].dtype == array.dtype
        np.testing.assert_array_equal(back[name], array)


@pytest.mark.usefixtures("device_of_its_own")
def test_what_came_down_stays_when_more_comes() -> None:
    arrays = some_photons()
    photons = columns.upload(StoredPhotons, arrays, "cpu")
    first = columns.download(photons, ["flux"])
    columns.upload(StoredPhotons, {name: np.zeros_like(array) for name, array in arrays.items()}, "cpu")
    np.testing.assert_array_equal(first["flux"], arrays["flux"])
    assert not np.shares_memory(first["flux"], photons.flux.numpy())


def test_no_more_comes_down_than_from_the_first_column_to_the_last(
    device_of_its_own: tuple[mock.Mock, mock.Mock],
) -> None:
    photons = columns.upload(StoredPhotons, some_photons(), "cpu")
    columns.download(photons, ["flux"])
    assert device_of_its_own[1].call_args.args[3] == ITEMS * 12


@pytest.mark.usefixtures("device_of_its_own")
def test_columns_of_unlike_lengths() -> None:
    given = [np.arange(3, dtype=np.int32), np.zeros(0, np.float32), np.ones((2, 3), np.float32)]
    made = blocks.from_host(given, [wp.int32, wp.float32, wp.vec3], "cpu")
    for array, column in zip(given, made, strict=True):
        np.testing.assert_array_equal(column.numpy(), array)


@pytest.mark.parametrize("shared", [True, False])
def test_some_rows(shared: bool) -> None:
    arrays, rows = some_photons(), np.array([5, 0, 6])
    with mock.patch.object(blocks, "shares_memory", return_value=shared):
        photons = columns.upload(StoredPhotons, arrays, "cpu")
        few = columns.download(columns.chosen(StoredPhotons, photons, rows, "cpu"), arrays)
        parts = list(columns.download_parts(photons, arrays, [(2, 3), (0, 1)]))
    for name, array in arrays.items():
        np.testing.assert_array_equal(few[name], array[rows])
        np.testing.assert_array_equal(parts[0][name], array[2:5])
        np.testing.assert_array_equal(parts[1][name], array[:1])


@pytest.mark.parametrize("shared", [True, False])
def test_a_member_of_a_column_of_structs(shared: bool) -> None:
    with mock.patch.object(blocks, "shares_memory", return_value=shared):
        coats = columns.empty(Coats, ITEMS, "cpu")
        whole = columns.column(coats, "bsdf")
        kinds = columns.member(coats, "bsdf", "kind")
    whole["kind"][...] = np.arange(ITEMS)
    del coats, whole
    gc.collect()
    assert kinds.tolist() == list(range(ITEMS))
