"""Learning which part of the sky lights which part of a scene: on where it pays, off where it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import two_rooms
import window_room
from one_cell import ready

from wdpm.cluster.guide import LightGuide
from wdpm.cluster.plan import guide_tiles
from wdpm.cluster.plan.regions import divide
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.kernels.launch import Launcher
from wdpm.kernels.lights import guide
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.scene import Scene
from wdpm.scenes.model.transforms import look_at

PATH = RenderSettings(integrator=Integrator.PATH, all_effects=True)


def guide_of(scene: Scene, chosen: RenderSettings = PATH, threads: int = 1, cells: int = 1) -> LightGuide:
    """What a render of a scene learns."""
    return prepare(scene, chosen, 1, Launcher("cpu", threads), SilentProgress(), cells).session.view.guide


def test_a_room_with_a_window_is_guided() -> None:
    found = guide_of(window_room.room())
    assert len(found) >= 2
    np.testing.assert_allclose(found.chance.sum(axis=(1, 2)), 1.0, rtol=1e-5)


def test_what_the_window_shows_is_looked_for_more_often_and_all_else_still() -> None:
    """The window is to the left, at x = -1: nothing arrives from the right."""
    around = window_room.sky()
    found = guide_of(window_room.room(around))
    mass = guide.TiledSky(around.pixels).mass
    factor = found.chance / mass
    assert factor.min() >= guide_tiles.UNGUIDED * (1 - 1e-5)
    left = np.arange(mass.shape[1]) >= mass.shape[1] / 2  # u = atan2(x, -z) / 2 pi: x < 0 in the second half
    assert found.chance[:, :, left].sum(axis=(1, 2)).min() > 0.75 > mass[:, left].sum() + 0.2


@pytest.mark.parametrize(
    "scene",
    [window_room.open_ground(), cornell_box((48, 32)), replace(window_room.room(), lights=())],
    ids=["open ground", "one lamp", "dark"],
)
def test_where_there_is_nothing_to_learn_there_is_no_guide(scene: Scene) -> None:
    assert len(guide_of(scene)) == 0


def test_emission_alone_needs_no_guide() -> None:
    assert len(guide_of(window_room.room(), replace(PATH, max_depth=1))) == 0


def test_it_is_tried_on_places_that_did_not_teach_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Above the limit nothing is guided: neither by what a few rays promise, nor by what all of them do."""
    moments = []
    moment = guide_tiles._moment

    def told(*arguments: object) -> float:
        moments.append(moment(*arguments))  # type: ignore[arg-type]
        return moments[-1]

    monkeypatch.setattr(guide_tiles, "_moment", told)
    assert len(guide_of(window_room.room()))
    assert not len(guide_of(window_room.open_ground()))
    (promised, kept, ground) = moments
    assert promised < kept < guide_tiles.WORTH < ground < 1.1
    monkeypatch.setattr(guide_tiles, "WORTH", kept * 0.99)
    assert not len(guide_of(window_room.room()))


@pytest.mark.parametrize(("threads", "cells"), [(3, 1), (1, 2), (2, 8)])
def test_no_bit_depends_on_who_learns(threads: int, cells: int) -> None:
    one, other = guide_of(window_room.room()), guide_of(window_room.room(), threads=threads, cells=cells)
    for name in vars(one):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


def test_samples_change_nothing_so_more_can_be_added() -> None:
    one, other = guide_of(window_room.room()), guide_of(window_room.room(), replace(PATH, spp=64, passes=2))
    assert one.chance.tobytes() == other.chance.tobytes()


def test_a_constant_sky_is_divided_too() -> None:
    found = guide_of(window_room.room(window_room.constant_sky()))
    assert found.chance.shape[1:] == (guide.TILE_ROWS, guide.TILE_COLUMNS)


def test_a_guide_for_another_sky_is_refused() -> None:
    worker = ready(window_room.room(), PATH)
    view = worker.replica.view
    assert view is not None
    wrong = replace(view.guide, chance=np.ones((len(view.guide), 3, 5), np.float32))
    with pytest.raises(ProtocolError, match="for another environment"):
        worker.set_view(replace(view, guide=wrong))


def test_lamps_behind_a_wall_are_asked_less() -> None:
    found = guide_of(two_rooms.rooms())
    assert len(found) >= 2
    assert found.chance.size == 0
    assert found.starts.shape[1] == 1 + two_rooms.OTHERS
    # The light tree's order is its own: in each region one lamp counts in full, and most others for the least there is.
    np.testing.assert_allclose(found.starts.max(axis=1), 1.0, rtol=1e-5)
    assert np.median(found.starts) < 2 * guide_tiles.UNGUIDED


def test_a_sun_above_the_roof_is_asked_less_than_the_sky_in_the_window() -> None:
    room = window_room.room()
    found = guide_of(replace(room, lights=(two_rooms.SUN, *room.lights)))
    assert found.starts.shape[1] == 1
    sun, around = found.distant.mean(axis=0)
    power = flatten(replace(room, lights=(two_rooms.SUN, *room.lights))).lights.power
    assert sun / around < 0.6 * power[-2] / power[-1]
    np.testing.assert_allclose(found.distant.sum(axis=1), 1.0, rtol=1e-5)


def test_a_patch_of_sun_does_not_hide_that_the_rest_of_a_room_has_the_sky_alone() -> None:
    """The sun sends nearly all light there is, but through the window to a twentieth of the places only."""
    room = window_room.room(window_room.constant_sky())
    power = flatten(replace(room, lights=(two_rooms.SUN_IN_THE_WINDOW, *room.lights))).lights.power
    assert power[-2] > 4 * power[-1]
    found = guide_of(replace(room, lights=(two_rooms.SUN_IN_THE_WINDOW, *room.lights)))
    assert found.chance.shape[1:] == (guide.TILE_ROWS, guide.TILE_COLUMNS)


def test_lamps_that_reach_everywhere_are_chosen_as_ever() -> None:
    lamps = [replace(two_rooms.POINT, name=f"point {x}", position=(x, 0.5, 1.0)) for x in (-0.5, 0.5)]
    assert len(guide_of(replace(window_room.room(), lights=tuple(lamps)))) == 0


def test_where_lamps_send_nearly_all_light_the_sky_is_not_worth_learning() -> None:
    room = window_room.room()
    found = guide_of(replace(room, lights=(replace(two_rooms.POINT, intensity=(90.0, 90.0, 90.0)), *room.lights)))
    assert found.chance.size == 0


def test_a_guide_for_other_lamps_is_refused() -> None:
    worker = ready(two_rooms.rooms(), PATH)
    view = worker.replica.view
    assert view is not None
    wrong = replace(view.guide, starts=np.ones((len(view.guide), 3), np.float32))
    with pytest.raises(ProtocolError, match="a guide of 3 lights"):
        worker.set_view(replace(view, guide=wrong))


def test_regions_halve_places() -> None:
    places = np.random.default_rng(0).uniform(-1, 1, (1000, 3)).astype(np.float32)
    regions = divide(places, 100)
    inside = np.bincount(regions.of(places))
    assert len(inside) == 8
    assert inside.min() >= 124
    assert inside.max() <= 126


@pytest.mark.parametrize("places", [np.zeros((0, 3), np.float32), np.ones((300, 3), np.float32)], ids=["none", "one"])
def test_regions_of_places_that_cannot_be_divided(places: np.ndarray) -> None:
    regions = divide(places, 100)
    assert len(regions.of(np.float32([[0, 0, 0], [1, 1, 1]]))) == 2


def test_a_camera_in_the_dark_learns_nothing() -> None:
    """All that it sees is outside, and meets nothing."""
    outside = window_room.room()
    away = replace(outside.camera, to_world=look_at((0, 0, 50), (0, 0, 100), (0, 1, 0)))
    assert len(guide_of(replace(outside, camera=away))) == 0
