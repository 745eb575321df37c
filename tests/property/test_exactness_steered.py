"""The exactness contract where photons are steered: cells, threads and routings change no bit."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from digests import alone, same_bits
from window_room import hut_on_a_field

import wdpm
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process

HUT = hut_on_a_field((24, 16))
STEERED = RenderSettings(
    integrator=Integrator.PHOTONS, indirect=Indirect.MAP, photons=500, k=20, spp=2, light_samples=1, all_effects=True
)


@pytest.fixture(scope="module")
def reference() -> Image:
    """The image of one cell, one thread and one bucket."""
    return alone(HUT, STEERED)


def test_steering_is_seen_in_the_image(reference: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    assert any("photons steered" in line for line in reference.metadata["report"]["chose"])
    monkeypatch.setattr("wdpm.cluster.plan.steering.pilot.WORTH", 0.0)
    assert not np.array_equal(alone(HUT, STEERED).layers["indirect"], reference.layers["indirect"])


@pytest.mark.parametrize(
    ("cells", "workers", "threads", "routing"),
    [(2, 1, 1, Routing.FORWARD), (1, 1, 3, Routing.MERGE), (8, 3, 2, Routing.MERGE)],
)
def test_cells_threads_and_routings_change_no_bit(
    reference: Image, cells: int, workers: int, threads: int, routing: Routing
) -> None:
    chosen = replace(STEERED, routing=routing, bucket=8)
    order = random.Random(cells) if cells > 2 else None
    image = render_in_process(HUT, chosen, workers=workers, cells=cells, threads=threads, shuffle=order)
    assert same_bits(image, reference)


@pytest.mark.sockets
def test_slaves_over_sockets_give_the_same_bits(reference: Image) -> None:
    with wdpm.Cluster.local(slaves=2) as cluster:
        assert same_bits(cluster.render(HUT, STEERED), reference)
