"""The master does not hold what it has sent: neither the scene's triangles nor the pilot's copy of them."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from typing import Any

from wdpm.cluster.render_settings import RenderSettings
from wdpm.kernels.launch import Launcher
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.arrays import Triangles


def held_triangles(function: Callable[..., Any]) -> Triangles:
    """The triangles that a partition function has in its closure."""
    lists = [cell.cell_contents for cell in function.__closure__ or () if isinstance(cell.cell_contents, list)]
    (triangles,) = (item for held in lists for item in held)
    assert isinstance(triangles, Triangles)
    return triangles


def test_after_the_last_cell_nothing_holds_the_triangles() -> None:
    prepared = prepare(cornell_box((8, 8)), RenderSettings(photons=1000), 4, Launcher("cpu", 1), SilentProgress())
    assert prepared.pilot is None
    partition = prepared.session.partition
    watched = weakref.ref(held_triangles(partition).positions)
    parts = [partition(cell) for cell in range(3)]
    gc.collect()
    assert watched() is not None
    parts.append(partition(3))
    gc.collect()
    assert watched() is None
    assert len({int(i) for part in parts for i in part.ids}) == prepared.triangles
