"""Paths that one launch follows as far as their cell reaches have the bits of those that go vertex by vertex."""

from __future__ import annotations

import gc
import random
import weakref
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from digests import alone, same_bits
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from random_scenes import scenes_with_effects
from test_exactness_random import give_planes_through_places
from test_exactness_whole_samples import (
    CACHE,
    GATHER,
    MAP,
    PATH,
    choose_kernels_that_follow_samples,
    settings_of_all_ways,
    without_media,
)
from test_exactness_whole_samples import SCENES as WITH_KERNELS

from wdpm.cluster.batch import Batch
from wdpm.cluster.render_settings import Indirect, RenderSettings, Routing
from wdpm.cluster.work import bucket_home, camera_paths
from wdpm.cluster.work.camera_paths import CameraPaths
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.work.whole import within_cell
from wdpm.cluster.work.whole.within_cell import FollowedPaths, WithinCell
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import PhotonPlan
from wdpm.images.image import Image
from wdpm.kernels.whole_samples.indirect_light import PATHS_LEFT
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Camera, Mesh, Scene, diffuse

pytestmark = pytest.mark.own_kernels

# Few, as each has kernels of its own compiled.
SCENES = {name: WITH_KERNELS[name] for name in ("diffuse", "metals", "coats", "panes")}


def divided(scene: Scene, chosen: RenderSettings, cells: int = 4, workers: int = 2, threads: int = 1) -> Image:
    return render_in_process(scene, chosen, workers=workers, cells=cells, threads=threads)


def vertex_by_vertex(monkeypatch: pytest.MonkeyPatch, scene: Scene, chosen: RenderSettings) -> Image:
    """The image of cells that follow no path."""
    with monkeypatch.context() as patch:
        patch.setattr(WithinCell, "can_be", False)
        return divided(scene, chosen)


def counted_of(image: Image) -> dict[str, object]:
    """What a report says of camera samples, times left out."""
    report = image.metadata["report"]
    names = ("vertices", "gathers", "gathers_truncated", "gathers_left_band", "nonfinite", "guards")
    gathers = {name: number for name, number in (report["final_gather"] or {}).items() if not name.endswith("_s")}
    return {name: report[name] for name in names} | gathers


def remembered(monkeypatch: pytest.MonkeyPatch) -> list[FollowedPaths | None]:
    """What came of all launches from here on."""
    every: list[FollowedPaths | None] = []
    follow = WithinCell.follow

    def remember(self: WithinCell, *args: object, **how: object) -> FollowedPaths | None:
        every.append(follow(self, *args, **how))
        return every[-1]

    monkeypatch.setattr(WithinCell, "follow", remember)
    return every


def rows_of(launched: list[FollowedPaths | None], items: str, name: str) -> NDArray[np.int32]:
    """A column of what all launches told in one of their lists."""
    told = [getattr(one, items) for one in launched if one is not None]
    return np.concatenate([some[name] for some in told if some])


@pytest.mark.parametrize(
    ("name", "chosen"),
    [
        *((name, replace(PATH, max_depth=4 if name == "panes" else None)) for name in SCENES),
        *((name, CACHE) for name in SCENES),
        *((name, GATHER) for name in ("diffuse", "coats")),
        ("coats", replace(CACHE, max_depth=5)),
        ("coats", MAP),
    ],
)
def test_the_same_bits_and_counts(name: str, chosen: RenderSettings, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = vertex_by_vertex(monkeypatch, SCENES[name], chosen)
    launched = remembered(monkeypatch)
    image = divided(SCENES[name], chosen)
    assert any(one is not None and len(one.paths["slot"]) for one in launched)
    if name != "panes":  # whose shadow rays are walked elsewhere
        assert len(rows_of(launched, "pixels", "slot"))
        assert bool(len(rows_of(launched, "gathered", "slot"))) == (chosen.indirect is Indirect.CACHE)
    assert same_bits(image, expected)
    assert counted_of(image) == counted_of(expected)
    assert all(expected.layers[layer].any() for layer in ("direct", "indirect"))


@pytest.mark.parametrize("way", [PATH, CACHE], ids=["path", "photons"])
@pytest.mark.parametrize("name", ["diffuse", "coats"])
def test_threads_cells_and_room_change_no_bit(name: str, way: RenderSettings, monkeypatch: pytest.MonkeyPatch) -> None:
    """With room for the first vertex of each path alone, most end there and go on in another launch."""
    expected = alone(SCENES[name], way)
    monkeypatch.setattr(within_cell, "GRAIN", 8)
    assert same_bits(divided(SCENES[name], way, cells=2, workers=2, threads=3), expected)
    monkeypatch.setattr(within_cell, "ROOM_VERTICES", 1)
    launched = remembered(monkeypatch)
    assert same_bits(divided(SCENES[name], way, cells=8, workers=3), expected)
    assert sum(int(one.counts[PATHS_LEFT]) for one in launched if one is not None) > 0


@pytest.mark.parametrize("way", [PATH, CACHE], ids=["path", "photons"])
def test_few_rays_that_come_by_have_the_bits_of_many(way: RenderSettings, monkeypatch: pytest.MonkeyPatch) -> None:
    """Many are sorted by what they meet before they are followed."""
    visits: list[bool] = []
    follow = WithinCell.follow

    def remember(self: WithinCell, *args: Any, first: bool, **how: Any) -> FollowedPaths | None:
        if not first:
            visits.append(how.get("visits", False))
        return follow(self, *args, first=first, **how)

    monkeypatch.setattr(WithinCell, "follow", remember)
    few = divided(SCENES["coats"], way)
    assert any(visits)
    visits.clear()
    monkeypatch.setattr(camera_paths, "FEW_TO_FOLLOW", 0)
    many = divided(SCENES["coats"], way)
    assert visits
    assert not any(visits)
    assert same_bits(few, many)
    assert counted_of(few) == counted_of(many)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    scene=scenes_with_effects(),
    chosen=settings_of_all_ways(
        bucket=st.sampled_from([5, 32]),  # several have rows in one batch
        routing=st.sampled_from(list(Routing)),
    ),
    cells=st.sampled_from([2, 4, 8]),
    team=st.sampled_from([1, None]),
    room=st.sampled_from([1, 2]),
    data=st.data(),
)
def test_random_scenes_of_all_effects_but_media(
    scene: Scene, chosen: RenderSettings, cells: int, team: int | None, room: int, data: st.DataObject
) -> None:
    """By kernels for all effects, but for the one that follows paths, which is for all of those that it knows."""
    scene = without_media(scene)
    expected = alone(scene, chosen)  # sample by sample in no launch: with media there is no kernel for it
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Replica, "_choose_kernels", choose_kernels_that_follow_samples)
        patch.setattr(within_cell, "GRAIN", 8)
        patch.setattr(within_cell, "ROOM_VERTICES", room)
        if data.draw(st.booleans(), label="planes through what is there"):
            give_planes_through_places(patch, scene, cells, data)
        shuffle = random.Random(chosen.seed)
        image = render_in_process(scene, chosen, workers=2, cells=cells, team=team, threads=2, shuffle=shuffle)
    assert same_bits(image, expected)


@pytest.mark.parametrize("follows", [True, False])
def test_rays_that_set_out_in_another_cell_than_their_first(follows: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where cells meet within a pixel: the cell that they set out in sends them where they belong."""
    expected = alone(SCENES["coats"], CACHE)
    sent: list[int] = []

    def the_last(_replica: Replica, _rays: object, count: int) -> NDArray[np.int32]:
        sent.append(count)
        return np.full(count, 7, np.int32)

    monkeypatch.setattr(bucket_home, "first_cells", the_last)
    if not follows:
        monkeypatch.setattr(WithinCell, "can_be", False)
    assert same_bits(divided(SCENES["coats"], CACHE, cells=8, workers=3), expected)
    assert sum(sent) == np.prod(expected.pixels.shape[:2])  # one ray a pixel was asked about


def test_camera_rays_go_on_from_cell_to_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some hit what another cell may have something before, some what is another cell's, and some nothing."""
    expected = alone(SCENES["metals"], PATH)
    launched = remembered(monkeypatch)
    assert same_bits(divided(SCENES["metals"], PATH, cells=8, workers=3), expected)
    followed = [one for one in launched if one is not None]
    onward, bounce = (np.concatenate([one.paths[name] for one in followed]) for name in ("onward", "bounce"))
    assert (onward[bounce == 0] >= 0).any()
    assert (onward[bounce == 0] < 0).any()
    launched.clear()
    set_out: list[int] = []
    start = CameraPaths.start_camera

    def count(self: CameraPaths, batch: Batch) -> Iterator[Batch]:
        set_out.append(len(batch))
        return start(self, batch)

    monkeypatch.setattr(CameraPaths, "start_camera", count)
    assert same_bits(divided(SCENES["diffuse"], PATH, cells=8, workers=3), alone(SCENES["diffuse"], PATH))
    hits = rows_of(launched, "pixels", "hits").sum() + len(rows_of(launched, "first", "slot"))
    assert 0 < hits < sum(set_out)


def test_lists_are_kept_from_launch_to_launch_and_what_was_written_is_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[object] = []
    lists = WithinCell._lists_for

    def remember(*args: Any) -> Any:
        made.append(lists(*args))
        return made[-1]

    monkeypatch.setattr(WithinCell, "_lists_for", remember)
    launched = remembered(monkeypatch)
    assert same_bits(divided(SCENES["diffuse"], PATH), alone(SCENES["diffuse"], PATH))
    assert len({id(one) for one in made}) < len(made) / 2
    paths = [one.paths["origin"] for one in launched if one is not None and len(one.paths["origin"])]
    assert not any(np.may_share_memory(one, other) for number, one in enumerate(paths) for other in paths[:number])


def test_what_guards_count_is_found_vertex_by_vertex(monkeypatch: pytest.MonkeyPatch) -> None:
    corners = np.array([[-0.5, 0.0, -0.5], [-0.5, 0.0, 0.5], [0.5, 0.0, 0.5], [0.5, 0.0, -0.5]])
    floor = Mesh("floor", corners, np.array([[0, 1, 2], [0, 2, 3]]), None, None, 0)
    to_world = np.diag([-1.0, 1.0, -1.0, 1.0])  # looks along -z
    to_world[:3, 3] = (0.0, 0.05, 1.0)
    star = PointLight("star", (0.0, 0.3, 0.0), (5e37, 5e37, 5e37))  # right above it light overflows
    white = diffuse("white", (0.9, 0.9, 0.9), twosided=True)
    scene = Scene("too bright", (floor,), (white,), (star,), Camera(to_world, fov_x=40.0, width=12, height=8))
    expected = vertex_by_vertex(monkeypatch, scene, PATH)
    launched = remembered(monkeypatch)
    image = divided(scene, PATH)
    assert None in launched
    assert image.metadata["report"]["nonfinite"] == expected.metadata["report"]["nonfinite"] != {}
    assert same_bits(image, expected)


def test_maps_of_a_pass_are_let_go_before_those_of_the_next_are_built(monkeypatch: pytest.MonkeyPatch) -> None:
    gone: list[weakref.ref[object]] = []
    forget = CellWorker.forget_photons

    def forget_and_look(self: CellWorker, plan: PhotonPlan | None = None) -> None:
        gone.extend(weakref.ref(built) for cell in self.cells.values() for built in cell.store.maps if built)
        forget(self, plan)

    def build_and_look(self: CellWorker, *parts: int) -> object:
        gc.collect()
        assert all(built() is None for built in gone)
        return build(self, *parts)

    build = CellWorker.build_maps
    monkeypatch.setattr(CellWorker, "forget_photons", forget_and_look)
    monkeypatch.setattr(CellWorker, "build_maps", build_and_look)
    launched = remembered(monkeypatch)
    divided(SCENES["coats"], replace(MAP, passes=2))
    assert gone
    assert launched
