"""The exactness contract where photons are steered: cells, threads and routings change no bit."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from digests import alone, same_bits
from window_room import hut_before_a_mirror, hut_on_a_field

import wdpm
from wdpm.cluster.plan.steering import caustics
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


@pytest.mark.sockets
def test_photons_of_another_camera_are_not_kept(reference: Image) -> None:
    """They are steered by what each camera sees: a frame of a sequence has the bits that it has alone."""
    camera = replace(HUT.camera, to_world=HUT.camera.to_world + np.eye(4, 4, 3) * [[0.2], [0.0], [0.0], [0.0]])
    moved = replace(HUT, camera=camera)
    with wdpm.Cluster.local(slaves=2) as cluster:
        frames = [cluster.render(each, STEERED) for each in (HUT, moved, HUT)]
    for frame, expected in zip(frames, (reference, alone(moved, STEERED), reference), strict=True):
        assert same_bits(frame, expected)
        assert any("photons steered" in line for line in frame.metadata["report"]["chose"])


def test_steered_caustics_have_the_same_bits_in_cells_and_by_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(caustics, "SAMPLES_A_PATH", 0)  # as if there were many
    what, chosen = hut_before_a_mirror((16, 12)), replace(STEERED, caustic_photons=2000)
    reference = alone(what, chosen)
    assert any("caustic photons steered" in line for line in reference.metadata["report"]["chose"])
    image = render_in_process(what, replace(chosen, bucket=8), workers=3, cells=8, threads=2, shuffle=random.Random(8))
    assert same_bits(image, reference)
