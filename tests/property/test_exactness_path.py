"""The exactness contract of path tracing: the same bits in any partition, and whatever kernels are compiled for."""

from __future__ import annotations

import random
from dataclasses import replace

import effect_scenes
import numpy as np
import pytest
from digests import alone, same_bits
from watched_batches import watch_batches

import wdpm
from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import Integrator, RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.scene import Medium, Scene

PATH = RenderSettings(integrator=Integrator.PATH, spp=3, light_samples=2, all_effects=True)


def open_fog() -> Scene:
    """Things in a fog without walls, in a space of it: paths collide beyond all surfaces, and in cells without any."""
    room = effect_scenes.fogs()
    lamp = next(mesh for mesh in room.meshes if mesh.name == "lamp")
    block = next(mesh for mesh in room.meshes if mesh.name == "block")
    sky = Environment("sky", np.full((1, 1, 3), 0.3, np.float32))
    # Of a brighter haze a few paths would go on for hundreds of collisions, each in a batch of its own.
    haze = Medium("haze", (1.2, 0.9, 0.7), (0.6, 0.5, 0.4), 0.3)
    return replace(room, meshes=(lamp, block), lights=(*room.lights[1:], sky), media=(haze, *room.media[1:]))


SCENES = {
    "diffuse": cornell_box((16, 12)),
    "metals": effect_scenes.metals(),
    "glasses": effect_scenes.glasses(),
    "coats": effect_scenes.coats(),
    "panes": effect_scenes.panes(),
    "fogs": effect_scenes.fogs(),
    "open fog": open_fog(),
    "everything": effect_scenes.everything(),
}

LAYERS = {"fogs": "direct indirect volume", "open fog": "direct volume", "everything": "direct indirect volume"}
"""In which light must show, or the equality of bits says little."""

_alone: dict[str, Image] = {}


@pytest.fixture(params=list(SCENES))
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def reference(name: str) -> Image:
    """The image of one cell, one thread and one bucket; the same for all tests of a scene."""
    if name not in _alone:
        _alone[name] = alone(SCENES[name], PATH)
    return _alone[name]


def test_all_that_paths_find_is_there(name: str, reference: Image) -> None:
    assert reference.metadata["report"]["nonfinite"] == {}
    assert reference.metadata["report"]["photons"]["paths"] == 0
    assert "caustic" not in reference.layers
    assert ("volume" in reference.layers) == (name in LAYERS)
    for layer in LAYERS.get(name, "direct indirect").split():
        assert np.count_nonzero(reference.layers[layer].any(axis=2)) > 20, layer


@pytest.mark.parametrize(
    ("cells", "workers", "threads", "bucket", "routing"),
    [(2, 1, 1, 32, Routing.MERGE), (4, 3, 3, 5, Routing.FORWARD), (8, 2, 1, 7, Routing.MERGE)],
    ids=["2", "4", "8"],
)
def test_partition_threads_buckets_and_order_change_no_bit(
    name: str, reference: Image, cells: int, workers: int, threads: int, bucket: int, routing: Routing
) -> None:
    chosen = replace(PATH, routing=routing, bucket=bucket)
    order = random.Random(cells) if cells > 2 else None
    image = render_in_process(SCENES[name], chosen, workers=workers, cells=cells, threads=threads, shuffle=order)
    assert same_bits(image, reference)
    assert cells == 2 or len(np.unique(image.layers["cell"])) > 1  # one of two may lie behind all that is seen


@pytest.mark.own_kernels
@pytest.mark.parametrize("name", ["diffuse", "coats", "fogs"])
def test_kernels_for_few_effects_give_the_same_bits(name: str, reference: Image) -> None:
    few = replace(PATH, all_effects=False)
    image = render_in_process(SCENES[name], few, workers=2, cells=4, threads=2, shuffle=random.Random(1))
    assert same_bits(image, reference)


@pytest.mark.parametrize("name", ["everything"])
def test_small_waves_change_no_bit(name: str, reference: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wdpm.cluster.work.bucket_home.WAVE_SAMPLES", 50)
    assert same_bits(render_in_process(SCENES[name], PATH, workers=2, cells=4, threads=3), reference)


@pytest.mark.parametrize("name", ["everything", "open fog"])
def test_every_batch_is_valid_and_no_credit_is_lost_or_made(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    collided: set[bool] = set()

    def look(batch: Batch) -> None:
        if batch.kind is Kind.VERTEX:
            collided.update(batch.arrays["prim"] < 0)

    watch_batches(monkeypatch, look)
    for routing in Routing:
        render_in_process(SCENES[name], replace(PATH, spp=1, routing=routing), workers=2, cells=4)
    # Where a medium has no end, some paths collide on their way out of the scene.
    assert (True in collided) == (name == "open fog")


@pytest.mark.sockets
@pytest.mark.parametrize("name", ["everything"])
def test_two_slaves_over_sockets_give_the_same_bits(name: str, reference: Image) -> None:
    with wdpm.Cluster.local(slaves=2, copies=Copies.NONE) as cluster:
        for routing in Routing:
            image = cluster.render(SCENES[name], replace(PATH, routing=routing))
            assert same_bits(image, reference)
        assert sum(slave["rays_in"] for slave in image.metadata["report"]["slaves"]) > 0
