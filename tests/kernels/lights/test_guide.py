"""Sampling of an environment with a guide: its density, and that what it finds is what is there."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
import window_room
from light_rig import Array, numbers, sky
from numpy.typing import NDArray

from wdpm.cluster.guide import NO_GUIDE
from wdpm.kernels.lights import environment, guide
from wdpm.kernels.lights.environment import Environment as DeviceEnvironment
from wdpm.kernels.lights.environment import environment_value
from wdpm.kernels.lights.guide import Guide, guided_seen, region_of, sample_guided
from wdpm.kernels.maths.directions import uniform_sphere
from wdpm.scenes.model.lights import Environment, axes_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

COUNT = 1 << 17
SKIES = {
    "map": sky(33, 64),
    "small": sky(3, 4),
    "constant": window_room.constant_sky(),
    "coarse": sky(9, 16, seed=4),
}


@wp.kernel
def _sampled(
    e: DeviceEnvironment,
    known: Guide,
    region: wp.int32,
    u: wp.array[wp.vec2],
    direction_out: wp.array[wp.vec3],
    radiance_out: wp.array[wp.vec3],
    pdf_out: wp.array[wp.float32],
    again_out: wp.array[wp.float32],
):
    i = wp.tid()
    s = sample_guided(e, known, region, u[i])
    direction_out[i] = s.direction
    radiance_out[i] = s.radiance
    pdf_out[i] = s.pdf
    if s.pdf > 0.0:
        again_out[i] = guided_seen(e, known, region, s.direction).pdf


@wp.kernel
def _everywhere(
    e: DeviceEnvironment,
    known: Guide,
    region: wp.int32,
    u: wp.array[wp.vec2],
    direction_out: wp.array[wp.vec3],
    radiance_out: wp.array[wp.vec3],
    pdf_out: wp.array[wp.float32],
):
    i = wp.tid()
    direction_out[i] = uniform_sphere(u[i])
    radiance_out[i] = environment_value(e, direction_out[i])
    pdf_out[i] = guided_seen(e, known, region, direction_out[i]).pdf


@wp.kernel
def _regions(known: Guide, place: wp.array[wp.vec3], region_out: wp.array[wp.int32]):
    i = wp.tid()
    region_out[i] = region_of(known, place[i])


def guided(around: Environment, regions: int = 4) -> tuple[DeviceEnvironment, Guide, NDArray[np.float32]]:
    """An environment, and a guide whose tiles have random probabilities, some of 0 where nothing shines."""
    sky = guide.TiledSky(around.pixels)
    mass = sky.mass
    chance = np.random.default_rng(5).uniform(0.05, 1.0, (regions, *mass.shape)) * (mass > 0)
    chance = (chance / chance.sum(axis=(1, 2), keepdims=True)).astype(np.float32)
    axis, split = np.arange(regions - 1, dtype=np.int32) % 3, np.zeros(regions - 1, np.float32)
    none = np.zeros((regions, 0), np.float32)
    known = guide.upload(axis, split, chance, none, none, sky, "cpu")
    return environment.upload(sky.pixels, axes_of(around.to_world).astype(np.float32), "cpu"), known, chance


def launched(kernel: wp.Kernel, inputs: list[object], *kinds: type) -> list[Array]:
    """What a kernel wrote for COUNT items."""
    outputs = [wp.zeros(COUNT, dtype=kind, device="cpu") for kind in kinds]
    wp.launch(kernel, COUNT, inputs=[*inputs, *outputs], device="cpu")
    return [out.numpy().astype(np.float64) for out in outputs]


def points(seed: int) -> wp.array:
    return wp.array(numbers(COUNT, seed), dtype=wp.vec2, device="cpu")


@pytest.mark.parametrize("name", list(SKIES))
@pytest.mark.parametrize("region", [0, 3])
def test_the_density_of_a_sample_is_that_of_its_direction(name: str, region: int) -> None:
    e, known, _ = guided(SKIES[name])
    _, _, pdf, again = launched(_sampled, [e, known, region, points(1)], wp.vec3, wp.vec3, wp.float32, wp.float32)
    close = np.isclose(pdf, again, rtol=1e-3)
    assert (pdf > 0).mean() > 0.99
    assert close.mean() > 0.999  # a direction at the edge of a tile may be rounded into the next one


@pytest.mark.parametrize("name", list(SKIES))
def test_what_is_found_is_what_is_there(name: str) -> None:
    """Integrals of radiance times smooth functions, by guided samples and by directions from all around."""
    e, known, _ = guided(SKIES[name])
    direction, radiance, pdf, _ = launched(_sampled, [e, known, 2, points(1)], wp.vec3, wp.vec3, wp.float32, wp.float32)
    ways, value, density = launched(_everywhere, [e, known, 2, points(2)], wp.vec3, wp.vec3, wp.float32)
    for axis in range(3):
        for sign in (1.0, -1.0):
            guided_terms = radiance * (np.maximum(sign * direction[:, axis], 0.0) / pdf)[:, None]
            terms = value * np.maximum(sign * ways[:, axis], 0.0)[:, None] * (4 * np.pi)
            error = np.hypot(guided_terms.std(axis=0), terms.std(axis=0)) / np.sqrt(COUNT)
            assert (np.abs(guided_terms.mean(axis=0) - terms.mean(axis=0)) < 5 * error).all()
    error = density.std() * 4 * np.pi / np.sqrt(COUNT)
    assert abs(density.mean() * 4 * np.pi - 1) < 5 * error + 1e-3


def test_tiles_are_chosen_as_often_as_the_guide_says() -> None:
    around = SKIES["map"]
    e, known, chance = guided(around)
    direction, *_ = launched(_sampled, [e, known, 1, points(7)], wp.vec3, wp.vec3, wp.float32, wp.float32)
    local = direction @ axes_of(around.to_world).T
    column = np.floor((np.arctan2(local[:, 0], -local[:, 2]) / (2 * np.pi) * 64 - 0.5) % 64).astype(int)
    row = np.minimum(np.floor(np.arccos(np.clip(local[:, 1], -1, 1)) / np.pi * 32).astype(int), 31)
    tile = (row * guide.TILE_ROWS // 32) * guide.TILE_COLUMNS + column * guide.TILE_COLUMNS // 64
    found = np.bincount(tile, minlength=chance[1].size) / COUNT
    expected = chance[1].reshape(-1).astype(np.float64)
    spread = np.sqrt(expected * (1 - expected) / COUNT)
    assert (np.abs(found - expected) < 5 * spread + 1e-4).all()


def test_a_place_is_in_the_region_of_its_leaf() -> None:
    _, known, _ = guided(SKIES["map"])  # the planes x = 0, and y = 0 and z = 0 left and right of it
    places = wp.array([(-1, -1, 0), (-1, 1, 0), (1, 0, -1), (1, 0, 1)], dtype=wp.vec3, device="cpu")
    found = wp.zeros(4, dtype=wp.int32, device="cpu")
    wp.launch(_regions, 4, inputs=[known, places, found], device="cpu")
    assert found.numpy().tolist() == [0, 1, 2, 3]


def test_without_a_guide_there_is_no_region() -> None:
    none = guide.upload(**vars(NO_GUIDE), sky=guide.TiledSky(SKIES["map"].pixels), device="cpu")
    found = wp.zeros(1, dtype=wp.int32, device="cpu")
    wp.launch(_regions, 1, inputs=[none, wp.zeros(1, dtype=wp.vec3, device="cpu"), found], device="cpu")
    assert found.numpy().tolist() == [-1]
