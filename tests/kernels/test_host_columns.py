"""Columns in the host's memory: kernels read and write what numpy sees, and what is given is looked at."""

from __future__ import annotations

import gc

import numpy as np
import pytest
import warp as wp

from wdpm.kernels import columns, host_columns
from wdpm.kernels.camera.add_samples import Parts
from wdpm.kernels.camera.paths import Paths
from wdpm.kernels.camera.shadow_rays import Segments
from wdpm.kernels.camera.vertices import Coats, Shaded, Shots
from wdpm.kernels.host_columns import HostColumns
from wdpm.kernels.photons.deposits import Deposits, StoredPhotons

ITEMS = 5


@wp.struct
class Turned:
    """Columns of what numpy is not told the name of."""

    frame: wp.array[wp.mat33]


@wp.struct
class Nest:
    """Columns of both kinds."""

    turned: Turned
    photons: StoredPhotons


@wp.kernel
def darken(coats: Coats) -> None:
    """Colours by the number of their kind."""
    i = wp.tid()
    coats.bsdf[i].color = coats.bsdf[i].color * 0.5 * float(coats.bsdf[i].kind)


@wp.kernel
def double(photons: StoredPhotons, photons_out: StoredPhotons) -> None:
    """Twice the flux, and numbers that follow."""
    i = wp.tid()
    photons_out.flux[i] = photons.flux[i] * 2.0
    photons_out.id[i] = photons.id[i] + wp.int64(photons.id.shape[0])
    photons.edges[i] = photons.edges[i] + 1


def some_photons() -> dict[str, np.ndarray]:
    """Arrays of numbers of their own."""
    made = columns.download(columns.empty(StoredPhotons, ITEMS, "cpu"), StoredPhotons.vars)
    for number, array in enumerate(made.values()):
        array[...] = (np.arange(array.size).reshape(array.shape) + number).astype(array.dtype)
    return made


def test_a_kernel_reads_and_writes_what_numpy_sees() -> None:
    arrays = some_photons()
    edges = arrays["edges"].copy()
    made = columns.empty(StoredPhotons, ITEMS, "cpu")
    wp.launch(double, ITEMS, inputs=[columns.upload(StoredPhotons, arrays, "cpu"), made], device="cpu")
    np.testing.assert_array_equal(columns.column(made, "flux"), arrays["flux"] * 2)
    np.testing.assert_array_equal(made.id.numpy(), arrays["id"] + ITEMS)
    np.testing.assert_array_equal(arrays["edges"], edges + 1)  # refined in place


def test_read_only_and_strided_arrays_are_copied() -> None:
    arrays = some_photons()
    edges = np.repeat(arrays["edges"], 2)
    edges.flags.writeable = False
    before = edges.copy()
    photons = columns.upload(StoredPhotons, {**arrays, "edges": edges[::2]}, "cpu")
    wp.launch(double, ITEMS, inputs=[photons, columns.empty(StoredPhotons, ITEMS, "cpu")], device="cpu")
    np.testing.assert_array_equal(columns.column(photons, "edges"), before[::2] + 1)
    np.testing.assert_array_equal(edges, before)


def test_read_only_arrays_are_copied_for_kernels_that_write_to_them_alone() -> None:
    arrays = some_photons()
    for array in arrays.values():
        array.flags.writeable = False
    edges = arrays["edges"].copy()
    photons = columns.upload(StoredPhotons, arrays, "cpu", written=("edges",))
    made = columns.empty(StoredPhotons, ITEMS, "cpu")
    wp.launch(double, ITEMS, inputs=[photons, made], device="cpu")
    np.testing.assert_array_equal(columns.column(made, "flux"), arrays["flux"] * 2)
    np.testing.assert_array_equal(columns.column(photons, "edges"), edges + 1)
    np.testing.assert_array_equal(arrays["edges"], edges)
    assert np.shares_memory(columns.column(photons, "flux"), arrays["flux"])


def test_columns_of_one_block_do_not_overlap_and_outlive_it() -> None:
    made = columns.empty(StoredPhotons, ITEMS, "cpu")
    arrays = columns.download(made, StoredPhotons.vars)
    for number, array in enumerate(arrays.values()):
        assert array.__array_interface__["data"][0] % host_columns.ALIGNMENT == 0
        array.view(np.uint8)[...] = number
    del made
    gc.collect()
    others = [np.full(4096, 255, np.uint8) for _ in range(8)]
    assert all((array.view(np.uint8) == number).all() for number, array in enumerate(arrays.values()))
    assert len(others) == 8


def test_a_member_that_is_set_is_what_kernels_get() -> None:
    photons = columns.upload(StoredPhotons, some_photons(), "cpu")
    photons.flux = wp.full(ITEMS, wp.vec3(1.0, 2.0, 3.0), dtype=wp.vec3, device="cpu")
    made = columns.empty(StoredPhotons, ITEMS, "cpu")
    wp.launch(double, ITEMS, inputs=[photons, made], device="cpu")
    assert columns.column(made, "flux").tolist() == [[2.0, 4.0, 6.0]] * ITEMS
    assert columns.column(photons, "flux").tolist() == [[1.0, 2.0, 3.0]] * ITEMS


def test_columns_of_unlike_lengths() -> None:
    one = {name: np.zeros((1, *shape), columns_of) for name, shape, columns_of in _items_of(Parts)}
    first = next(iter(one))
    parts = columns.upload(Parts, {**one, first: np.zeros(3, one[first].dtype)}, "cpu")
    assert [len(columns.column(parts, name)) for name in one] == [3, *[1] * (len(one) - 1)]
    assert len(getattr(parts, first)) == 3


def _items_of(struct: object) -> list[tuple[str, tuple[int, ...], np.dtype]]:
    layout = host_columns.layout_of(struct)
    assert layout is not None
    return [(name, layout.shapes[name], layout.numbers[name]) for name in layout.types]


def test_items_of_another_shape_are_refused() -> None:
    with pytest.raises(ValueError, match=r"StoredPhotons.flux: items of shape \(\), expected \(3,\)"):
        columns.upload(StoredPhotons, {**some_photons(), "flux": np.zeros(ITEMS, np.float32)}, "cpu")


def test_structs_within_a_struct() -> None:
    counts = {"seen": ITEMS, "queries": ITEMS, "coats": 0, "shots": 2 * ITEMS, "paths": 0, "stretches": 0}
    shaded = columns.empty_nested(Shaded, counts, "cpu")
    assert columns.are_there(shaded.shots)
    assert not columns.are_there(shaded.paths)
    assert shaded.paths.slot is None
    assert len(columns.column(shaded.shots, "slot")) == 2 * ITEMS
    place = columns.column(shaded.shots, "slot").__array_interface__["data"][0]
    assert shaded.__ctype__().shots.slot.data == place
    assert shaded.__ctype__().shots.slot.shape[0] == 2 * ITEMS
    assert shaded.__ctype__().paths.slot.data == 0


def test_columns_of_structs() -> None:
    counts = {"seen": ITEMS, "queries": ITEMS, "coats": ITEMS, "shots": ITEMS, "paths": ITEMS, "stretches": 0}
    coats = columns.empty_nested(Shaded, counts, "cpu").coats
    assert isinstance(coats, HostColumns)
    columns.column(coats, "bsdf")["kind"][...] = np.arange(ITEMS)
    columns.column(coats, "bsdf")["color"][...] = 0.5
    assert coats.bsdf.numpy()["kind"].tolist() == list(range(ITEMS))
    wp.launch(darken, ITEMS, inputs=[coats], device="cpu")
    assert columns.member(coats, "bsdf", "color").tolist() == [[0.25 * i] * 3 for i in range(ITEMS)]
    some = columns.chosen(Coats, coats, np.array([3, 1]), "cpu")
    assert columns.member(some, "bsdf", "kind").tolist() == [3, 1]


def test_structs_whose_items_numpy_does_not_know_are_warps_own() -> None:
    assert host_columns.layout_of(Turned) is None
    counts = {"turned": ITEMS, "photons": ITEMS}
    nest = columns.empty_nested(Nest, counts, "cpu")
    assert isinstance(nest.photons, HostColumns)
    assert nest.__ctype__().turned.frame.data == nest.turned.frame.ptr
    assert columns.are_there(nest.turned)
    assert not columns.are_there(columns.empty_nested(Nest, {**counts, "turned": 0}, "cpu").turned)
    deposits = columns.empty_nested(Deposits, {"photons": ITEMS}, "cpu")
    assert len(deposits.photons.id) == ITEMS


def test_a_part_of_other_columns_shares_their_memory() -> None:
    shots = columns.empty(Shots, ITEMS, "cpu")
    segments = columns.part_of(Segments, shots)
    columns.column(shots, "slot")[...] = np.arange(ITEMS)
    assert segments.slot.numpy().tolist() == list(range(ITEMS))


def test_there_are_no_other_members() -> None:
    with pytest.raises(AttributeError, match="no member colour"):
        _ = columns.empty(Paths, 1, "cpu").colour


@pytest.mark.parametrize("writeable", [True, False])
@pytest.mark.parametrize("items", [0, 1, ITEMS])
def test_a_kernel_is_told_where_each_array_begins_and_how_long_it_is(items: int, writeable: bool) -> None:
    arrays = {name: array[ITEMS - items :] for name, array in some_photons().items()}
    for array in arrays.values():
        array.flags.writeable = writeable
    told = columns.upload(StoredPhotons, arrays, "cpu", written=()).__ctype__()
    for name, array in arrays.items():
        assert getattr(told, name).shape[0] == items
        assert not items or getattr(told, name).data == array.__array_interface__["data"][0]


def test_columns_that_are_asked_for_together_are_those_that_are_asked_for_one_by_one() -> None:
    for made in (columns.empty(StoredPhotons, ITEMS, "cpu"), columns.upload(StoredPhotons, some_photons(), "cpu")):
        one = columns.column(made, "flux")
        for names in (("id", "flux"), tuple(StoredPhotons.vars)):
            together = columns.download(made, names)
            assert tuple(together) == names
            assert together["flux"] is one
