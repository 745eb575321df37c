"""The exactness contract where rays are guided, to lights or caustics: what is learnt, and what is rendered with it."""

from __future__ import annotations

import random
from dataclasses import replace

import mirrored_lamp
import numpy as np
import pytest
import two_rooms
import window_room
from digests import alone, same_bits

import wdpm
from wdpm.cluster.render_settings import Integrator, RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.model.scene import Scene

pytestmark = pytest.mark.usefixtures("small_pilot")

PATH = RenderSettings(integrator=Integrator.PATH, spp=1, light_samples=2, all_effects=True)
BY_PHOTONS = RenderSettings(photons=2000, k=20, spp=2, light_samples=2, all_effects=True)
CASES: dict[str, tuple[Scene, RenderSettings]] = {
    "path": (window_room.room(size=(24, 16)), PATH),
    "photons": (window_room.room(size=(24, 16)), BY_PHOTONS),
    "lamps": (two_rooms.rooms((two_rooms.POINT, two_rooms.SUN), size=(24, 16)), PATH),
    "caustics": (mirrored_lamp.mirrored(0.03), replace(PATH, spp=2)),
}

_alone: dict[str, Image] = {}


def reference_of(case: str) -> Image:
    """The image of one cell, one thread and one bucket; the same for all tests of a case."""
    if case not in _alone:
        _alone[case] = alone(*CASES[case])
    return _alone[case]


@pytest.mark.parametrize("case", list(CASES))
def test_the_guide_is_seen_in_the_image(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    guided = reference_of(case)
    layer = "indirect" if case == "caustics" else "direct"
    monkeypatch.setattr("wdpm.cluster.plan.guide_tiles.WORTH", 0.0)
    monkeypatch.setattr("wdpm.cluster.plan.guide_starts.WORTH", 0.0)
    monkeypatch.setattr("wdpm.cluster.plan.caustics.guide.WORTH", 0.0)
    assert not np.array_equal(alone(*CASES[case]).layers[layer], guided.layers[layer])


@pytest.mark.parametrize(
    ("case", "cells", "workers", "threads", "routing"),
    [
        ("path", 1, 1, 3, Routing.FORWARD),
        ("path", 2, 1, 1, Routing.MERGE),
        ("path", 8, 2, 1, Routing.MERGE),
        ("photons", 8, 3, 2, Routing.FORWARD),
        ("lamps", 8, 3, 2, Routing.MERGE),
        ("caustics", 1, 1, 3, Routing.FORWARD),
        ("caustics", 8, 3, 2, Routing.MERGE),
        ("caustics", 4, 2, 1, Routing.FORWARD),
    ],
)
def test_cells_threads_and_routings_change_no_bit(
    case: str, cells: int, workers: int, threads: int, routing: Routing
) -> None:
    scene, settings = CASES[case]
    chosen = replace(settings, routing=routing, bucket=7)
    order = random.Random(cells) if cells > 2 else None
    image = render_in_process(scene, chosen, workers=workers, cells=cells, threads=threads, shuffle=order)
    assert same_bits(image, reference_of(case))


@pytest.mark.parametrize("case", ["path", "lamps", "caustics"])
def test_processes_change_no_bit(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wdpm.rendering.in_process.WORTH_FORKING", 0)
    assert same_bits(render_in_process(*CASES[case], workers=1, threads=2), reference_of(case))


@pytest.mark.own_kernels
@pytest.mark.parametrize("case", ["path", "caustics"])
def test_few_effects_give_the_same_bits(case: str) -> None:
    scene, settings = CASES[case]
    assert same_bits(alone(scene, replace(settings, all_effects=False)), reference_of(case))


def test_passes_change_no_bit_on_any_cluster() -> None:
    chosen = replace(PATH, spp=2, passes=2)
    scene, _ = CASES["lamps"]
    one = render_in_process(scene, chosen, workers=1)
    assert same_bits(render_in_process(scene, chosen, workers=2, cells=4, shuffle=random.Random(3)), one)


@pytest.mark.sockets
def test_slaves_over_sockets_give_the_same_bits() -> None:
    with wdpm.Cluster.local(slaves=2) as cluster:
        for case in ("path", "caustics"):
            assert same_bits(cluster.render(*CASES[case]), reference_of(case)), case
