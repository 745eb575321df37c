"""An image of several passes is the same bits on any cluster, in any order, with every effect."""

from __future__ import annotations

import random
from dataclasses import replace

import effect_scenes
import numpy as np
import pytest

import wdpm
from wdpm.cluster.render_settings import RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.rendering.in_process import InProcess, render_in_process
from wdpm.rendering.passes import PassRenderer, spread_samples
from wdpm.replaying.run import Replayer
from wdpm.scenes import cornell_box

pytestmark = pytest.mark.usefixtures("small_pilot")

FEW = RenderSettings(photons=2000, caustic_photons=1000, volume_photons=2000, spp=4, passes=4, k=20, caustic_k=10)


@pytest.fixture(scope="module")
def foggy() -> Image:
    """A scene with all three maps, in one cell."""
    return render_in_process(effect_scenes.fogs(), FEW, workers=1)


def test_all_layers_are_there(foggy: Image) -> None:
    for name in ("direct", "indirect", "caustic", "volume", "noise", "bias"):
        assert np.abs(foggy.layers[name]).max() > 0, name


@pytest.mark.parametrize(
    ("workers", "cells", "settings"),
    [(2, 2, FEW), (1, 4, replace(FEW, bucket=6)), (3, 8, replace(FEW, bucket=8, routing=Routing.MERGE))],
    ids=["two cells", "small buckets", "merge"],
)
def test_any_cluster_gives_the_same_bits(workers: int, cells: int, settings: RenderSettings, foggy: Image) -> None:
    scene, order = effect_scenes.fogs(), random.Random(cells)
    image = render_in_process(scene, settings, workers=workers, cells=cells, shuffle=order)
    assert image.digest() == foggy.digest()


def test_processes_and_sockets_give_the_same_bits() -> None:
    scene, settings = cornell_box((16, 12)), RenderSettings(photons=2000, spp=4, passes=4)
    alone = wdpm.render(scene, settings)
    with wdpm.Cluster.local(slaves=2, threads=2) as cluster:
        together = cluster.render(scene, settings)
        # Photons of the last pass are there; those of the first must not be taken for them, nor the other way round.
        again = cluster.render(scene, settings)
        plain = cluster.render(scene, RenderSettings(photons=2000, spp=4))
    assert together.digest() == alone.digest() == again.digest()
    assert plain.digest() == wdpm.render(scene, RenderSettings(photons=2000, spp=4)).digest()


def test_replays_are_of_the_pass_that_takes_the_sample() -> None:
    scene = effect_scenes.fogs()
    settings = RenderSettings(**{**vars(FEW), "spp": 4, "passes": 2})
    renderer = PassRenderer(scene, InProcess(), settings)
    for plan in spread_samples(4, 2):
        layers = renderer.render(plan).layers
        replayer = Replayer(scene, InProcess(), settings, plan)
        for x, y in ((3, 4), (8, 6), (12, 10)):
            samples = [replayer.sample(x, y, plan.first_sample + number) for number in range(plan.spp)]
            for name in ("direct", "indirect", "caustic", "volume"):
                total = samples[0].layers[name] + samples[1].layers[name]
                np.testing.assert_array_equal(layers[name][y, x], (total * 0.5).astype(np.float32), err_msg=name)
        with pytest.raises(wdpm.WdpmError, match="there is no sample"):
            replayer.sample(3, 4, (plan.first_sample + plan.spp) % 4)
