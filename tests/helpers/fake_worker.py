"""A worker without light: batches travel as in a render, and pixels are a function of their place.

It keeps books, so that tests notice a batch that came to the wrong slave, twice or out of phase.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import SCHEMAS, TO_HOME, Batch, Kind, by_home
from wdpm.cluster.layers import LAYERS
from wdpm.cluster.master.statistics import COUNTS, SECONDS, no_photons_counted
from wdpm.cluster.messages import protocol
from wdpm.cluster.outbox import Outbox
from wdpm.cluster.records import Records
from wdpm.cluster.render_settings import Routing
from wdpm.cluster.session import Session
from wdpm.cluster.task import BucketRendered, BucketTask, PhotonsTraced, PhotonTask, RecordTask, Task
from wdpm.cluster.world import Emission, MapPlan, PhotonPlan, TopTree, View, World
from wdpm.kernels.features import Features
from wdpm.scenes.flat.arrays import Media, Triangles
from wdpm.scenes.flat.grids import tabulate_grids
from wdpm.scenes.flat.light_table import LightTable
from wdpm.scenes.flat.material_table import tabulate
from wdpm.scenes.model.scene import Camera, diffuse
from wdpm.scenes.model.textures import Bitmap, Checkerboard

GHOSTS = 200
"""Photons of a batch that a fake worker sends for a band: enough that its columns travel in short forms."""


class FakeWorker:
    """Every task sends a batch to every cell; each answers home; the last answer ends the task."""

    def __init__(
        self,
        number: int,
        world: World,
        partition: Mapping[int, Triangles],
        holders: Sequence[int],
        delay: float = 0.0,
    ) -> None:
        assert set(partition) == {cell for cell, holder in enumerate(holders) if holder == number}
        self.number, self.world, self.holders, self.delay = number, world, holders, delay
        self.cells = sorted(partition)
        self.triangles = sum(len(triangles) for triangles in partition.values())
        self.view: View | None = None
        self.open: dict[int, tuple[Task, int]] = {}
        self.put_aside: list[Task] | None = None  # while records are awaited
        self.photons = self.ghosts = self.copied = 0
        self.maps_built = False

    def set_view(self, view: View) -> None:
        assert self.maps_built
        self.view, self.put_aside = view, None

    def start(self, task: Task) -> Outbox:
        time.sleep(self.delay)
        assert task.number not in self.open
        assert isinstance(task, PhotonTask) or self.view is not None
        outbox = Outbox()
        if self.put_aside is not None:
            self.put_aside.append(task)
            return outbox
        self.open[task.number] = (task, len(self.holders))
        kind = Kind.LANDED if isinstance(task, PhotonTask) else Kind.SHADE
        for cell in range(len(self.holders)):
            batch = Batch.of_task(kind, task.number, self.number, cell, 1, arrays(kind, 3))
            if self.holders[cell] == self.number:
                self._at_cell(batch, outbox)
            else:
                outbox.batches.append(batch)
        return outbox

    def handle(self, batches: Sequence[Batch]) -> Outbox:
        assert batches
        outbox = Outbox()
        for batch in batches:
            batch.check()
            if batch.kind in TO_HOME:
                assert batch.home == self.number
                self._at_home(batch, outbox)
            else:
                assert self.holders[batch.cell] == self.number
                self._at_cell(batch, outbox)
        return outbox

    def _at_cell(self, batch: Batch, outbox: Outbox) -> None:
        if batch.kind is Kind.GHOST_PHOTONS:
            self.ghosts += len(batch)
            return
        if batch.kind is Kind.COPIED_PHOTONS:
            assert not self.maps_built
            self.copied += len(batch)
            return
        if batch.kind in (Kind.COPIED_ORDER, Kind.COPIED_IRRADIANCE):
            assert not self.maps_built
            return
        if batch.kind is Kind.LANDED:
            assert not self.maps_built
            self.photons += len(batch)
        else:
            assert self.view is not None
        for ended in by_home([Batch(Kind.ENDED, batch.cell, batch.runs.without_rows(batch.runs.credit), {})]):
            if ended.home == self.number:
                self._at_home(ended, outbox)
            else:
                outbox.batches.append(ended)

    def _at_home(self, batch: Batch, outbox: Outbox) -> None:
        for _, number, _, credit in batch.runs.table.tolist():
            self._take_credit(number, credit, outbox)

    def _take_credit(self, number: int, credit: int, outbox: Outbox) -> None:
        task, missing = self.open[number]
        self.open[number] = (task, missing - credit)
        if missing > credit:
            return
        del self.open[number]
        if isinstance(task, PhotonTask):
            outbox.results.append(PhotonsTraced(number, task.stop - task.start, 0.5))
        else:
            assert self.view is not None
            outbox.results.append(pixels_of(task, self.view))

    def regroup(self, world: World, partition: Mapping[int, Triangles], holders: Sequence[int]) -> None:
        kept = {cell for cell in self.cells if holders[cell] == self.number}
        assert kept | set(partition) == {cell for cell, holder in enumerate(holders) if holder == self.number}
        self.triangles = sum(5 + cell for cell in kept) + sum(len(triangles) for triangles in partition.values())
        self.put_aside = None
        self.cells, self.holders = sorted(kept | set(partition)), holders
        self.open.clear()
        self.forget_photons(world.photon_plan)

    def copies(self, cells: Sequence[int], part: int, regions: NDArray[np.float32]) -> list[Batch]:
        assert part == 0 or len(cells)
        assert len(regions) in (0, len(cells) + 1)
        assert not self.open
        assert not self.maps_built
        return [
            Batch.of_task(Kind.COPIED_PHOTONS, -1, self.number, cell, 0, arrays(Kind.COPIED_PHOTONS, 1))
            for cell in cells
        ]

    def exchange_ghosts(self) -> list[Batch]:
        assert not self.open
        foreign = [cell for cell, holder in enumerate(self.holders) if holder != self.number]
        ghosts = arrays(Kind.GHOST_PHOTONS, GHOSTS)
        return [Batch.of_task(Kind.GHOST_PHOTONS, -1, -1, cell, 0, ghosts) for _ in self.cells for cell in foreign]

    def ghosts_expected(self) -> int:
        return len(self.cells) * (len(self.holders) - len(self.cells))

    def sort_trees(self, part: int, parts: int, cells: Sequence[int]) -> list[Batch]:
        assert 0 <= part < parts
        kind = Kind.COPIED_ORDER
        return [Batch.of_task(kind, -1, self.number, cell, 0, arrays(kind, 1)) for cell in cells]

    def build_maps(self, part: int, parts: int, cells: Sequence[int]) -> list[Batch]:
        assert self.ghosts == GHOSTS * self.ghosts_expected()
        assert 0 <= part < parts
        kind = Kind.COPIED_IRRADIANCE
        return [Batch.of_task(kind, -1, self.number, cell, 0, arrays(kind, 1)) for cell in cells]

    def finish_maps(self) -> None:
        self.maps_built = True

    def await_records(self) -> None:
        self.put_aside = []

    def set_records(self, records: Records) -> None:
        self.records = records

    def go_on(self) -> Outbox:
        """Tasks of which nothing is done before the records are there."""
        put_aside, self.put_aside = self.put_aside or [], None
        outboxes = [self.start(task) for task in put_aside]
        return Outbox(
            [batch for outbox in outboxes for batch in outbox.batches],
            [result for outbox in outboxes for result in outbox.results],
        )

    def begin_points(self) -> None:
        pass  # it has none

    def forget_photons(self, plan: PhotonPlan) -> None:
        self.world = self.world.with_photons(plan)
        self.photons = self.ghosts = self.copied = 0
        self.maps_built = False

    def photon_counts(self) -> dict[str, Any]:
        return maps_built(0, self.photons).counted

    def statistics(self) -> dict[str, Any]:
        assert not self.open
        return statistics_of(
            triangles=self.triangles,
            photons=[self.photons, 0, 0],
            copies=[self.copied, 0, 0],
            ghosts=[self.ghosts, 0, 0],
            cells=self.cells,
        )


def statistics_of(**known: Any) -> dict[str, Any]:
    """Statistics of a slave that did nothing but what is known."""
    return {
        **dict.fromkeys(COUNTS, 0),
        **dict.fromkeys(SECONDS, 0.0),
        "cells": [],
        "photons": [0, 0, 0],
        "copies": [0, 0, 0],
        "ghosts": [0, 0, 0],
        "guards": {},
        **known,
    }


def maps_built(epoch: int, stored: int = 0) -> protocol.MapsBuilt:
    """What a slave of such a world says when its maps are built: the first has so many photons of the first light."""
    lights = len(make_lights().names)
    by_light = [[stored] + [0] * (lights - 1), [0] * lights, [0] * lights]
    return protocol.MapsBuilt(epoch, no_photons_counted(lights) | {"stored_by_light": by_light})


def arrays(kind: Kind, count: int) -> dict[str, Any]:
    """Arrays of a kind, counting up; those that point at cells, lights, media, maps and corners point at the first."""
    counting = {
        name: np.arange(count * int(np.prod(field.shape, dtype=int))).reshape(count, *field.shape).astype(field.dtype)
        for name, field in SCHEMAS[kind].items()
    }
    return {
        name: np.zeros_like(array) if name in ("owner", "cell", "light", "medium", "map", "front", "u", "v") else array
        for name, array in counting.items()
    }


def pixels_of(task: BucketTask, view: View) -> BucketRendered:
    """What a bucket must look like, wherever it is rendered."""
    y, x = np.mgrid[task.y0 : task.y1, task.x0 : task.x1]
    value = (x + 1000 * y + view.seed).astype(np.float32)
    layers = {
        name: value if channels == 1 else np.repeat(value[..., None], channels, axis=2)
        for name, channels in LAYERS.items()
    }
    return BucketRendered(task.number, task.x0, task.y0, layers)


def picture(view: View) -> BucketRendered:
    """What the whole image must look like."""
    return pixels_of(BucketTask(0, 0, 0, view.camera.width, view.camera.height), view)


def irradiance_records(count: int, first: int = 0) -> Records:
    """Records whose numbers count from `first`."""
    whole = np.arange(count)
    flat = np.tile(np.array([0.0, 0.0, 1.0], np.float32), (count, 1))
    gradient = np.zeros((count, 3, 3), np.float32)
    place = whole[:, None].astype(np.float32) * np.ones(3, np.float32)
    ones = np.ones(count, np.float32)
    told = np.abs(place), gradient, gradient, 0.2 * ones, ones, 0.1 * ones
    return Records(first + whole.astype(np.int64), place, flat, *told)


def record_task(number: int, round_number: int, some: set[int], every: bool) -> RecordTask:
    """Of some candidates, or of every one from the first to the last of them."""
    listed = np.array([] if every else sorted(some), np.int32)
    return RecordTask(number, round_number, min(some), max(some) + 1, listed)


def triangles(count: int, first: int = 0) -> Triangles:
    """Some triangles, numbered from `first`."""
    return Triangles(
        np.arange(first, first + count, dtype=np.int32),
        np.ones((count, 3, 3), np.float32),
        np.zeros((count, 3, 3), np.float32),
        np.zeros((count, 3, 2), np.float32),
        np.zeros(count, np.int32),
        np.full(count, -1, np.int32),
        np.zeros((0, 3, 3), np.float32),
        np.zeros(count),
    )


def make_world(cells: int, paths: int = 1000) -> World:
    """A world of a power of two of cells."""
    grey = Bitmap("grey", np.full((2, 2, 3), 0.5, np.float32))
    table, textures = tabulate([(diffuse("grey", grey).bsdf, -2, -2)])
    return World(
        features=Features(bitmaps=True),
        materials=table,
        textures=(*textures, replace(grey, tinted=True), Checkerboard("squares")),
        lights=make_lights(),
        media=Media(
            np.ones((1, 3), np.float32),
            np.ones((1, 3), np.float32),
            np.zeros(1, np.float32),
            np.full(1, -1, np.int32),
            np.full(1, -1, np.int32),
            tabulate_grids([]),
        ),
        top_tree=TopTree(np.zeros(cells - 1, np.int32), np.zeros(cells - 1, np.float32)),
        extent=1.0,
        seed=0,
        max_depth=None,
        emission=Emission(np.ones(1), np.ones(1), np.zeros((0, 3), np.float32), np.zeros(0, np.float32)),
        global_map=MapPlan(paths, 0.1, 0.1),
        caustic_map=MapPlan(),
        volume_map=MapPlan(),
        volume_unit=1.0,
    )


def make_lights() -> LightTable:
    """One glowing triangle."""
    return LightTable(
        emitter_radiance=np.ones((1, 3), np.float32),
        emitter_texture=np.full(1, -1, np.int32),
        prim=np.zeros(1, np.int32),
        corners=np.zeros((1, 3, 3), np.float32),
        uvs=np.zeros((1, 3, 2), np.float32),
        colors=np.zeros((0, 3, 3), np.float32),
        emitter=np.zeros(1, np.int32),
        delta_kind=np.zeros(0, np.int32),
        delta_position=np.zeros((0, 3), np.float32),
        delta_axes=np.zeros((0, 3, 3), np.float32),
        delta_color=np.zeros((0, 3), np.float32),
        delta_cutoff=np.zeros(0, np.float32),
        delta_number=np.zeros((0, 4), np.float32),
        delta_texture=np.zeros(0, np.int32),
        environment_pixels=np.zeros((0, 0, 3), np.float32),
        environment_axes=np.eye(3, dtype=np.float32),
        scene_radius=1.0,
        medium=np.full(1, -1, np.int32),
        power=np.ones(1),
        light=np.zeros(1, np.int32),
        names=("lamp",),
    )


def make_view(width: int = 50, height: int = 34, bucket: int = 16, seed: int = 0) -> View:
    """A view whose buckets do not come out even."""
    camera = Camera(np.eye(4), 40.0, width, height)
    return View(camera, seed, 1, 1, None, 8, 8, 4, bucket, Routing.FORWARD)


def make_session(slaves: int, cells: int, digest: str = "a", paths: int = 1000, **others: Any) -> Session:
    """A session whose cell c has 5 + c triangles, for one team of all slaves."""
    return Session(
        world=make_world(cells, paths),
        view=others.pop("view", make_view()),
        partition=lambda cell: triangles(5 + cell, 10 * cell),
        burdens=(1.0,) * cells,
        digest=digest,
        team_size=others.pop("team_size", slaves),
        **others,
    )
