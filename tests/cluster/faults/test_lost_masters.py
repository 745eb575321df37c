"""A master that ends at any moment, while slaves come and go, and another that goes on with what it had finished."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from digests import without_cells
from fake_worker import FakeWorker, make_session, make_view, picture
from faulty_cluster import FaultyCluster
from hypothesis import given, settings
from hypothesis import strategies as st

import wdpm
from wdpm.cluster.kept import BucketKept, Kept, RecordsKept, TaskKept
from wdpm.cluster.plan.copies import Sharing
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.slave.jobs import WorkerFactory
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import World
from wdpm.images.image import Image
from wdpm.kernels.launch import Launcher
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes.flat.arrays import Triangles


class MasterEnded(Exception):
    """The master is no more."""


@dataclass
class Notebook:
    """Keeps what is finished, and ends the master after so many tasks."""

    left: int
    buckets: list[BucketKept] = field(default_factory=list)
    records: list[RecordsKept] = field(default_factory=list)

    def keep(self, done: TaskKept) -> None:
        if isinstance(done, BucketKept):
            self.buckets.append(done)
        else:
            self.records.append(done)
        self.left -= 1
        if self.left < 0:
            raise MasterEnded

    @property
    def kept(self) -> Kept:
        return Kept(tuple(self.buckets), tuple(self.records))


def render_with_lost_masters(
    make_worker: WorkerFactory, session: Session, seed: int, lives: Sequence[int], faults: int
) -> tuple[SessionResult, Notebook]:
    """Masters that end after so many tasks each, and at last one that does not."""
    chance = random.Random(seed)
    notebook = Notebook(0)
    for life in [*lives, 10**9]:
        slaves = chance.randint(1, 4)
        cluster = FaultyCluster(make_worker, slaves, chance.randrange(2**32), every=80, faults=faults, most=9)
        cluster._keeper = notebook
        notebook.left = life
        try:
            return cluster.render(replace(session, kept=notebook.kept)), notebook
        except MasterEnded:
            continue
    raise AssertionError("the last master ended, too")


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    lives=st.lists(st.integers(0, 6), max_size=4),
    team=st.integers(1, 3),
    cells=st.sampled_from([1, 4]),
    faults=st.integers(0, 3),
)
def test_a_picture_survives_its_masters(seed: int, lives: list[int], team: int, cells: int, faults: int) -> None:
    view = make_view()
    session = make_session(4, cells, team_size=team, view=view)
    result, notebook = render_with_lost_masters(FakeWorker, session, seed, lives, faults)
    for name, layer in picture(view).layers.items():
        np.testing.assert_array_equal(result.layers[name], layer)
    places = [(each.task.x0, each.task.y0) for each in notebook.buckets]
    assert len(places) == len(set(places)), "a finished bucket was rendered again"


def make_worker(number: int, world: World, partition: Mapping[int, Triangles], holders: Sequence[int]) -> CellWorker:
    return CellWorker(number, world, partition, holders, Launcher("cpu", 1))


def test_an_image_keeps_its_bits() -> None:
    """With kernels and an irradiance cache; masters end in the middle of rounds and of the image."""
    scene = wdpm.load("cornell-box", size=(24, 16))
    chosen = RenderSettings(photons=1000, spp=1, k=20, indirect=Indirect.CACHE, bucket=8)
    prepared = prepare(scene, chosen, 2, Launcher("cpu", 1), SilentProgress(), 2, team=lambda _: Sharing(2, 2))
    undisturbed = FaultyCluster(make_worker, 1, 0, every=1, faults=0).render(prepared.session)
    result, notebook = render_with_lost_masters(make_worker, prepared.session, 3, (2, 4, 3, 3), 1)
    assert without_cells(Image(result.layers)).digest() == without_cells(Image(undisturbed.layers)).digest()
    assert len(result.records) == len(undisturbed.records)
    assert result.record_rays == undisturbed.record_rays, "a finished record was made again"
    assert len(notebook.buckets) == 6
