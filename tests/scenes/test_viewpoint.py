"""Views that the command line asks for: from elsewhere, and a part of the image."""

from __future__ import annotations

import base64
import json
from argparse import ArgumentTypeError
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from furnaces import rendered
from hypothesis import given, settings
from hypothesis import strategies as st

from wdpm import values
from wdpm.scenes import PointLight, Scene, SceneError, cornell_box, load
from wdpm.scenes.meshes import interior
from wdpm.scenes.meshes.interior import free_ways
from wdpm.scenes.model.viewpoint import Viewpoint, cropped, seen_from


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0,1,5/0,0,0", Viewpoint((0, 1, 5), (0, 0, 0))),
        ("0,1,5/0,0,0/0,0,1", Viewpoint((0, 1, 5), (0, 0, 0), (0, 0, 1))),
        ("-1,1e2,.5/0,0,-2/40", Viewpoint((-1, 100, 0.5), (0, 0, -2), fov=40.0)),
        ("0,1,5/0,0,0/0,0,1/40.5", Viewpoint((0, 1, 5), (0, 0, 0), (0, 0, 1), 40.5)),
    ],
)
def test_a_camera_on_the_command_line(text: str, expected: Viewpoint) -> None:
    assert values.viewpoint(text) == expected
    assert values.viewpoint(values.viewpoint_text(expected)) == expected


@pytest.mark.parametrize(
    "text", ["", "0,1,5", "0,1/0,0,0", "0,1,5/0,0,0/180", "0,1,5/0,0,0/40/0,1,0", "a,b,c/0,0,0", "0,1,nan/0,0,0"]
)
def test_what_is_no_camera_is_told(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="is not a camera: expected FROM/AT"):
        values.viewpoint(text)


@pytest.mark.parametrize("name", ["Camera.001", "left, from above", "7", "cam", "e"])
def test_a_name_on_the_command_line(name: str) -> None:
    assert values.camera(name) == name


@pytest.mark.parametrize("text", ["0,1,5", "-1,2,3", "a/b", "1e3,0,0"])
def test_what_looks_like_points_is_no_name(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="is not a camera: expected FROM/AT"):
        values.camera(text)


def two_sensors(folder: Path) -> Path:
    sensors = "".join(
        f'<sensor type="perspective" {ident}><float name="fov" value="{fov}"/></sensor>'
        for ident, fov in (('id="wide"', 80), ("", 20))
    )
    file = folder / "scene.xml"
    file.write_text(f'<scene version="3.0.0">{sensors}<shape type="rectangle"/><emitter type="constant"/></scene>')
    return file


def two_cameras(folder: Path) -> Path:
    cameras = [{"type": "perspective", "perspective": {"yfov": fov, "znear": 0.1}} for fov in (1.0, 0.5)]
    nodes = [{"mesh": 0}, {"camera": 0, "name": "wide"}, {"camera": 1, "name": "tele"}]
    return square_with(folder, cameras=cameras, nodes=nodes, scenes=[{"nodes": [0, 1, 2]}])


def square_with(folder: Path, **more: Any) -> Path:
    """A glTF file with a unit square."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    data = {
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(corners)}],
        "buffers": [{"byteLength": len(corners), "uri": "data:;base64," + base64.b64encode(corners).decode()}],
    }
    file = folder / "scene.gltf"
    file.write_text(json.dumps({**data, **more}))
    return file


@pytest.mark.parametrize(("make", "second"), [(two_sensors, "sensor 2"), (two_cameras, "tele")])
def test_a_camera_by_its_name(tmp_path: Path, make: Callable[[Path], Path], second: str) -> None:
    file = make(tmp_path)
    first = load(file, size=(64, 64))
    assert any(f'"wide" is used; --camera NAME for "{second}"' in warning for warning in first.warnings)
    assert load(file, size=(64, 64), camera="wide").camera.fov_x == first.camera.fov_x
    other = load(file, size=(64, 64), camera=second)
    assert other.camera.fov_x < first.camera.fov_x
    assert f'--camera: it looks through "{second}"' in other.warnings
    with pytest.raises(SceneError, match=f'no camera of the name "left"; the file has "wide", "{second}"'):
        load(file, camera="left")
    with pytest.raises(SceneError, match="--frame inside: the file has a camera"):
        load(file, frame="inside")


@pytest.mark.parametrize("what", [{"camera": "left"}, {"frame": "inside"}])
def test_a_built_in_scene_has_one_camera(what: dict[str, str]) -> None:
    with pytest.raises(SceneError, match="cornell-box is built in and has one camera"):
        load("cornell-box", **what)


def test_a_bare_mesh_has_no_camera_of_a_name(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="the file has none"):
        load(box(tmp_path, inwards=False), camera="left")
    with pytest.raises(SceneError, match="must be one of inside, outside"):
        load(box(tmp_path, inwards=False), frame="above")


BOX = (4.0, 3.0, 10.0)


def box(folder: Path, inwards: bool) -> Path:
    """A closed box of 4 x 3 x 10 about the origin, whose fronts are inside or outside."""
    corners = [(x, y, z) for x in (-2, 2) for y in (-1.5, 1.5) for z in (-5, 5)]
    quads = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["f " + " ".join(map(str, reversed(quad) if inwards else quad)) for quad in quads]
    file = folder / "box.obj"
    file.write_text("\n".join(lines))
    return file


def is_inside(scene: Scene) -> bool:
    return bool((np.abs(scene.camera.to_world[:3, 3]) < np.array(BOX) / 2).all())


def test_a_closed_room_is_seen_from_inside_along_the_longest_way(tmp_path: Path) -> None:
    scene = load(box(tmp_path, inwards=True), size=(64, 48))
    assert is_inside(scene)
    assert abs(scene.camera.to_world[2, 2]) > 0.9
    assert isinstance(scene.lights[0], PointLight)
    assert any("seen from inside" in warning for warning in scene.warnings)
    outside = load(box(tmp_path, inwards=True), frame="outside")
    assert not is_inside(outside)
    assert any("two soft lamps" in warning for warning in outside.warnings)


def test_a_solid_box_is_seen_from_outside_unless_one_wants_in(tmp_path: Path) -> None:
    assert not is_inside(load(box(tmp_path, inwards=False)))
    assert is_inside(load(box(tmp_path, inwards=False), frame="inside"))


def test_nobody_looks_into_a_model_of_very_many_triangles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interior, "MOST_TRIANGLES", 11)
    assert not is_inside(load(box(tmp_path, inwards=True)))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_free_ways_end_where_mathematics_says(seed: int) -> None:
    """Against the intersection of a ray with each triangle's plane, in barycentric coordinates."""
    random = np.random.default_rng(seed)
    corners = random.normal(size=(20, 3, 3))
    ways = random.normal(size=(5, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origin = random.normal(size=3) * 0.2
    far, front = free_ways([corners[:7], corners[7:]], origin, ways)
    for way, distance, is_front in zip(ways, far, front, strict=True):
        met = []
        for a, b, c in corners:
            u, v, t = np.linalg.solve(np.stack([b - a, c - a, -way], axis=1), origin - a)
            if u >= 0 and v >= 0 and u + v <= 1 and t > 0:
                met.append((t, bool(np.cross(b - a, c - a) @ way < 0)))
        assert (distance, is_front) == (pytest.approx(min(met)[0]), min(met)[1]) if met else distance == np.inf


def test_the_scene_is_seen_from_there() -> None:
    scene = seen_from(cornell_box((8, 6)), Viewpoint((1, 2, 3), (1, 2, 10), fov=33.0))
    np.testing.assert_allclose(scene.camera.to_world[:3, 3], [1, 2, 3])
    np.testing.assert_allclose(scene.camera.to_world[:3, 2], [0, 0, 1])
    assert scene.camera.fov_x == 33.0
    assert scene.warnings[-1] == "--camera: it looks from 1 2 3 to 1 2 10, up 0 1 0, 33 degrees wide"


def test_views_that_cannot_be_are_errors() -> None:
    scene = cornell_box((8, 6))
    with pytest.raises(SceneError, match="--camera"):
        seen_from(scene, Viewpoint((1, 2, 3), (1, 2, 3)))
    parallel = replace(scene, camera=replace(scene.camera, orthographic=True))
    with pytest.raises(SceneError, match="no field of view"):
        seen_from(parallel, Viewpoint((1, 2, 3), (0, 0, 0), fov=30.0))
    for region in ((0, 0, 9, 6), (3, 2, 3, 4)):
        with pytest.raises(SceneError, match="beyond the image of 8x6"):
            cropped(scene, region)


def test_a_crop_is_cut_out_of_the_whole_image() -> None:
    scene = cornell_box((8, 6))
    chosen = {"spp": 2, "photons": 500}
    whole, part = rendered(scene, **chosen), rendered(cropped(scene, (2, 1, 7, 4)), **chosen)
    np.testing.assert_array_equal(part.layers["beauty"], whole.layers["beauty"][1:4, 2:7])
