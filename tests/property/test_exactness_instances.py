"""Instances that are held once give the bits that copies give, on any cluster, for all kinds of rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from digests import alone, same_bits
from effect_scenes import HOLES, NOISE, NORMALS, Builder, camera, random_of

from wdpm.cluster.render_settings import Indirect, Instancing, Integrator, RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.meshes.primitives import cube, rectangle, sphere
from wdpm.scenes.model.bsdfs import Conductor, Diffuse, Mask, NormalMap, TwoSided
from wdpm.scenes.model.scene import Instance, Scene, Solid
from wdpm.scenes.model.textures import VertexColors
from wdpm.scenes.model.transforms import rotation, scaling, translation

pytestmark = pytest.mark.usefixtures("small_pilot")

MAP = RenderSettings(photons=2000, caustic_photons=1000, spp=2, k=20, max_depth=7, instances=Instancing.KEEP)
CACHE = replace(MAP, indirect=Indirect.CACHE)
PATHS = replace(MAP, integrator=Integrator.PATH)


def standing() -> Scene:
    """Metal balls, dented cubes, leaves with holes and painted blocks, each turned, stretched and mirrored."""
    b = Builder()
    b.room(Diffuse(NOISE))
    b.lamp()
    walls = len(b.meshes)
    b.add("ball", Conductor(alpha_u=0.2, alpha_v=0.1), sphere(12))
    b.add("dents", NormalMap(Diffuse(NOISE), NORMALS), cube())
    b.add("leaf", Mask(TwoSided(Diffuse((0.2, 0.7, 0.2))), HOLES), rectangle())
    b.add("painted", Diffuse(VertexColors("color", 0.9)), cube(), flat=True, colors=True)
    shapes = b.meshes[walls:]
    random = random_of("places")
    solids: list[Solid] = list(b.meshes[:walls])
    for number in range(16):
        sizes = random.uniform(0.1, 0.25, 3) * (1.0, 1.0, -1.0 if number % 3 == 0 else 1.0)
        turn = rotation(random.normal(size=3), float(random.uniform(0.0, 360.0)))
        place = translation(random.uniform(-0.7, 0.7, 3) * (1.0, 0.8, 0.5) + (0.0, -0.2, 0.3))
        shape = shapes[number % len(shapes)]
        solids.append(Instance(f"{shape.name} {number}", shape, place @ turn @ scaling(sizes)))
    return replace(b.scene("standing", camera()), meshes=tuple(solids))


SCENE = standing()


@pytest.fixture(scope="module")
def copied(small_pilot: None) -> dict[str, Image]:  # noqa: ARG001
    """What a scene of copies gives."""
    return {
        name: alone(SCENE, replace(settings, instances=Instancing.EXPAND))
        for name, settings in (("map", MAP), ("cache", CACHE), ("paths", PATHS))
    }


def test_the_copies_are_seen_and_have_their_own_triangles(copied: dict[str, Image]) -> None:
    report = copied["map"].metadata["report"]
    assert report["triangles"] > 16 * 12
    assert "instances" not in report["kernels"]["features"]
    assert np.isfinite(copied["map"].layers["beauty"]).all()


@pytest.mark.parametrize(
    ("name", "settings"),
    [pytest.param("map", MAP, marks=pytest.mark.own_kernels), ("cache", CACHE), ("paths", PATHS)],
    ids=["map", "cache", "paths"],
)
def test_held_once_they_give_the_same_bits(copied: dict[str, Image], name: str, settings: RenderSettings) -> None:
    image = alone(SCENE, settings)
    assert "instances" in image.metadata["report"]["kernels"]["features"]
    assert image.metadata["report"]["triangles"] == copied[name].metadata["report"]["triangles"]
    assert same_bits(image, copied[name])


@pytest.mark.parametrize(("workers", "cells"), [(2, 2), (3, 4), (4, 4)])
@pytest.mark.parametrize("routing", list(Routing))
def test_cut_among_workers_they_give_the_same_bits(
    copied: dict[str, Image], routing: Routing, workers: int, cells: int
) -> None:
    image = render_in_process(SCENE, replace(MAP, routing=routing), workers=workers, cells=cells, threads=1)
    assert len(np.unique(image.layers["cell"])) > 1
    assert same_bits(image, copied["map"])


def test_copies_with_kernels_for_instances_have_the_same_bits(copied: dict[str, Image]) -> None:
    settings = replace(MAP, instances=Instancing.EXPAND, all_effects=True)
    assert same_bits(alone(SCENE, settings), copied["map"])
