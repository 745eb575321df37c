"""Guards are counted by cause, and in a strict render the first that acts is an error that says whose sample it was."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from one_cell import FEW, one, ready

import wdpm
from wdpm.cli import main
from wdpm.cluster.batch import Batch, Kind, zeros
from wdpm.cluster.integrators.registry import Integrator
from wdpm.cluster.plan import render_plan
from wdpm.cluster.render_settings import Routing
from wdpm.cluster.task import BucketTask
from wdpm.cluster.work import guards
from wdpm.cluster.work.bucket_home import BucketHome
from wdpm.cluster.work.guards import Guards
from wdpm.cluster.work.worker import CellWorker
from wdpm.images.image import Image
from wdpm.kernels.limits import CHAIN_LIMIT
from wdpm.kernels.photons.flight import BOUNCE_LIMIT
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import ClusterError, GuardError
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Camera, Medium, Mesh, Scene, diffuse

STRICT = replace(FEW, strict=True)
BY_PATHS = replace(FEW, integrator=Integrator.PATH)  # photons of lamps beyond all proportion are refused
PLACE = re.compile(r"pixel (\d+),(\d+), sample (\d+), vertex (\d+); .* --replay (\d+,\d+,\d+)")


def square(height: float, facing: int) -> Mesh:
    """A unit square at y = height that faces up (1) or down (-1)."""
    corners = np.array([[-0.5, height, -0.5], [-0.5, height, 0.5], [0.5, height, 0.5], [0.5, height, -0.5]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])[:, ::facing]
    return Mesh(f"square at {height}", corners, faces, None, None, 0)


def too_bright() -> Scene:
    """A lamp near the largest float right above a floor, whose light overflows."""
    to_world = np.diag([-1.0, 1.0, -1.0, 1.0])  # looks along -z
    to_world[:3, 3] = (0.0, 0.05, 1.0)
    return Scene(
        "too bright",
        (square(0.0, 1),),
        (diffuse("white", (0.9, 0.9, 0.9), twosided=True),),
        (PointLight("star", (0.0, 0.1, 0.0), (5e37, 5e37, 5e37)),),
        Camera(to_world, fov_x=40.0, width=12, height=8),
    )


def hazy() -> Scene:
    """The Cornell box in haze."""
    box = cornell_box((6, 4))
    meshes = [replace(m, interior=0, exterior=0, bounds=True) if m.emission else m for m in box.meshes]
    media = (Medium("haze", (1e-3, 1e-3, 1e-3), (0.9, 0.9, 0.9)),)
    return replace(box, meshes=tuple(meshes), media=media, camera=replace(box.camera, medium=0))


def with_a_needle(scene: Scene) -> Scene:
    """The scene with a triangle that has no area."""
    line = Mesh("line", np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]]), None, None, 0)
    return replace(scene, meshes=(*scene.meshes, line))


def acted(image: Image) -> dict[str, int]:
    counts: dict[str, int] = image.metadata["report"]["guards"]
    return counts


def do(worker: CellWorker, batch: Batch) -> dict[str, int]:
    """Have the cell work off a batch, with all that follows from it in the cell; what its guards did."""
    waiting = [batch]
    while waiting:
        waiting += [new for new in worker.cells[0].advance(waiting.pop()) if new.kind in worker.cells[0]._actions]
    return guards.added([worker.cells[0].guards, worker.photon_counts()["guards"]])


# In whole renders


@pytest.mark.parametrize("scene", [cornell_box((8, 8)), hazy()], ids=["box", "haze"])
def test_a_sound_scene_renders_to_the_same_bits(scene: Scene) -> None:
    plain = render_in_process(scene, FEW, workers=1, threads=1)
    strict = render_in_process(scene, STRICT, workers=2, cells=4, threads=1)
    for name in plain.layers.keys() - {"cell"}:
        assert np.array_equal(plain.layers[name], strict.layers[name]), name
    assert acted(plain) == acted(strict) == {}
    assert plain.metadata["report"]["gathers_truncated"] > 0  # part of the estimate


@pytest.mark.parametrize(("cells", "routing"), [(1, Routing.FORWARD), (4, Routing.FORWARD), (4, Routing.MERGE)])
def test_the_sample_is_named_and_its_replay_shows_the_cause(cells: int, routing: Routing) -> None:
    chosen = replace(BY_PATHS, strict=True, routing=routing)
    with pytest.raises(GuardError) as caught:
        render_in_process(too_bright(), chosen, workers=min(cells, 2), cells=cells, threads=1)
    text = str(caught.value)
    assert "\n" not in text
    assert guards.CAUSES[guards.DIRECT] in text
    found = PLACE.search(text)
    assert found is not None
    x, y, sample, vertex = (int(found[i]) for i in range(1, 5))
    assert found[5] == f"{x},{y},{sample}"
    replay = wdpm.replay(too_bright(), x, y, sample, chosen)
    assert replay.guards[guards.DIRECT] == 1
    carried = [ray.carries for ray in replay.vertices[vertex].direct]
    assert not np.isfinite(carried).all()


def test_counts_add_up_over_workers_and_stand_in_the_report() -> None:
    one_cell = render_in_process(too_bright(), BY_PATHS, workers=1, threads=1)
    four = render_in_process(too_bright(), BY_PATHS, workers=2, cells=4, threads=1)
    assert acted(one_cell) == acted(four)
    count = acted(one_cell)[guards.DIRECT]
    assert 0 < count <= 12 * 8 * FEW.spp
    assert one_cell.metadata["report"]["nonfinite"]["direct"] == count


def test_dropped_triangles() -> None:
    scene = with_a_needle(cornell_box((4, 4)))
    assert acted(render_in_process(scene, FEW, workers=1, threads=1)) == {guards.DROPPED: 1}
    with pytest.raises(GuardError, match=r"1 left out \(zero area\); to see which: wdpm check"):
        render_in_process(scene, STRICT, workers=1, threads=1)


@pytest.mark.parametrize("cells", [1, 4])
def test_clamped_beams_are_counted_and_the_home_names_their_sample(cells: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render_plan, "volume_unit", lambda *_: 1e-30)  # far too small for these photons
    counted = acted(render_in_process(hazy(), FEW, workers=1, cells=cells, threads=1))
    assert list(counted) == [guards.BEAMS_CLAMPED]
    assert counted[guards.BEAMS_CLAMPED] > 100
    with pytest.raises(GuardError, match=guards.CAUSES[guards.BEAMS_CLAMPED]) as caught:
        render_in_process(hazy(), STRICT, workers=min(cells, 2), cells=cells, threads=1)
    assert PLACE.search(str(caught.value))


@pytest.mark.sockets
def test_a_slave_tells_the_master() -> None:
    with wdpm.Cluster.local(slaves=1) as cluster, pytest.raises(ClusterError, match=r"not finite.* --replay \d+,\d+,"):
        cluster.render(too_bright(), replace(BY_PATHS, strict=True))


def test_the_command_ends_with_one_line_and_exit_code_2(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    mesh = tmp_path / "needle.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 1 2 4\n")
    few = ["--size", "4x4", "--photons", "100", "--spp", "1", "--quiet", "-o", str(tmp_path / "out.npy")]
    assert main.main(["render", str(mesh), *few]) == 0
    capsys.readouterr()
    assert main.main(["render", str(mesh), *few, "--strict"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("wdpm: error: strict: a triangle cannot be rendered")
    assert error.count("\n") == 1


# One guard at a time, by what comes to a cell


def on_the_floor(_: CellWorker) -> dict[str, Any]:
    """A ray that has hit the floor of the Cornell box."""
    return {
        "pixel": 7, "sample": 1, "edges": 2, "medium": -1, "prim": 0, "u": 0.3, "v": 0.3, "t": 100.0,
        "origin": (0, 100, 0), "direction": (0, -1, 0), "throughput": (1, 1, 1),
    }  # fmt: skip


def on_the_lamp(worker: CellWorker) -> dict[str, Any]:
    prim = int(worker.replica.world.lights.prim[0])
    return {**on_the_floor(worker), "prim": prim, "direction": (0, 1, 0)}


@pytest.mark.parametrize("strict", [False, True])
@pytest.mark.parametrize(
    ("cause", "where", "changes", "vertex"),
    [
        (guards.PATHS_CUT, on_the_floor, {"bounce": CHAIN_LIMIT - 1}, CHAIN_LIMIT - 1),
        (guards.EMISSION, on_the_lamp, {"throughput": (3e38, 0, 0), "bounce": 3}, 3),
    ],
    ids=["paths cut", "emission"],
)
def test_guards_of_camera_paths(strict: bool, cause: str, where: Any, changes: dict[str, Any], vertex: int) -> None:
    worker = ready(cornell_box((4, 4)), STRICT if strict else FEW)
    batch = one(Kind.VERTEX, **{**where(worker), **changes})
    if strict:
        with pytest.raises(GuardError, match=f"{guards.CAUSES[cause]}: pixel 3,1, sample 1, vertex {vertex}; "):
            do(worker, batch)
    else:
        assert do(worker, batch)[cause] == 1
        worker.set_view(worker.replica.view)  # type: ignore[arg-type]
        assert worker.statistics()["guards"] == {}


@pytest.mark.parametrize("strict", [False, True])
@pytest.mark.parametrize(
    ("cause", "changes"),
    [(guards.PHOTONS_CUT, {"bounce": BOUNCE_LIMIT}), (guards.PHOTON, {"bounce": 5, "flux": (np.inf, 1, 1)})],
    ids=["cut", "not finite"],
)
def test_guards_of_photons(strict: bool, cause: str, changes: dict[str, Any]) -> None:
    worker = ready(cornell_box((4, 4)), STRICT if strict else FEW)
    floor = {
        "path": 17, "state": 1, "edges": 3, "medium": -1, "origin": (0, 100, 0), "direction": (0, -1, 0),
        "flux": (1, 1, 1), "t": 3.4e38, "prim": -1, "owner": -1,
    }  # fmt: skip
    batch = one(Kind.PHOTON, **{**floor, **changes})
    if strict:
        with pytest.raises(GuardError, match=f'photon path 17 of light "lamp", bounce {changes["bounce"]}'):
            do(worker, batch)
    else:
        assert do(worker, batch)[cause] >= 1  # it may land more than once
        worker.forget_photons()
        assert worker.photon_counts()["guards"] == {}


def test_a_photon_that_leaves_at_the_limit_of_bounces_was_not_cut() -> None:
    worker = ready(cornell_box((4, 4)), STRICT)
    away = {"path": 17, "medium": -1, "direction": (0, 0, -1), "flux": (1, 1, 1), "t": 3.4e38, "prim": -1, "owner": -1}
    assert do(worker, one(Kind.PHOTON, bounce=BOUNCE_LIMIT, **away)) == {}
    assert worker.cells[0].energy[1] > 0  # escaped


@pytest.mark.parametrize("strict", [False, True])
def test_coincident_photons(strict: bool) -> None:
    """More photons than k in one place, and a gather right there."""
    worker = ready(cornell_box((4, 4)), STRICT if strict else FEW)
    ray = on_the_floor(worker)
    corners = worker.cells[0]._surfaces.corners.numpy()[0].astype(np.float64)
    u = np.float64(np.float32(0.3))
    place = (corners[0] * (1.0 - u - u) + corners[1] * u + corners[2] * u).astype(np.float32)  # as surface.position_at
    count = FEW.k + 1
    photons = zeros(Kind.GHOST_PHOTONS, count)
    photons |= {"id": np.arange(count, dtype=np.int64), "position": np.repeat(place[None], count, axis=0)}
    for name, value in (("flux", 1.0), ("normal", (0, 1, 0)), ("direction", (0, 1, 0))):
        photons[name][:] = value
    worker.exchange_ghosts()
    worker.cells[0].store.add_ghosts(Batch.of_task(Kind.GHOST_PHOTONS, -1, 0, 0, 0, photons))
    worker.build_maps()
    worker.finish_maps()
    batch = one(Kind.VERTEX, **ray)
    if strict:
        with pytest.raises(GuardError, match=f"{guards.CAUSES[guards.COINCIDENT]}: pixel 3,1, sample 1"):
            do(worker, batch)
    else:
        assert do(worker, batch) == {guards.COINCIDENT: 1}
        assert do(worker, one(Kind.VERTEX, **{**ray, "u": 0.31})) == {guards.COINCIDENT: 1}  # beside it: no more


@pytest.mark.parametrize("strict", [False, True])
def test_light_of_a_medium_that_is_not_finite(strict: bool) -> None:
    worker = ready(hazy(), STRICT if strict else FEW)
    beam = one(Kind.BEAM, slot=1, place=4, direction=(0, 0, 1), radiance=(3e38, 1, 1), red=2**62, medium=0, length=1)
    (lit,) = worker.cells[0].advance(beam)
    if not strict:
        assert (lit.arrays["radiance"][0] == 0).all()
        assert worker.statistics()["guards"] == {guards.VOLUME: 1}
        return
    view = worker.replica.view
    assert view is not None
    home = BucketHome(BucketTask(0, 2, 1, 3, 2), 0, worker.replica, view, Guards(worker.replica))
    list(home.begin())
    with pytest.raises(GuardError, match=f"{guards.CAUSES[guards.VOLUME]}: pixel 2,1, sample 1, vertex 0; "):
        list(home.receive(lit))
