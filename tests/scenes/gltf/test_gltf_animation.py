"""Animations of glTF files, against closed formulas."""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wdpm.scenes import SceneError, load

KEYS = [1.0, 2.0, 4.0]
HALF = math.sqrt(0.5)


def animated(
    folder: Path,
    path: str,
    values: list[list[float]],
    how: str | None = None,
    keys: list[float] = KEYS,
    **changes: Any,
) -> Path:
    """A triangle with a corner at (1, 0, 0), whose node is driven."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    arrays = [corners, np.array(keys, "<f4")[:, None], np.array(values, "<f4")]
    types = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
    views, accessors, blob = [], [], b""
    for number, array in enumerate(arrays):
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes})
        kind = types[array.shape[1]]
        accessors.append({"bufferView": number, "componentType": 5126, "count": len(array), "type": kind})
        blob += array.tobytes()
    sampler: dict[str, Any] = {"input": 1, "output": 2} | ({} if how is None else {"interpolation": how})
    channel = {"sampler": 0, "target": {"node": 0, "path": path}}
    document = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(blob), "uri": "data:;base64," + base64.b64encode(blob).decode()}],
        "animations": [{"name": "spin", "samplers": [sampler], "channels": [channel]}],
        **changes,
    }
    file = folder / "moving.gltf"
    file.write_text(json.dumps(document))
    return file


def corner(file: Path, time: float | None) -> list[float]:
    """Where the corner at (1, 0, 0) is."""
    return [float(axis) for axis in load(file, time=time).meshes[0].vertices[1]]


def about_z(angle: float) -> list[float]:
    return [0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2)]


@pytest.mark.parametrize(
    ("time", "x"), [(0.0, 0.0), (1.0, 0.0), (1.25, 0.5), (2.0, 2.0), (3.0, 5.0), (4.0, 8.0), (99.0, 8.0)]
)
def test_translations_go_straight_from_key_to_key_and_stay_at_the_ends(tmp_path: Path, time: float, x: float) -> None:
    file = animated(tmp_path, "translation", [[0, 0, 0], [2, 0, 0], [8, 0, 0]])
    assert corner(file, time) == pytest.approx([1 + x, 0, 0])


@pytest.mark.parametrize(("time", "scale"), [(0.5, 1), (1.99, 1), (2.0, 3), (3.99, 3), (4.0, 5)])
def test_steps_hold_until_the_next_key(tmp_path: Path, time: float, scale: float) -> None:
    file = animated(tmp_path, "scale", [[1] * 3, [3] * 3, [5] * 3], "STEP")
    assert corner(file, time) == pytest.approx([scale, 0, 0])


@pytest.mark.parametrize("sign", [1, -1])
def test_rotations_turn_evenly_by_the_shorter_way(tmp_path: Path, sign: int) -> None:
    values = [about_z(0.0), [sign * part for part in about_z(1.2)], about_z(1.2)]
    for time in (1.0, 1.3, 1.9, 3.0):
        angle = 1.2 * min(time - 1.0, 1.0)
        found = corner(animated(tmp_path, "rotation", values, "LINEAR"), time)
        assert found == pytest.approx([math.cos(angle), math.sin(angle), 0], abs=1e-6)


def test_cubic_splines_follow_a_cubic(tmp_path: Path) -> None:
    """x = t³, with its derivative as tangents, is met between keys as well."""
    values = []
    for key in KEYS:
        tangent = [3 * key**2, 0.0, 0.0]
        values += [tangent, [key**3, 0.0, 0.0], tangent]
    file = animated(tmp_path, "translation", values, "CUBICSPLINE")
    for time in (1.0, 1.4, 2.0, 2.5, 3.7, 4.0):
        assert corner(file, time)[0] == pytest.approx(1 + time**3, rel=1e-5)


def test_a_single_key_holds_always(tmp_path: Path) -> None:
    file = animated(tmp_path, "translation", [[3, 0, 0]], keys=[2.0])
    assert [corner(file, time)[0] for time in (0.0, 2.0, 5.0)] == [4.0] * 3


def test_without_a_time_nothing_is_animated(tmp_path: Path) -> None:
    file = animated(tmp_path, "translation", [[5, 0, 0]] * 3)
    scene = load(file)
    assert scene.meshes[0].vertices[1, 0] == 1.0
    assert any("--frames A..B" in warning for warning in scene.warnings)


def test_what_is_driven_twice_is_told_and_the_first_holds(tmp_path: Path) -> None:
    file = animated(tmp_path, "translation", [[5, 0, 0]] * 3)
    document = json.loads(file.read_text())
    document["animations"] *= 2
    file.write_text(json.dumps(document))
    scene = load(file, time=1.0)
    assert scene.meshes[0].vertices[1, 0] == 6.0
    assert any("is driven by another animation already" in warning for warning in scene.warnings)


@pytest.mark.parametrize(("time", "x"), [(0.0, 2.0), (1.5, 3.0), (2.0, 4.0), (3.0, 7.0), (9.0, 10.0)])
def test_weights_of_morph_targets_move_vertices(tmp_path: Path, time: float, x: float) -> None:
    """Two targets, each moving the corner by as much as it is away from the origin: keys have two weights each."""
    weights = [[0.5], [0.5], [1.0], [2.0], [4.0], [5.0]]
    targets = [{"POSITION": 0}] * 2
    file = animated(
        tmp_path, "weights", weights, meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "targets": targets}]}]
    )
    assert corner(file, time) == pytest.approx([x, 0, 0])


def test_what_a_pointer_drives_is_left_out_with_a_word(tmp_path: Path) -> None:
    scene = load(animated(tmp_path, "pointer", [[5, 0, 0]] * 3), time=1.0)
    assert any('what drives "pointer" is ignored' in warning for warning in scene.warnings)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"how": "SPLINE"}, 'interpolation "SPLINE"; expected LINEAR, STEP, CUBICSPLINE'),
        ({"how": "CUBICSPLINE"}, r"expected \(9, 3\) values"),
        ({"keys": [1.0, 1.0, 2.0]}, "at times that grow"),
        ({"keys": [1.0, 2.0]}, r"expected \(2, 3\) values"),
        ({"keys": [1.0, 2.0, math.nan]}, "finite values"),
        ({"nodes": [{"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}]}, "but has a matrix"),
        ({"animations": [{"samplers": [], "channels": [3]}]}, "a channel is not an object"),
        (
            {"animations": [{"samplers": [], "channels": [{"sampler": 0, "target": {"node": 0, "path": "scale"}}]}]},
            r"there is no samplers\[0\]",
        ),
        (
            {"animations": [{"samplers": [{}], "channels": [{"sampler": 0, "target": {"node": 9, "path": "scale"}}]}]},
            r"there is no nodes\[9\]",
        ),
    ],
)
def test_broken_animations_are_one_line(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    file = animated(tmp_path, "translation", [[0, 0, 0]] * 3, **changes)
    with pytest.raises(SceneError, match=message) as error:
        load(file, time=1.5)
    assert "\n" not in str(error.value)


def test_a_rotation_of_zero(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="a rotation is zero"):
        load(animated(tmp_path, "rotation", [[0, 0, 0, 0]] * 3), time=0.0)


def test_only_gltf_moves(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="stands still"):
        load("cornell-box", time=1.0)
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3")
    with pytest.raises(SceneError, match=r"a.obj: only glTF files are animated"):
        load(tmp_path / "a.obj", time=1.0)
