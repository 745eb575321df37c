"""The nodes of a glTF 2.0 file's default scene: where they are, and which of them are seen.

Format: Khronos Group, "glTF 2.0 Specification", section 3.5, and the extension KHR_node_visibility.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from wdpm.scenes.gltf.animation import Poses
from wdpm.scenes.gltf.container import GltfFile
from wdpm.scenes.gltf.instancing import rotations
from wdpm.scenes.model.transforms import Matrix

VISIBILITY: Final = "KHR_node_visibility"


@dataclass(frozen=True, eq=False)
class Node:
    """A node, posed.

    Attributes:
        index: in the file.
        values: its JSON, with what animations make of it.
        visible: whether neither it nor a node above is hidden; cameras there are used all the same.
    """

    index: int
    name: str
    values: dict[str, Any]
    to_world: Matrix
    visible: bool


def nodes_of(gltf: GltfFile, poses: Poses) -> Iterator[Node]:
    """All nodes of the default scene, each after the one above it.

    Raises:
        SceneError: broken.
    """
    stack: list[tuple[Any, Matrix, bool]] = [(root, np.eye(4), True) for root in reversed(_roots(gltf))]
    visited: set[int] = set()
    while stack:
        index, parent, shown = stack.pop()
        node = gltf.item("nodes", index)
        if index in visited:
            raise gltf.error(f"broken glTF: nodes[{index}] has two parents or is its own ancestor")
        visited.add(index)
        values = poses.posed(node, index)
        to_world = parent @ _local(gltf, values, index)
        extension = gltf.get(gltf.get(node, "extensions", dict, {}), VISIBILITY, dict, {})
        visible = shown and gltf.get(extension, "visible", bool, True)
        yield Node(index, gltf.get(node, "name", str, f"node {index}"), values, to_world, visible)
        children = gltf.get(node, "children", list, [])
        stack.extend((child, to_world, visible) for child in reversed(children))


def _roots(gltf: GltfFile) -> list[Any]:
    if gltf.count("scenes"):
        return list(gltf.get(gltf.item("scenes", gltf.json.get("scene", 0)), "nodes", list, []))
    nodes = [gltf.item("nodes", index) for index in range(gltf.count("nodes"))]
    children = {child for node in nodes for child in gltf.get(node, "children", list, []) if isinstance(child, int)}
    return [index for index in range(len(nodes)) if index not in children]


def _local(gltf: GltfFile, node: dict[str, Any], index: Any) -> Matrix:
    if "matrix" in node:
        matrix = np.array(gltf.numbers(node, "matrix", [0.0] * 16)).reshape(4, 4).T  # columns first
        if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
            raise gltf.error(f"broken glTF: nodes[{index}].matrix is not affine")
        return matrix
    x, y, z, w = gltf.numbers(node, "rotation", [0.0, 0.0, 0.0, 1.0])
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not length > 0:
        raise gltf.error(f"broken glTF: nodes[{index}].rotation is zero")
    matrix = np.eye(4)
    matrix[:3, :3] = rotations(np.array([[x, y, z, w]]) / length)[0]
    matrix[:3, :3] *= np.array(gltf.numbers(node, "scale", [1.0, 1.0, 1.0]))
    matrix[:3, 3] = gltf.numbers(node, "translation", [0.0, 0.0, 0.0])
    return matrix
