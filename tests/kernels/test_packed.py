"""Structs of kernels as bytes: the same again, as views, and nothing else is taken for them."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from fake_worker import triangles

from wdpm.kernels import packed
from wdpm.kernels.irradiance.record_tree import IrradianceCache
from wdpm.kernels.packed import NotAsExpectedError
from wdpm.kernels.photons import photon_map
from wdpm.kernels.photons.photon_map import PhotonMap
from wdpm.kernels.rays import two_level
from wdpm.kernels.rays.instances import upload_instances
from wdpm.kernels.rays.two_level import Trees

RNG = np.random.default_rng(7)
UP = np.tile(np.float32([0.0, 0.0, 1.0]), (50, 1))


def tree() -> Any:
    return photon_map.build(RNG.random((50, 3)), RNG.random((50, 3)), UP, UP, np.arange(50))


def memory_of(name: str, values: list[Any]) -> memoryview:
    return memoryview(b"".join(packed.pack(name, values)))


def equal(one: Any, other: Any) -> None:
    """Member by member, in structs within structs as well."""
    for name in one._cls.vars:
        a, b = getattr(one, name), getattr(other, name)
        if hasattr(a, "_cls"):
            equal(a, b)
        elif hasattr(a, "numpy"):
            assert a.dtype == b.dtype
            assert a.shape == b.shape
            np.testing.assert_array_equal(a.numpy(), b.numpy())
        else:
            assert a == b


def test_photons_and_arrays_come_back() -> None:
    photons, arrays = tree(), {"edges": np.arange(50, dtype=np.int32), "none": np.zeros((0, 3), np.float32)}
    memory = memory_of("map", [photons, arrays])
    found, others = packed.unpack("map", (PhotonMap, dict), memory)
    equal(photons, found)
    assert found.nodes.ptr % packed.ALIGNMENT == np.frombuffer(memory, np.uint8).ctypes.data % packed.ALIGNMENT
    for name, array in arrays.items():
        np.testing.assert_array_equal(others[name], array)
        assert others[name].dtype == array.dtype


def test_trees_within_trees_come_back() -> None:
    corners = triangles(9)
    trees = two_level.build(corners, upload_instances(corners.instances, "cpu"), 0.25, "cpu")
    [found] = packed.unpack("cell", (Trees,), memory_of("cell", [trees]))
    equal(trees, found)


def described(memory: memoryview) -> tuple[int, Any]:
    length = int.from_bytes(memory[:8], "little")
    return length, json.loads(bytes(memory[8 : 8 + length]))


def changed(memory: memoryview, change: Any) -> memoryview:
    """The same bytes under another description."""
    length, head = described(memory)
    change(head)
    text = json.dumps(head).encode()
    begin, end = (-(-(8 + size) // packed.ALIGNMENT) * packed.ALIGNMENT for size in (length, len(text)))
    return memoryview((len(text).to_bytes(8, "little") + text).ljust(end, b"\0") + bytes(memory[begin:]))


def test_a_description_may_be_written_anew() -> None:
    equal(*(packed.unpack("map", (PhotonMap,), each)[0] for each in both_of(memory_of("map", [tree()]))))


def both_of(memory: memoryview) -> tuple[memoryview, memoryview]:
    return memory, changed(memory, len)


@pytest.mark.parametrize(
    "change",
    [
        lambda head: head.__setitem__(0, "mop"),
        lambda head: head[1].pop("0.count"),
        lambda head: head[2].pop("0.rank"),
        lambda head: head[2]["0.rank"].__setitem__(0, "<f4"),
        lambda head: head[2]["0.flux"].__setitem__(1, [56, 2]),
        lambda head: head[2]["0.rank"].__setitem__(1, [9999]),
        lambda head: head[2]["0.rank"].__setitem__(1, [-1]),
        lambda head: head[2]["0.rank"].__setitem__(2, -4),
        lambda head: head[2]["0.rank"].__setitem__(2, 10**9),
    ],
)
def test_what_is_not_as_expected_is_refused(change: Any) -> None:
    memory = memory_of("map", [tree()])
    with pytest.raises(NotAsExpectedError):
        packed.unpack("map", (PhotonMap,), changed(memory, change))


def test_other_structs_and_other_bytes_are_refused() -> None:
    memory = memory_of("map", [tree()])
    for kinds, there in [
        ((IrradianceCache,), memory),
        ((PhotonMap, PhotonMap), memory),
        ((PhotonMap,), memory[:100]),
        ((PhotonMap,), memory[: len(memory) // 2]),
        ((PhotonMap,), memoryview(b"")),
        ((PhotonMap,), memoryview(bytes(1000))),
    ]:
        with pytest.raises(NotAsExpectedError):
            packed.unpack("map", kinds, there)
