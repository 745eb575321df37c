"""Pictures by the irradiance cache: as bright as by gathering everywhere, without splotches, alike for all seeds."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from furnaces import Array, quad, rendered, view
from path_traced import furnace

from wdpm.cluster.plan.view import CACHE_PLAN
from wdpm.cluster.records import Records, candidates
from wdpm.cluster.render_settings import Indirect
from wdpm.cluster.work.worker import CellWorker
from wdpm.images.image import Image
from wdpm.scenes import cornell_box
from wdpm.scenes.meshes.primitives import sphere
from wdpm.scenes.model.bsdfs import Bsdf, Conductor, ThinDielectric
from wdpm.scenes.model.scene import Material, Mesh, Scene
from wdpm.scenes.model.transforms import look_at

SIDE = 48
CHOSEN = {"indirect": Indirect.CACHE, "all_effects": True, "photons": 60_000, "spp": 16}

BLOCK = 6
"""Side of the parts of a picture whose means are compared [pixels]: a splotch is that large at least."""


def blocks(image: Image) -> Array:
    """Mean indirect light of parts of a picture, all channels together, shape [parts, parts]."""
    light = image.layers["indirect"].astype(np.float64).sum(axis=2)
    return np.asarray(light.reshape(SIDE // BLOCK, BLOCK, SIDE // BLOCK, BLOCK).mean(axis=(1, 3)))


@pytest.fixture
def records(monkeypatch: pytest.MonkeyPatch) -> list[Records]:
    """Those that workers are sent, round by round."""
    seen: list[Records] = []
    set_records = CellWorker.set_records

    def noted(worker: CellWorker, sent: Records) -> None:
        seen.append(sent)
        set_records(worker, sent)

    monkeypatch.setattr(CellWorker, "set_records", noted)
    return seen


@pytest.fixture(scope="module")
def pictures() -> list[Image]:
    """Of the Cornell box, with several seeds: other photons and other gather rays."""
    return [rendered(cornell_box((SIDE, SIDE)), seed=seed, **CHOSEN) for seed in range(4)]


def of_seeds(pictures: list[Image]) -> Array:
    """Parts of all pictures, shape [seeds, parts, parts]."""
    return np.stack([blocks(picture) for picture in pictures])


def test_no_part_of_a_picture_flickers(pictures: list[Image]) -> None:
    """Seeds differ by the noise of photons and of some hundred rays a record, nowhere by a splotch."""
    parts = of_seeds(pictures)
    lit = parts.mean(axis=0) > 0.05 * parts.mean()
    deviation = parts.std(axis=0, ddof=1)[lit] / parts.mean(axis=0)[lit]
    assert np.median(deviation) < 0.03
    assert deviation.max() < 0.15


def test_parts_are_as_bright_as_by_gathering(pictures: list[Image]) -> None:
    """Interpolation moves light by no more than its noise allows to tell, and by a tenth in the worst corner."""
    chosen = {**CHOSEN, "indirect": Indirect.GATHER, "spp": 32}
    gathered = of_seeds([rendered(cornell_box((SIDE, SIDE)), seed=seed, **chosen) for seed in range(4)])
    parts = of_seeds(pictures)
    lit = gathered.mean(axis=0) > 0.05 * gathered.mean()
    error = (parts.mean(axis=0) - gathered.mean(axis=0))[lit] / gathered.mean(axis=0)[lit]
    noise = np.hypot(*(p.std(axis=0, ddof=1)[lit] / 2 / p.mean(axis=0)[lit] for p in (parts, gathered)))
    assert abs(np.average(error, weights=gathered.mean(axis=0)[lit])) < 0.01
    assert (np.abs(error) < 0.1 + 4.5 * noise).all()
    assert np.median(np.abs(error)) < 0.02


def test_every_pixel_of_a_furnace_is_as_bright() -> None:
    """Where light is the same everywhere, gradients are noise: none may show, at corners and on a ball no more."""
    data = sphere(24)
    ball = Mesh("ball", 0.4 * data.vertices, data.faces, data.normals, data.uvs, 0, (1.0, 1.0, 1.0))
    room = furnace(0.5)
    what = replace(room, meshes=(*room.meshes, ball), camera=view((0.8, 0.8, -0.9), (-0.3, -0.5, 0.2), 70, SIDE))
    light = rendered(what, **CHOSEN).layers["indirect"][:, :, 0]
    assert light.mean() == pytest.approx(0.5, rel=0.03)
    assert np.quantile(light, 0.01) > 0.35
    assert np.quantile(light, 0.99) < 0.7


def test_rounds_add_records_where_some_are_missing(records: list[Records]) -> None:
    """Each round keeps those before, and the last pixels that see a wall have one near."""
    image = rendered(cornell_box((SIDE, SIDE)), **{**CHOSEN, "spp": 2})
    assert len(records) == CACHE_PLAN.rounds
    for fewer, more in itertools.pairwise(records):
        assert set(fewer.number) < set(more.number)
    asked = sum(len(candidates(SIDE, SIDE, CACHE_PLAN, number)) for number in range(CACHE_PLAN.rounds))
    assert len(records[-1]) < asked  # some were not needed
    flat = np.unique(np.round(image.layers["normal"].reshape(-1, 3), 3), axis=0)
    assert {tuple(n) for n in np.round(records[-1].normal, 3) + 0.0} <= {tuple(n) for n in flat + 0.0}


def test_what_a_mirror_shows_has_light_of_records_too() -> None:
    """A mirror's picture of a wall that the camera sees itself reads the wall's records."""

    def lit(way: Indirect) -> Array:
        image = rendered(mirrored(), **{**CHOSEN, "indirect": way, "spp": 8})
        return np.asarray(image.layers["indirect"].mean(axis=(0, 1), dtype=np.float64))

    np.testing.assert_allclose(lit(Indirect.CACHE), lit(Indirect.GATHER), rtol=0.05)


PANE, MIRROR = ThinDielectric(), Conductor()


@pytest.mark.parametrize("shows", [PANE, MIRROR], ids=["pane", "mirror"])
def test_records_lie_behind_panes_and_in_mirrors(shows: Bsdf) -> None:
    """A room that is seen through a pane, or in a mirror alone, has hardly more grain than one that is simply seen."""
    bare, through = (grain(what) for what in (cornell_box((SIDE, SIDE)), seen_by(shows)))
    assert through < 1.6 * bare  # without records there, four or five times as much


def grain(what: Scene) -> float:
    """Of indirect light: the median, over parts of the picture, of what neighbours differ by, as a share of them."""
    light = rendered(what, **CHOSEN).layers["indirect"].astype(np.float64).sum(axis=2)
    means = light.reshape(SIDE // BLOCK, BLOCK, SIDE // BLOCK, BLOCK).mean(axis=(1, 3))
    steps = np.diff(light, 2, axis=1)[:, : SIDE // BLOCK * BLOCK - BLOCK]
    rough = (steps**2).reshape(SIDE // BLOCK, BLOCK, -1, BLOCK).mean(axis=(1, 3))
    return float(np.median(np.sqrt(rough) / means[:, : rough.shape[1]]))


def seen_by(shows: Bsdf) -> Scene:
    """The Cornell box through a pane, or in a mirror before which the camera is turned away from it."""
    what = cornell_box((SIDE, SIDE))
    screen = quad((-300.0, -300.0, -900.0), (1100.0, 0.0, 0.0), (0.0, 1100.0, 0.0), len(what.materials))
    camera = what.camera
    if shows is PANE:
        screen = replace(screen, vertices=screen.vertices + np.array([0.0, 0.0, 500.0]))
    else:
        turned = look_at((278.0, 273.0, -700.0), (278.0, 273.0, -900.0), (0.0, 1.0, 0.0))
        camera = replace(camera, to_world=turned, fov_x=28.0)  # from the mirror's other side the box is 1100 away
    materials = (*what.materials, Material("screen", shows))
    return replace(what, meshes=(*what.meshes, screen), materials=materials, camera=camera)


def mirrored() -> Scene:
    """The Cornell box with a mirror for its tall block."""
    what = cornell_box((SIDE, SIDE))
    meshes = tuple(
        replace(mesh, material=len(what.materials)) if mesh.name == "tall block" else mesh for mesh in what.meshes
    )
    return replace(what, meshes=meshes, materials=(*what.materials, Material("mirror", Conductor())))
