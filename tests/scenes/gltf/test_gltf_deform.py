"""Skins, morph targets and hidden nodes of glTF files, against the specification's formulas, written down anew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_squares import CORNERS, PUNCTUAL, Square, Wide, node_matrix, upwards

from wdpm.scenes import SceneError, load

NORMALS = np.tile(np.array([[0, 0, 1]], "<f4"), (4, 1))


def turned(angle: float, scale: float, offset: Any) -> Wide:
    """About x."""
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    matrix[:3, 3] = offset
    return matrix


ARM, HAND = turned(0.4, 2.0, (1.0, 2.0, 3.0)), turned(-0.9, 1.0, (0.0, 0.5, 0.0))
BINDS = np.array([np.linalg.inv(turned(0.2, 1.0, (0.0, 1.0, 0.0))), turned(0.0, 1.0, (0.1, 0.2, 0.3))])
CHOSEN = np.array([[0, 1, 0, 0], [1, 0, 0, 0], [1, 0, 1, 0], [0, 0, 0, 0]], "<u2")
WEIGHTS = np.array([[1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.25, 0.5, 0.25, 0.0], [0.0, 0.0, 0.0, 1.0]], "<f4")
SHARES = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5], [1.0, 0.0]])
"""Of both joints in each vertex."""


def skinned(**changes: Any) -> Square:
    square = Square()
    square.attribute("NORMAL", NORMALS)
    square.attribute("JOINTS_0", CHOSEN)
    square.attribute("WEIGHTS_0", WEIGHTS)
    binds = square.add(BINDS.transpose(0, 2, 1).reshape(-1, 16).astype("<f4"))
    square.document["skins"] = [{"joints": [1, 2], "inverseBindMatrices": binds} | changes]
    square.document["nodes"] = [
        {"mesh": 0, "skin": 0, "translation": [100.0, 0.0, 0.0]},
        {"matrix": node_matrix(ARM), "children": [2]},
        {"matrix": node_matrix(HAND)},
    ]
    square.document["scenes"] = [{"nodes": [0, 1]}]
    return square


def test_a_skin_follows_its_joints_and_not_its_own_node(tmp_path: Path) -> None:
    """Specification, 3.7.3.3: a weighted sum of the joints' places after the inverse bind matrices."""
    mesh = load(skinned().written(tmp_path)).meshes[0]
    joints = np.array([ARM @ BINDS[0], ARM @ HAND @ BINDS[1]])
    for vertex, shares in enumerate(SHARES):
        matrix = np.tensordot(shares, joints, axes=1)
        np.testing.assert_allclose(mesh.vertices[vertex], (matrix @ [*CORNERS[vertex], 1.0])[:3], atol=1e-5)
        assert mesh.normals is not None
        normal = np.linalg.inv(matrix[:3, :3]).T @ NORMALS[vertex]
        np.testing.assert_allclose(mesh.normals[vertex], normal / np.linalg.norm(normal), atol=1e-5)


@pytest.mark.parametrize("normals", [False, True])
def test_the_front_of_a_skin_stays_the_front_where_joints_mirror(normals: bool, tmp_path: Path) -> None:
    square = Square({"emissiveFactor": [1.0, 1.0, 1.0]})
    if normals:
        square.attribute("NORMAL", NORMALS)
    square.attribute("JOINTS_0", np.zeros((4, 4), "|u1"))
    square.attribute("WEIGHTS_0", np.tile(np.array([[1, 0, 0, 0]], "<f4"), (4, 1)))
    square.document["skins"] = [{"joints": [1]}]
    square.document["nodes"] = [{"mesh": 0, "skin": 0}, {"scale": [-1.0, 1.0, 1.0]}]
    assert square.seen(tmp_path, upwards(10.0)).min() > 0.9
    assert square.seen(tmp_path, -upwards(10.0)).max() == 0.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joints": [1, 7]}, r"has joints \[7\] that are not in the scene"),
        ({"joints": []}, "joints none"),
        ({"joints": [1]}, "names a joint beyond the skin's 1"),
        ({"joints": [1, 2, 1]}, "no list of 3 matrices"),
    ],
)
def test_broken_skins(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=message):
        load(skinned(**changes).written(tmp_path))


@pytest.mark.parametrize("owner", ["mesh", "node"])
def test_morph_targets_are_added_by_their_weights(owner: str, tmp_path: Path) -> None:
    """Specification, 3.7.2.2; the weights of a node go before those of its mesh."""
    square = Square()
    square.attribute("NORMAL", NORMALS)
    first, second = (np.random.default_rng(seed).normal(size=(4, 3)).astype("<f4") for seed in (1, 2))
    square.primitive["targets"] = [{"POSITION": square.add(first)}, {"NORMAL": square.add(second)}]
    square.document["meshes"][0]["weights"] = [0.5, 0.25] if owner == "mesh" else [9.0, 9.0]
    if owner == "node":
        square.document["nodes"][0]["weights"] = [0.5, 0.25]
    mesh = load(square.written(tmp_path)).meshes[0]
    np.testing.assert_allclose(mesh.vertices, CORNERS + 0.5 * first, rtol=1e-6)
    normals = NORMALS + 0.25 * second
    np.testing.assert_allclose(mesh.normals, normals / np.linalg.norm(normals, axis=1, keepdims=True), rtol=1e-5)


def test_nodes_that_share_a_mesh_have_weights_of_their_own(tmp_path: Path) -> None:
    square = Square()
    square.primitive["targets"] = [{"POSITION": square.add(np.ones((4, 3), "<f4"))}]
    square.document["nodes"] = [{"mesh": 0, "weights": [each]} for each in (0.0, 1.0)]
    first, second, *_ = load(square.written(tmp_path)).meshes
    np.testing.assert_array_equal(second.vertices, first.vertices + 1.0)


def test_what_a_hidden_node_holds_is_not_seen(tmp_path: Path) -> None:
    """KHR_node_visibility: with all below it, lights too, but no cameras."""
    square = Square()
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    square.lit(upwards(0.0))
    lamp = square.document["nodes"].pop()
    lamp["extensions"] |= {"KHR_node_visibility": {"visible": True}}
    lens = {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}
    square.document |= {"cameras": [lens], "extensionsRequired": ["KHR_node_visibility", PUNCTUAL]}
    below = [{"mesh": 0}, lamp, {"camera": 0, "translation": [1.0, 2.0, 3.0]}]
    square.document["nodes"] = [{"mesh": 0, "name": "shown"}, {"children": [2, 3, 4]} | hidden, *below]
    scene = load(square.written(tmp_path))
    assert [mesh.name for mesh in scene.meshes] == ["shown"]
    np.testing.assert_array_equal(scene.camera.to_world[:3, 3], [1.0, 2.0, 3.0])
    assert any("no lights" in warning for warning in scene.warnings)


@pytest.mark.parametrize("double", [False, True])
def test_what_has_two_sides_glows_from_both(double: bool, tmp_path: Path) -> None:
    square = Square({"emissiveFactor": [1.0, 0.5, 0.25], "doubleSided": double})
    np.testing.assert_allclose(square.seen(tmp_path, upwards(10.0)).mean(axis=(0, 1)), [1.0, 0.5, 0.25], rtol=1e-5)
    behind = square.seen(tmp_path, -upwards(10.0)).mean(axis=(0, 1))
    np.testing.assert_allclose(behind, np.array([1.0, 0.5, 0.25]) * double, rtol=1e-5)


def test_nobody_sees_the_inside_of_a_closed_lamp(tmp_path: Path) -> None:
    square = Square({"emissiveFactor": [1.0, 1.0, 1.0], "doubleSided": True})
    a, b, c, tip = CORNERS[0], CORNERS[1], CORNERS[2], np.array([0.0, 0.0, 2.0])
    corners = np.concatenate([[a, c, b], [a, b, tip], [b, c, tip], [c, a, tip]]).astype("<f4")
    square.primitive["attributes"] = {"POSITION": square.add(corners)}
    square.primitive["indices"] = square.add(np.arange(12).astype("<u4"))
    glowing = [mesh for mesh in load(square.written(tmp_path)).meshes if mesh.emission is not None]
    assert len(glowing) == 1
