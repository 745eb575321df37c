"""The master holds no triangles in memory: they lie on disk, to be sent to slaves that come later."""

from __future__ import annotations

import gc
import tempfile
import weakref
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.work.cell import Cell
from wdpm.kernels.launch import Launcher
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import Prepared, prepare
from wdpm.rendering.spool import spooled
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.arrays import ARRAYS, Triangles
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.flat.room import lies_in_file


def prepared_for(workers: int) -> Prepared:
    return prepare(cornell_box((8, 8)), RenderSettings(photons=1000), workers, Launcher("cpu", 1), SilentProgress())


def held_triangles(function: Callable[..., Any]) -> Triangles:
    """The triangles that a partition function has in its closure."""
    held = [cell.cell_contents for cell in function.__closure__ or ()]
    [triangles] = (item for item in held if isinstance(item, Triangles))
    return triangles


def test_the_triangles_lie_on_disk() -> None:
    prepared = prepared_for(4)
    assert prepared.pilot is None
    partition = prepared.session.partition
    held = held_triangles(partition)
    for name in ARRAYS:
        assert lies_in_file(getattr(held, name))
    for _ in range(2):  # a slave that comes later gets them, too
        parts = [partition(cell) for cell in range(4)]
        assert len({int(i) for part in parts for i in part.ids}) == prepared.triangles


def test_what_was_spooled_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    triangles = flatten(cornell_box((8, 8))).triangles
    kept = spooled(triangles)
    assert not lies_in_file(triangles.positions)
    assert {field.name for field in fields(kept)} == {*ARRAYS, "instances"}
    assert kept.instances is triangles.instances
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(kept, name), getattr(triangles, name))
        assert getattr(kept, name).dtype == getattr(triangles, name).dtype
        assert lies_in_file(getattr(kept, name))
    assert spooled(kept).positions is kept.positions
    monkeypatch.setattr(tempfile, "TemporaryFile", no_room)
    assert spooled(triangles).positions is triangles.positions


def test_nothing_of_the_pilot_stays_with_a_master(monkeypatch: pytest.MonkeyPatch) -> None:
    cells: list[weakref.ref[Cell]] = []
    make = Cell.__init__

    def made(self: Cell, *arguments: Any) -> None:
        make(self, *arguments)
        cells.append(weakref.ref(self))

    monkeypatch.setattr(Cell, "__init__", made)
    gc.disable()  # until what is left has been counted
    try:
        prepared_for(4)
        assert cells
        assert not any(cell() for cell in cells)
    finally:
        gc.enable()


def test_of_a_scene_that_is_handed_over_no_mesh_is_held() -> None:
    scene = cornell_box((8, 8))
    mesh = weakref.ref(scene.meshes[0])
    handed_over = [scene]
    del scene
    prepared = prepare(handed_over.pop, RenderSettings(photons=1000), 4, Launcher("cpu", 1), SilentProgress())
    gc.collect()
    assert prepared.triangles == 32
    assert mesh() is None


def no_room(**_: Any) -> Any:
    raise OSError(28, "No space left on device")
