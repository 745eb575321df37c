"""The exactness contract: the image is a function of scene and settings, whatever computes it, in whatever order."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from digests import alone, same_bits
from given_tree import give_tree
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays, Kind, concatenate
from wdpm.cluster.render_settings import RenderSettings, Routing
from wdpm.cluster.work.photon_store import PhotonStore
from wdpm.images.image import Image
from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.rays.cells import cell_boxes
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes.builtin.cornell_box import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.scene import diffuse
from wdpm.scenes.model.transforms import look_at

pytestmark = pytest.mark.usefixtures("small_pilot")

FEW = RenderSettings(photons=3000, spp=2, k=20)
CORNELL = cornell_box((33, 26))


@pytest.fixture(scope="module")
def cornell_alone(small_pilot: None) -> Image:  # noqa: ARG001
    return alone(CORNELL, FEW)


# The built-in Cornell box


@pytest.mark.parametrize("routing", list(Routing))
@pytest.mark.parametrize(("workers", "cells"), [(1, 2), (2, 4), (3, 8), (8, 8)])
def test_partition_and_routing_change_no_bit(cornell_alone: Image, routing: Routing, workers: int, cells: int) -> None:
    image = render_in_process(CORNELL, replace(FEW, routing=routing), workers=workers, cells=cells, threads=1)
    assert same_bits(image, cornell_alone)
    assert len(np.unique(image.layers["cell"])) > 1  # several cells did take part
    assert len(image.metadata["report"]["slaves"]) == workers
    assert image.metadata["report"]["settings"]["cells"] == cells


@pytest.mark.parametrize("workers", [2, 5])
def test_the_default_number_of_cells_changes_no_bit(cornell_alone: Image, workers: int) -> None:
    assert same_bits(render_in_process(CORNELL, FEW, workers=workers, threads=1), cornell_alone)


@pytest.mark.parametrize(("bucket", "workers"), [(13, 1), (16, 2), (7, 3), (1000, 4)])
def test_bucket_size_changes_no_bit(cornell_alone: Image, bucket: int, workers: int) -> None:
    assert same_bits(render_in_process(CORNELL, replace(FEW, bucket=bucket), workers=workers), cornell_alone)


def test_one_pixel_buckets_change_no_bit() -> None:
    small = cornell_box((4, 3))
    assert same_bits(render_in_process(small, replace(FEW, bucket=1), workers=2), alone(small, FEW))


@pytest.mark.parametrize("threads", [2, 3])
def test_processes_change_no_bit(cornell_alone: Image, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wdpm.rendering.in_process.WORTH_FORKING", 0)
    assert same_bits(render_in_process(CORNELL, FEW, workers=1, threads=threads), cornell_alone)


@pytest.mark.parametrize(("workers", "cells", "threads"), [(1, 1, 2), (1, 1, 3), (2, 4, 3)])
def test_threads_change_no_bit(cornell_alone: Image, workers: int, cells: int, threads: int) -> None:
    assert same_bits(render_in_process(CORNELL, FEW, workers=workers, cells=cells, threads=threads), cornell_alone)


@pytest.mark.parametrize("order", range(4))
def test_order_of_delivery_changes_no_bit(cornell_alone: Image, order: int) -> None:
    chosen = replace(FEW, routing=(Routing.FORWARD, Routing.MERGE)[order % 2], bucket=(9, 32)[order // 2])
    image = render_in_process(
        CORNELL, chosen, workers=(2, 4, 3)[order % 3], cells=(4, 8)[order % 2], shuffle=random.Random(order)
    )
    assert same_bits(image, cornell_alone)


@pytest.mark.parametrize("seed", [1, 2**32 - 1])
def test_every_seed_has_its_own_bits(cornell_alone: Image, seed: int) -> None:
    chosen = replace(FEW, seed=seed)
    image = render_in_process(CORNELL, chosen, workers=3, shuffle=random.Random(seed))
    assert same_bits(image, alone(CORNELL, chosen))
    for layer in ("direct", "indirect", "depth"):
        assert not np.array_equal(image.layers[layer], cornell_alone.layers[layer]), layer


@pytest.mark.parametrize(
    ("change", "routing"),
    [
        ({"k": 1}, Routing.FORWARD),
        ({"k": 200}, Routing.MERGE),
        ({"light_samples": 3}, Routing.MERGE),
        ({"max_depth": 3}, Routing.FORWARD),
        ({"max_depth": 2}, Routing.MERGE),
    ],
)
def test_every_setting_gives_the_same_bits(cornell_alone: Image, change: dict[str, int], routing: Routing) -> None:
    chosen = replace(FEW, **change)  # type: ignore[arg-type]
    reference = alone(CORNELL, chosen)
    assert not same_bits(reference, cornell_alone)
    chosen = replace(chosen, routing=routing)
    assert same_bits(render_in_process(CORNELL, chosen, workers=2, cells=8, shuffle=random.Random(1)), reference)


def test_waves_and_full_photon_regions_change_no_bit(monkeypatch: pytest.MonkeyPatch, cornell_alone: Image) -> None:
    monkeypatch.setattr("wdpm.cluster.work.bucket_home.WAVE_SAMPLES", 100)  # a bucket's samples in many waves of one
    monkeypatch.setattr("wdpm.cluster.work.photon_paths.DEPOSITS_A_PATH", 1)  # photons must wait for room
    monkeypatch.setattr("wdpm.cluster.work.photon_paths.LEAST_DEPOSITS", 1)
    monkeypatch.setattr("wdpm.cluster.work.photon_gathers.GATHER_GRAIN", 1)  # many chunks for many threads
    monkeypatch.setattr("wdpm.cluster.work.photon_gathers.GATHER_RUN", 3)
    assert same_bits(render_in_process(CORNELL, FEW, workers=2, cells=4, threads=3), cornell_alone)


def test_photons_that_wait_for_room_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    """In bright rooms a launch runs out of room for photons, and which ones wait depends on the number of threads.

    The pilot then finds its photons in another order, and more of them than it asks for their density.
    """
    monkeypatch.setattr("wdpm.cluster.work.photon_paths.DEPOSITS_A_PATH", 1)
    monkeypatch.setattr("wdpm.cluster.work.photon_paths.LEAST_DEPOSITS", 1)
    bright = replace(CORNELL, materials=tuple(diffuse(m.name, (0.95, 0.9, 0.9), True) for m in CORNELL.materials))
    reference = alone(bright, FEW)
    for threads, worth_forking in ((3, 0), (4, 1 << 16)):
        monkeypatch.setattr("wdpm.rendering.in_process.WORTH_FORKING", worth_forking)
        image = render_in_process(bright, FEW, workers=1, cells=1, threads=threads)
        radii = [i.metadata["report"]["settings"]["gather_radius"] for i in (image, reference)]
        assert radii[0] == radii[1]
        assert same_bits(image, reference)


# Split planes that go through everything


def eight_cells_through(point: NDArray[Any]) -> tuple[list[int], list[float]]:
    """Three planes that all go through one point."""
    x, y, z = (float(np.float32(v)) for v in point)
    return [0, 1, 1, 2, 2, 2, 2], [x, y, y, z, z, z, z]


def places_of_cornell() -> dict[str, NDArray[Any]]:
    """Points that the planes shall go through: walls, vertices, the light, the camera, and where nothing is."""
    flat = flatten(CORNELL)
    corners = flat.triangles.positions.reshape(-1, 3)
    glowing = flat.triangles.positions[flat.triangles.emitter >= 0]
    return {
        "lower corner of the room": corners.min(axis=0),
        "upper corner of the room": corners.max(axis=0),
        "a vertex of a block": corners[np.abs(corners).max(axis=1).argmin()],
        "a corner of the light": glowing[0, 0],
        "the middle of the light": glowing.reshape(-1, 3).mean(axis=0, dtype=np.float32),
        "the camera": flat.camera.to_world[:3, 3],
        "outside of everything": corners.max(axis=0) + 10.0,
        "just beyond the wall": np.nextafter(corners.max(axis=0), np.float32(np.inf)),
        "just within the wall": np.nextafter(corners.max(axis=0), np.float32(-np.inf)),
    }


@pytest.mark.parametrize(("number", "place"), list(enumerate(places_of_cornell())))
def test_planes_through_everything_change_no_bit(
    monkeypatch: pytest.MonkeyPatch, cornell_alone: Image, number: int, place: str
) -> None:
    give_tree(monkeypatch, *eight_cells_through(places_of_cornell()[place]))
    chosen = replace(FEW, routing=list(Routing)[number % 2])
    assert same_bits(
        render_in_process(CORNELL, chosen, workers=3, cells=8, shuffle=random.Random(number)), cornell_alone
    )


def test_slabs_thinner_than_the_gather_radius_change_no_bit(
    monkeypatch: pytest.MonkeyPatch, cornell_alone: Image
) -> None:
    unit = flatten(CORNELL).unit
    give_tree(monkeypatch, [2] * 7, [z / unit for z in (0.0, -2.0, 2.0, -3.0, -1.0, 1.0, 3.0)])
    image = render_in_process(CORNELL, FEW, workers=4, cells=8)
    assert same_bits(image, cornell_alone)


def test_a_camera_that_looks_along_a_wall_and_a_plane(monkeypatch: pytest.MonkeyPatch) -> None:
    # The eye lies in the floor's plane and in two split planes, and looks along all three.
    scene = replace(
        CORNELL,
        camera=replace(
            CORNELL.camera,
            to_world=look_at((278.0, 0.0, -800.0), (278.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
            width=15,
            height=15,
        ),
    )
    eye = flatten(scene).camera.to_world[:3, 3]
    reference = alone(scene, FEW)
    assert (reference.layers["depth"] > 0).any()
    give_tree(monkeypatch, *eight_cells_through(np.array([eye[0], eye[1], 0.0])))
    for routing in Routing:
        assert same_bits(render_in_process(scene, replace(FEW, routing=routing), workers=2, cells=8), reference)


def test_far_from_the_origin_only_rounding_changes() -> None:
    """A scene a million units away renders to the same bits in any partition, and like the one at the origin."""
    move = np.array([1e6, -3e6, 5e5])
    meshes = tuple(replace(mesh, vertices=mesh.vertices + move) for mesh in CORNELL.meshes)
    to_world = CORNELL.camera.to_world.copy()
    to_world[:3, 3] += move
    far = replace(CORNELL, meshes=meshes, camera=replace(CORNELL.camera, to_world=to_world))
    reference = alone(far, FEW)
    assert same_bits(render_in_process(far, FEW, workers=3, cells=8), reference)
    at_origin = alone(CORNELL, FEW)
    # Vertices on multiples of 0.1 mm differ by roundings of a double at 5e6 (1e-9) before they are centred: a pixel may
    # change where a sample grazes an edge, the mean hardly.
    np.testing.assert_allclose(reference.pixels.mean(), at_origin.pixels.mean(), rtol=1e-3)


# Photons and ghosts


@dataclass
class Exchange:
    """What the cells of a render owned, and what they sent to each other."""

    owned: dict[int, Arrays] = field(default_factory=dict)
    sent: list[tuple[int, int, Kind, Arrays]] = field(default_factory=list)
    band: float = 0.0
    points: dict[int, Arrays] = field(default_factory=dict)


@pytest.fixture
def exchange(monkeypatch: pytest.MonkeyPatch) -> Exchange:
    """Records the exchange of ghosts of the renders that follow."""
    seen = Exchange()
    original = PhotonStore.ghosts

    def recorded(store: PhotonStore) -> Iterator[Any]:
        number = store._cell
        seen.owned[number] = store.so_far()
        seen.band = store._replica.world.global_map.band + store._replica.pad
        for batch in original(store):
            seen.sent.append((number, batch.cell, batch.kind, batch.arrays))
            yield batch
        seen.points[number] = store._own_points.whole()

    monkeypatch.setattr(PhotonStore, "ghosts", recorded)
    return seen


def by_id(arrays: Arrays) -> Arrays:
    """The photons in the order of their ids."""
    order = np.argsort(arrays["id"])
    return {name: column[order] for name, column in arrays.items()}


@pytest.mark.parametrize("cells", [2, 8, 16])
def test_photons_are_the_same_set_each_with_one_owner(exchange: Exchange, cells: int) -> None:
    whole = render_in_process(CORNELL, FEW, workers=1, cells=1)
    photons = by_id(exchange.owned.pop(0))
    points = exchange.points.pop(0)
    assert len(np.unique(photons["id"])) == len(photons["id"]) > 2000

    divided = render_in_process(CORNELL, FEW, workers=2, cells=cells, shuffle=random.Random(cells))
    assert len(exchange.owned) == cells
    pieces = by_id(concatenate(list(exchange.owned.values()), Kind.GHOST_PHOTONS))
    assert photons.keys() == pieces.keys()
    for name in photons:
        np.testing.assert_array_equal(photons[name].view(np.uint8), pieces[name].view(np.uint8), err_msg=name)

    report = divided.metadata["report"]
    assert sum(slave["photons"] for slave in report["slaves"]) == report["photons"]["stored"] == len(photons["id"])
    assert report["photons"]["stored"] == whole.metadata["report"]["photons"]["stored"]
    assert sum(light["stored"] for light in report["photons"]["lights"]) == report["photons"]["stored"]

    pieces_of_points = concatenate(list(exchange.points.values()), Kind.GHOST_POINTS)
    for name in points:
        np.testing.assert_array_equal(
            np.sort(points[name], axis=0), np.sort(pieces_of_points[name], axis=0), err_msg=name
        )


@pytest.mark.parametrize("radius", [5.0, 60.0, 400.0])
def test_ghosts_are_just_the_photons_of_the_band(
    exchange: Exchange, monkeypatch: pytest.MonkeyPatch, radius: float
) -> None:
    flat = flatten(CORNELL)
    axis, split = [0, 1, 2], [10.0 / flat.unit, -50.0 / flat.unit, 0.0]
    give_tree(monkeypatch, axis, split)
    image = render_in_process(CORNELL, replace(FEW, radius=radius), workers=2, cells=4)
    low, high = (
        corner.astype(np.float64) for corner in cell_boxes(np.array(axis, np.int32), np.array(split, np.float32))
    )
    assert exchange.band == pytest.approx(radius / flat.unit + flat.extent * PAD_SHARE, rel=1e-12)
    for number, owned in exchange.owned.items():  # shaded, and so stored, in the cell that they lie in
        assert ((low[number] <= owned["position"]) & (owned["position"] <= high[number])).all()
    for source, target, kind, arrays in exchange.sent:
        owned = exchange.owned[source] if kind is Kind.GHOST_PHOTONS else exchange.points[source]
        position = owned["position"].astype(np.float64)
        distance = np.linalg.norm(position - np.clip(position, low[target], high[target]), axis=1)
        sent = np.zeros(len(position), bool)
        name = "id" if kind is Kind.GHOST_PHOTONS else "position"
        if kind is Kind.GHOST_PHOTONS:
            sent = np.isin(owned["id"], arrays["id"])
            assert sent.sum() == len(arrays[name])
            # Differences are rounded to float32 before they are squared: half an ulp of the distance.
            doubtful = np.abs(distance - exchange.band) < 1e-6 * exchange.band
            np.testing.assert_array_equal(sent[~doubtful], (distance <= exchange.band)[~doubtful])
        else:
            assert abs(len(arrays[name]) - np.count_nonzero(distance <= exchange.band)) <= 1
    pairs = {(source, target, kind) for source, target, kind, _ in exchange.sent}
    assert len(pairs) == len(exchange.sent) == 2 * 4 * 3  # every ordered pair once, photons and points
    ghosts = sum(len(arrays["id"]) for _, _, kind, arrays in exchange.sent if kind is Kind.GHOST_PHOTONS)
    assert ghosts == sum(slave["ghosts"] for slave in image.metadata["report"]["slaves"]) > 0


def test_a_narrow_band_is_told_and_a_full_one_never_left(cornell_alone: Image) -> None:
    exact = render_in_process(CORNELL, FEW, workers=4, cells=4)
    assert exact.metadata["report"]["gathers_left_band"] == 0
    wide = render_in_process(CORNELL, replace(FEW, band=1.5), workers=4, cells=4)
    assert wide.metadata["report"]["gathers_left_band"] == 0
    assert same_bits(wide, cornell_alone)
    narrow = render_in_process(CORNELL, replace(FEW, band=0.3, inexact=True), workers=4, cells=4)
    assert narrow.metadata["report"]["gathers_left_band"] > 0
    assert not same_bits(narrow, cornell_alone)
    # What lies beyond the band is missing from the indirect light, and from nothing else.
    np.testing.assert_array_equal(narrow.layers["direct"], cornell_alone.layers["direct"])
    no_band = render_in_process(CORNELL, replace(FEW, band=0.0, inexact=True), workers=4, cells=4)
    left = [i.metadata["report"]["gathers_left_band"] for i in (narrow, no_band)]
    assert left[1] > left[0]


def test_no_photons_no_indirect_light_and_the_same_bits() -> None:
    chosen = replace(FEW, photons=0)
    reference = alone(CORNELL, chosen)
    assert not reference.layers["indirect"].any()
    assert reference.layers["direct"].any()
    assert same_bits(render_in_process(CORNELL, chosen, workers=3, cells=4), reference)
