"""The exactness contract with heterogeneous media: a flight is a function of its ray, whatever cells it crosses."""

from __future__ import annotations

import random
from dataclasses import replace

import effect_scenes
import numpy as np
import pytest
from digests import alone, same_bits
from effect_scenes import clouds

from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.scene import Scene

pytestmark = pytest.mark.usefixtures("small_pilot")

PHOTONS = RenderSettings(
    photons=2000, caustic_photons=1000, volume_photons=2000, spp=2, k=20, caustic_k=10, all_effects=True
)
SETTINGS = {"photons": PHOTONS, "paths": replace(PHOTONS, integrator=Integrator.PATH)}


def smokes() -> Scene:
    """The camera in a room of smoke, turned against the cells; another smoke in a box, and ink in a ball of glass."""
    fogs = effect_scenes.fogs()
    haze, smoke, tea = fogs.media
    tint = clouds("tint", (-0.4, -0.5, 0.3), 0.36, 0.0, 3)
    media = (
        replace(haze, density=clouds("haze", (0.0, 0.0, 0.0), 1.3, 20.0)),
        replace(smoke, density=clouds("smoke", (-0.4, -0.5, 0.3), 0.4, 30.0), albedo_volume=tint),
        replace(tea, density=replace(clouds("tea", (0.45, -0.55, 0.2), 0.3, 0.0), nearest=True)),
    )
    return replace(fogs, media=media)


SMOKES = smokes()
_alone: dict[str, Image] = {}


@pytest.fixture(params=list(SETTINGS))
def how(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def reference(how: str) -> Image:
    """The image of one cell, one thread and one bucket; the same for all tests of an integrator."""
    if how not in _alone:
        _alone[how] = alone(SMOKES, SETTINGS[how])
    return _alone[how]


def test_smoke_shows_in_all_layers(how: str, reference: Image) -> None:
    assert reference.metadata["report"]["nonfinite"] == {}
    for layer in ("direct", "indirect", "volume"):
        assert np.count_nonzero(reference.layers[layer].any(axis=2)) > 10, layer
    assert features_of(flatten(SMOKES), replace(SETTINGS[how], all_effects=False)).grids
    assert not features_of(flatten(effect_scenes.fogs()), replace(SETTINGS[how], all_effects=False)).grids


@pytest.mark.parametrize(
    ("cells", "workers", "threads", "bucket"), [(2, 1, 1, 32), (4, 3, 3, 5)], ids=["2 cells", "4 cells"]
)
def test_partition_threads_buckets_and_order_change_no_bit(
    how: str, reference: Image, cells: int, workers: int, threads: int, bucket: int
) -> None:
    chosen = replace(SETTINGS[how], bucket=bucket)
    order = random.Random(cells) if cells > 2 else None
    image = render_in_process(SMOKES, chosen, workers=workers, cells=cells, threads=threads, shuffle=order)
    assert same_bits(image, reference)
    assert image.metadata["report"]["volume"] == reference.metadata["report"]["volume"]
