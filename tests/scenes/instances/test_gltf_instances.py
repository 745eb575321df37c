"""glTF meshes that stand in several places: nodes that share one, and EXT_mesh_gpu_instancing."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wdpm.scenes.errors import SceneError
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Instance, Scene

POSITIONS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
PLACES = np.array([[2, 0, 0], [0, 3, 0], [0, 0, 4]], "<f4")
TURNS = np.array([[0, 0, 0, 32767], [0, 0, 23170, 23170], [0, 0, 0, 32767]], "<i2")
SIZES = np.array([[1, 1, 1], [2, 2, 2], [-1, 1, 1]], "<f4")
INDICES = np.array([0, 1, 2, 0, 2, 3], "<u2")


def document(nodes: list[dict[str, Any]], **changes: Any) -> dict[str, Any]:
    arrays = (POSITIONS, INDICES, PLACES, TURNS, SIZES)
    kinds = ((5126, "VEC3"), (5123, "SCALAR"), (5126, "VEC3"), (5122, "VEC4"), (5126, "VEC3"))
    views, accessors, start = [], [], 0
    for number, (values, (component, kind)) in enumerate(zip(arrays, kinds, strict=True)):
        views.append({"buffer": 0, "byteOffset": start, "byteLength": values.nbytes})
        accessor = {"bufferView": number, "componentType": component, "count": len(values), "type": kind}
        accessors.append(accessor | ({"normalized": True} if component == 5122 else {}))
        start += values.nbytes
    blob = b"".join(values.tobytes() for values in arrays)
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "scene": 0,
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(blob), "uri": "data:;base64," + base64.b64encode(blob).decode()}],
        **changes,
    }


def read(folder: Path, nodes: list[dict[str, Any]], **changes: Any) -> Scene:
    file = folder / "m.gltf"
    file.write_text(json.dumps(document(nodes, **changes)))
    return load(file)


def instancing(**attributes: int) -> dict[str, Any]:
    return {"EXT_mesh_gpu_instancing": {"attributes": attributes}}


def instances(scene: Scene) -> list[Instance]:
    return [mesh for mesh in scene.meshes if isinstance(mesh, Instance)]


def test_nodes_that_share_a_mesh_share_its_shape(tmp_path: Path) -> None:
    scene = read(tmp_path, [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 5]}, {"mesh": 0, "scale": [-1, 1, 1]}])
    first, second, third = instances(scene)
    assert first.shape is second.shape is third.shape
    np.testing.assert_array_equal(second.vertices, POSITIONS + np.array((0, 0, 5)))
    np.testing.assert_array_equal(third.faces, first.faces[:, ::-1])  # a mirrored mesh keeps its front


def test_a_mesh_of_one_node_is_a_mesh(tmp_path: Path) -> None:
    assert not instances(read(tmp_path, [{"mesh": 0}]))


def test_a_node_that_flattens_a_shared_mesh_has_a_copy(tmp_path: Path) -> None:
    scene = read(tmp_path, [{"mesh": 0}, {"mesh": 0, "scale": [1, 1, 0]}])
    assert len(instances(scene)) == 1
    np.testing.assert_array_equal(scene.meshes[1].vertices, POSITIONS)


def test_places_of_the_extension(tmp_path: Path) -> None:
    node = {"mesh": 0, "translation": [10, 0, 0], "extensions": instancing(TRANSLATION=2, ROTATION=3, SCALE=4)}
    scene = read(tmp_path, [node], extensionsRequired=["EXT_mesh_gpu_instancing"])
    first, second, third = instances(scene)
    np.testing.assert_allclose(first.vertices, POSITIONS + np.array((12, 0, 0)))
    turned = np.stack([-POSITIONS[:, 1], POSITIONS[:, 0], POSITIONS[:, 2]], axis=1)
    np.testing.assert_allclose(second.vertices, 2 * turned + (10, 3, 0), atol=1e-4)
    np.testing.assert_allclose(third.vertices, POSITIONS * (-1, 1, 1) + (10, 0, 4))


@pytest.mark.parametrize(
    ("attributes", "words"),
    [
        ({}, "its attributes have [] entries"),
        ({"TRANSLATION": 2, "SCALE": 0}, "its attributes have [3, 4] entries"),
        ({"TRANSLATION": 3}, "TRANSLATION is not a list of 3 finite numbers each"),
    ],
)
def test_broken_places_are_one_line(tmp_path: Path, attributes: dict[str, int], words: str) -> None:
    with pytest.raises(SceneError) as raised:
        read(tmp_path, [{"mesh": 0, "extensions": instancing(**attributes)}])
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)
