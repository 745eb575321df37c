"""Maps that each builds of a part of space alone: the irradiance of all parts is that of one who has all photons."""

from __future__ import annotations

import random
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from digests import without_cells
from fake_worker import make_session

import wdpm
from wdpm.cluster.master.map_regions import LEAST_PLACES, regions_of
from wdpm.cluster.master.teams import all_share_memory
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.session import Session
from wdpm.cluster.work.overlap_band import Region
from wdpm.cluster.work.photon_store import PhotonStore
from wdpm.cluster.world import IrradiancePlan
from wdpm.kernels.features import ALL
from wdpm.kernels.photons.deposits import GLOBAL_MAP
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.passes import render_in_passes

RNG = np.random.default_rng(7)
PLACES = RNG.random((2000, 3), np.float32)


def session(places: np.ndarray = PLACES, cells: int = 1, reach: float = 0.05) -> Session:
    """Of a world in which only irradiance at photons is read of the global map."""
    made = make_session(1, cells, places=places)
    ahead = replace(made.world, irradiance=IrradiancePlan(share=0.25), max_depth=None)
    return replace(made, world=replace(ahead, global_map=replace(ahead.global_map, radius=reach)))


@pytest.mark.parametrize("teams", [2, 3, 7, 16])
@pytest.mark.parametrize("lattice", [None, 4])
def test_every_place_is_in_one_region(teams: int, lattice: int | None) -> None:
    places = PLACES if lattice is None else np.floor(PLACES * lattice).astype(np.float32)
    regions = regions_of(session(places), teams)
    assert regions.shape == (teams, 2, 3)
    everywhere = np.concatenate([places, 100 * RNG.standard_normal((500, 3), np.float32)])
    rows = [Region(*corners, reach=0.0).within(everywhere) for corners in regions]
    assert sorted(np.concatenate(rows)) == list(range(len(everywhere)))
    if lattice is None:
        sizes = [np.count_nonzero(each < len(places)) for each in rows]
        assert max(sizes) - min(sizes) <= 2


def test_photons_of_one_place_are_of_one_region() -> None:
    regions = regions_of(session(np.ones_like(PLACES)), 4)
    assert not len(regions)  # one team would hold all of them, and others nothing


def test_what_gathers_may_find_is_within_reach() -> None:
    for low, high in regions_of(session(), 8):
        region = Region(low, high, 0.1)
        inside, near = PLACES[region.within(PLACES)], np.zeros(len(PLACES), bool)
        near[region.near(PLACES)] = True
        away = np.linalg.norm(PLACES[:, None] - inside[None], axis=2).min(axis=1)
        assert near[away <= 0.1].all()
        assert not near.all()


def test_of_other_maps_all_photons_are_wanted() -> None:
    region = Region(np.zeros(3, np.float32), np.full(3, 0.5, np.float32), 0.0)
    photons = {
        "id": np.arange(3),
        "map": np.array([0, 0, 1]),
        "position": np.float32([[0.1] * 3, [0.9] * 3, [0.9] * 3]),
    }
    assert region.photons(photons, GLOBAL_MAP)["id"].tolist() == [0, 2]


def test_all_photons_are_needed_where_vertices_ask_them() -> None:
    plain = session()
    assert len(regions_of(plain, 4))
    for others in (
        replace(plain.world, max_depth=5),
        replace(plain.world, features=ALL),
        replace(plain.world, irradiance=IrradiancePlan()),
    ):
        assert not len(regions_of(replace(plain, world=others), 4))


@pytest.mark.parametrize(
    ("whole", "teams"),
    [
        (session(), 1),
        (session(cells=2), 2),
        (session(reach=0.5), 4),  # all are near everything
        (session(PLACES[: 4 * LEAST_PLACES - 1]), 4),
    ],
)
def test_where_regions_bring_nothing_there_are_none(whole: Session, teams: int) -> None:
    assert not len(regions_of(whole, teams))


@pytest.mark.parametrize(
    ("endpoints", "expected"),
    [(["ipc:///run/a", "ipc:///run/b"], True), (["ipc:///run/a", "tcp://10.0.0.1:7"], False)],
)
def test_who_shares_memory_has_no_use_for_regions(endpoints: list[str], expected: bool) -> None:
    """One of them builds the whole map for all."""
    teams: Any = [SimpleNamespace(members=[SimpleNamespace(hello=SimpleNamespace(peers=peers))]) for peers in endpoints]
    assert all_share_memory(teams) is expected


@pytest.mark.parametrize(("workers", "indirect"), [(3, Indirect.CACHE), (5, Indirect.GATHER)])
def test_an_image_keeps_its_bits(workers: int, indirect: Indirect, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = wdpm.load("cornell-box", size=(24, 24))
    chosen = RenderSettings(photons=3000, spp=2, passes=2, k=20, indirect=indirect, bucket=8)
    alone = render_in_passes(scene, InProcess(threads=1), chosen)
    built: list[tuple[PhotonStore, int]] = []
    original = PhotonStore.build

    def counted(store: PhotonStore, part: int = 0, parts: int = 1) -> None:
        built.append((store, len(store._own[GLOBAL_MAP])))
        original(store, part, parts)

    monkeypatch.setattr(PhotonStore, "build", counted)
    with InProcess(threads=1, workers=workers, cells=1, team=1, shuffle=random.Random(workers)) as backend:
        image = render_in_passes(scene, backend, chosen)
    assert without_cells(image).digest() == without_cells(alone).digest()
    stored = alone.metadata["report"]["photons"]["stored"]
    assert len(built) == 2 * workers
    assert max(held for _, held in built) < stored
    with pytest.raises(AssertionError, match="read ahead alone"):
        built[-1][0].built(GLOBAL_MAP)
