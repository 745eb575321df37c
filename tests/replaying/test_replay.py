"""A replay is the sample that a render traced: every bit of it, and what it says of the way there is true."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import wdpm
from wdpm.cli import main
from wdpm.cluster.render_settings import RenderSettings
from wdpm.rendering.in_process import InProcess, render_in_process
from wdpm.replaying.run import Replayer
from wdpm.replaying.vertices import LAYERS, Replay
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.bsdfs import Dielectric, Diffuse, Mask, Plastic, TwoSided
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.scene import Material, Medium, Mesh, Scene

pytestmark = pytest.mark.usefixtures("small_pilot")

SIZE = (6, 5)
FEW = RenderSettings(
    photons=1500, caustic_photons=800, volume_photons=1500, k=20, caustic_k=10, spp=3, light_samples=2, all_effects=True
)


def hazy_box() -> Scene:
    """The Cornell box in haze under a sky, with a block of glass, one of plastic, and a veil across half of it."""
    box = cornell_box(SIZE)
    first = len(box.materials)
    more = (
        Material("glass", Dielectric()),
        Material("plastic", TwoSided(Plastic())),
        Material("veil", Mask(TwoSided(Diffuse((0.5, 0.5, 0.5))), 0.4)),
    )
    changes = {
        "tall block": {"material": first, "exterior": 0, "bounds": True},
        "short block": {"material": first + 1},
        "lamp": {"interior": 0, "exterior": 0, "bounds": True},
    }
    meshes = [replace(mesh, **changes.get(mesh.name, {})) for mesh in box.meshes]
    corners = np.array([[100.0, 100, 20], [450, 100, 20], [450, 450, 20], [100, 450, 20]])
    meshes.append(Mesh("veil", corners, np.array([[0, 1, 2], [0, 2, 3]]), None, None, first + 2))
    return replace(
        box,
        meshes=tuple(meshes),
        materials=(*box.materials, *more),
        lights=(Environment("sky", np.full((1, 1, 3), 0.5, np.float32)),),
        media=(Medium("haze", (4e-4, 5e-4, 6e-4), (0.9, 0.8, 0.7)),),
        camera=replace(box.camera, medium=0, fov_x=55.0),
    )


def in_vain(replay: Replay) -> bool:
    """Whether some shadow ray of it was blocked."""
    return any(ray.arrives is None and any(ray.carries) for vertex in replay.vertices for ray in vertex.direct)


def through(replay: Replay) -> bool:
    """Whether some shadow ray of it went through a surface and arrived."""
    return any(ray.passes and ray.arrives for vertex in replay.vertices for ray in vertex.direct)


def added_up(replay: Replay, light_samples: int) -> dict[str, NDArray[np.float64]]:
    """The layers from what the vertices say, in the order in which a render adds."""
    layers = {name: np.zeros(3) for name in LAYERS}
    for vertex in replay.vertices:
        shadows = [np.array(ray.arrives) if ray.arrives else np.zeros(3) for ray in vertex.direct]
        emission = np.array(vertex.emission)
        if vertex.bounce == 0:
            lit = np.zeros(3)
            for shadow in shadows:
                lit = lit + shadow
            layers["direct"] = emission + lit * (1.0 / light_samples)
        else:
            for light in (*shadows, emission):
                layers["direct"] = layers["direct"] + light
        for name, gather in (("indirect", vertex.indirect), ("caustic", vertex.caustic)):
            if gather is not None:
                layers[name] = layers[name] + np.array(gather.radiance)
        layers["volume"] = layers["volume"] + np.array(vertex.volume)
    return layers


def test_all_samples_of_an_image_come_back_bit_for_bit() -> None:
    scene = hazy_box()
    image = render_in_process(scene, FEW, workers=2, cells=4)
    replayer = Replayer(scene, InProcess(threads=1), FEW)
    replays = []
    for y in range(SIZE[1]):
        for x in range(SIZE[0]):
            samples = [replayer.sample(x, y, number) for number in range(FEW.spp)]
            sums = {name: np.zeros(3) for name in LAYERS}
            for sample in samples:
                sums = {name: sums[name] + sample.layers[name] for name in LAYERS}
                for name, layer in added_up(sample, FEW.light_samples).items():
                    assert (layer == sample.layers[name]).all(), (x, y, sample.sample, name)
            for name in LAYERS:
                assert (image.layers[name][y, x] == (sums[name] * (1.0 / FEW.spp)).astype(np.float32)).all(), (x, y)
            replays += samples
    # All that a replay tells of occurs in this scene, or the equality above says little.
    vertices = [vertex for replay in replays for vertex in replay.vertices]
    assert {vertex.hit.leaf for vertex in vertices if vertex.hit} >= {"diffuse", "dielectric", "plastic", "null"}
    assert any(vertex.hit is None for vertex in vertices)
    assert any(map(in_vain, replays))
    assert any(map(through, replays))
    assert all(any(replay.layers[name].any() for replay in replays) for name in LAYERS)
    assert {ray.light for vertex in vertices for ray in vertex.direct} >= {"lamp", "sky"}
    assert {vertex.medium for vertex in vertices} == {"haze", None}
    assert max(len(replay.vertices) for replay in replays) > 3
    assert all(replay.guards == {} for replay in replays)
    for replay in replays:
        goes_on = [vertex.onward is not None for vertex in replay.vertices]
        assert goes_on == [True] * (len(goes_on) - 1) + [False]
        for before, after in zip(replay.vertices, replay.vertices[1:], strict=False):
            assert before.onward is not None
            assert (before.onward.throughput, before.onward.medium) == (after.throughput, after.medium)


def test_what_is_hit_is_told_in_the_coordinates_of_the_scene() -> None:
    scene = cornell_box((12, 12))
    shift = np.array([[0, 0, 0, 1000.0]] * 3 + [[0, 0, 0, 0]])
    moved = replace(
        scene,
        meshes=tuple(replace(mesh, vertices=mesh.vertices + 1000.0) for mesh in scene.meshes),
        camera=replace(scene.camera, to_world=scene.camera.to_world + shift),
    )
    settings = RenderSettings(photons=500, spp=1)
    vertex = Replayer(moved, InProcess(threads=1), settings).sample(6, 11, 0).vertices[0]
    assert vertex.hit is not None
    hit = vertex.hit
    assert (hit.mesh, hit.material, hit.leaf, hit.front) == ("floor", "white", "diffuse", True)
    mesh = next(mesh for mesh in moved.meshes if mesh.name == hit.mesh)
    a, b, c = mesh.vertices[mesh.faces[hit.triangle]]
    assert np.abs(a * (1 - hit.u - hit.v) + b * hit.u + c * hit.v - hit.position).max() < 1e-3
    seen_from = np.linalg.norm(hit.position - moved.camera.to_world[:3, 3])
    assert 0 < seen_from - hit.distance < 2 * moved.camera.near_clip  # a ray starts on the near plane
    assert hit.normal == pytest.approx((0.0, 1.0, 0.0))
    assert hit.color == pytest.approx((0.725, 0.71, 0.68))
    assert vertex.indirect is not None
    assert vertex.indirect.photons > 0


def test_names_are_right_where_triangles_are_dropped() -> None:
    """Those without area, those that are not finite, and copies, but for those of lamps."""
    box = cornell_box((12, 12))
    by_name = {mesh.name: mesh for mesh in box.meshes}
    floor = replace(by_name["floor"], faces=np.concatenate([[[0, 0, 1]], by_name["floor"].faces]))
    nowhere = Mesh("nowhere", np.array([[np.nan, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]), None, None, 0)
    copies = [replace(by_name[name], name=f"copy of {name}") for name in ("floor", "lamp")]
    rest = [mesh for mesh in box.meshes if mesh.name != "floor"]
    scene = replace(box, meshes=(by_name["lamp"], nowhere, floor, *copies, *rest))
    assert flatten(scene).dropped == {"not finite": 1, "zero area": 1, "the same as another, which hides it": 2}
    replayer = Replayer(scene, InProcess(threads=1), RenderSettings(photons=500, spp=1))
    for pixel, name in (((6, 11), "floor"), ((4, 6), "tall block"), ((8, 8), "short block"), ((6, 0), "ceiling")):
        hit = replayer.sample(*pixel, 0).vertices[0].hit
        assert hit is not None
        assert hit.mesh == name
        mesh = next(mesh for mesh in scene.meshes if mesh.name == name)
        a, b, c = mesh.vertices[mesh.faces[hit.triangle]]
        assert np.abs(a * (1 - hit.u - hit.v) + b * hit.u + c * hit.v - hit.position).max() < 1e-3


def test_a_pixel_or_sample_that_is_not_there_is_an_error() -> None:
    for place in ((12, 0, 0), (0, 12, 0), (-1, 0, 0), (0, 0, 2)):
        with pytest.raises(SettingsError, match="there is no"):
            wdpm.replay(cornell_box((12, 12)), *place, photons=100, spp=2)


def test_records_of_another_view_cannot_be_replayed(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--indirect", "cache", "--load-cache", "room.records", "--replay", "1,1,0"]
    assert main.main(["render", "cornell-box", "--size", "8x8", *options]) == 2
    assert "leave --load-cache out" in capsys.readouterr().err


def test_the_command_prints_each_vertex(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    few = ["--size", "8x8", "--photons", "500", "--spp", "2", "--threads", "1"]
    out = tmp_path / "image.exr"
    command = ["render", "cornell-box", *few, "-o", str(out), "--strict", "--replay", "4,6,1"]
    assert main.main([*command, "--report", str(tmp_path / "path.json")]) == 0
    text = capsys.readouterr().out
    for words in (
        "Vertex 0",
        "mesh",
        '"short block"',
        "seen from the front",
        "Sample 1 of pixel 4,6",
        "guards: none acted",
    ):
        assert words in text
    assert not out.exists()
    told = json.loads((tmp_path / "path.json").read_text())
    again = wdpm.replay(cornell_box((8, 8)), 4, 6, 1, photons=500, spp=2)
    assert told["value"] == again.value.tolist()
    assert told["vertices"][0]["hit"]["mesh"] == "short block"
    assert main.main([*command[:-1], "8,0,0"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error == "wdpm: error: there is no pixel 8,0 in an image of 8x8: expected 0,0 to 7,7"
