"""Where lights shine first: all their light, and the same places on any number of threads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnaces import quad, scene, view
from window_room import ALBEDO, shell

from wdpm.cluster.lit_places import LitPlaces
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.lit_places import LEAST_PLACES, PLACES, lit_places
from wdpm.cluster.plan.photon_pilot import fly_pilot
from wdpm.cluster.plan.view import CACHE_PLAN
from wdpm.cluster.records import NO_CACHE
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.kernels.launch import Launcher
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.model.scene import Scene, diffuse

CACHED = RenderSettings(indirect=Indirect.CACHE, integrator=Integrator.PHOTONS, spp=8, photons=60_000)


def found_in(flat: FlatScene, threads: int = 1, samples: int = 16) -> LitPlaces:
    pilot = fly_pilot(flat, features_of(flat, CACHED), CACHED, Launcher("cpu", threads))
    return lit_places(pilot, CACHE_PLAN, samples)


def lamp_in_a_cup(size: tuple[int, int]) -> Scene:
    """A room that a small lamp lights by way of its ceiling, out of a cup. From afar its bright inside is tiny."""
    camera = replace(view((0.0, -0.1, 1.9), (0.0, 0.1, -0.5), 80, up=(0, 1, 0)), width=size[0], height=size[1])
    x, y, z, half, high = -0.6, 0.64, -1.2, 0.08, 0.1
    low = y - 0.02
    left = quad((-1, -1, -2), (0, 2, 0), (0, 0, 4))
    lamp = quad((x - 0.025, y, z - 0.025), (0, 0, 0.05), (0.05, 0, 0), emission=(900.0, 800.0, 600.0))
    cup = [
        quad((x - half, low, z - half), (0, 0, 2 * half), (2 * half, 0, 0)),
        quad((x - half, low, z - half), (0, high, 0), (0, 0, 2 * half)),
        quad((x + half, low, z - half), (0, 0, 2 * half), (0, high, 0)),
        quad((x - half, low, z - half), (2 * half, 0, 0), (0, high, 0)),
        quad((x - half, low, z + half), (0, high, 0), (2 * half, 0, 0)),
    ]
    return scene([*shell(), left, lamp, *cup], camera, ALBEDO)


def test_places_stand_for_all_light_that_comes_to_surfaces() -> None:
    flat = flatten(lamp_in_a_cup((16, 16)))
    found = found_in(flat)
    assert len(found) == PLACES
    assert found.power.sum() == pytest.approx(flat.lights.power.sum(), rel=0.02)
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1.0, atol=1e-6)
    assert (found.radius > 0).all()


@pytest.mark.parametrize("edges", [((4, 0, 0), (0, 4, 0)), ((0, 4, 0), (4, 0, 0))], ids=["front", "back"])
def test_places_face_the_light_that_comes_to_them(edges: tuple[tuple[float, ...], ...]) -> None:
    """A wall that the sun lights from outside has no light to send into the room, whichever side is its front."""
    lamp = quad((-1, -1, 1), (0, 2, 0), (2, 0, 0), emission=(5.0, 5.0, 5.0))
    room = scene([lamp, quad((-2, -2, 0), *edges)], view((0, -3, 2), (0, 0, 0), 60), ALBEDO)
    found = found_in(flatten(replace(room, materials=(diffuse("grey", ALBEDO, twosided=True),))))
    assert len(found) == PLACES
    assert (found.normal[:, 2] > 0.99).all()


def test_passes_of_few_samples_have_fewer_places_of_as_much_light() -> None:
    flat = flatten(cornell_box((16, 16)))
    counts = [len(found_in(flat, samples=samples)) for samples in (1, 4, 8, 16, 64)]
    assert counts == [LEAST_PLACES, LEAST_PLACES, PLACES // 2, PLACES, PLACES]
    assert found_in(flat, samples=1).power.sum() == pytest.approx(found_in(flat).power.sum(), rel=0.02)


def test_places_are_the_same_on_any_number_of_threads() -> None:
    flat = flatten(lamp_in_a_cup((16, 16)))
    one, two = found_in(flat, 1), found_in(flat, 2)
    for name, column in vars(one).items():
        np.testing.assert_array_equal(column, getattr(two, name))


def test_records_that_share_out_no_rays_and_scenes_without_light_have_no_places() -> None:
    flat = flatten(cornell_box((16, 16)))
    pilot = fly_pilot(flat, features_of(flat, CACHED), CACHED, Launcher("cpu", 1))
    assert not len(lit_places(pilot, NO_CACHE, 16))
    assert not len(lit_places(pilot, replace(CACHE_PLAN, extra=0.0), 16))
    box = cornell_box((16, 16))
    dark = flatten(replace(box, meshes=tuple(replace(mesh, emission=None) for mesh in box.meshes)))
    assert not len(found_in(dark))
