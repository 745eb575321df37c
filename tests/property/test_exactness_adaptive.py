"""Which samples a pass takes, and the image of adaptive passes, are the same bits on any cluster."""

from __future__ import annotations

import random
from dataclasses import replace

import effect_scenes
import pytest

import wdpm
from wdpm.cluster.render_settings import RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box
from wdpm.scenes.model.scene import Scene

pytestmark = pytest.mark.usefixtures("small_pilot")

FEW = RenderSettings(
    photons=1000, caustic_photons=500, volume_photons=1000, spp=14, passes=7, k=20, caustic_k=10, adaptive=True
)


def fogs() -> Scene:
    """A scene with all three maps, large enough to have parts that differ."""
    scene = effect_scenes.fogs()
    return replace(scene, camera=replace(scene.camera, width=20, height=20))


@pytest.fixture(scope="module")
def foggy() -> Image:
    """Rendered in one cell."""
    return render_in_process(fogs(), FEW, workers=1)


def test_samples_differ_from_part_to_part(foggy: Image) -> None:
    assert len(set(foggy.layers["samples"].ravel().tolist())) > 1


@pytest.mark.parametrize(
    ("workers", "cells", "settings"),
    [(2, 2, FEW), (3, 4, RenderSettings(**{**vars(FEW), "bucket": 5, "routing": Routing.MERGE}))],
    ids=["forward", "merge, small buckets"],
)
def test_any_cluster_gives_the_same_bits(workers: int, cells: int, settings: RenderSettings, foggy: Image) -> None:
    image = render_in_process(fogs(), settings, workers=workers, cells=cells, shuffle=random.Random(cells))
    assert image.digest() == foggy.digest()


def test_processes_and_sockets_give_the_same_bits() -> None:
    scene, settings = cornell_box((24, 20)), RenderSettings(photons=2000, spp=6, passes=6, adaptive=True)
    alone = wdpm.render(scene, settings)
    with wdpm.Cluster.local(slaves=2, threads=2) as cluster:
        together = cluster.render(scene, settings)
    assert together.digest() == alone.digest()
