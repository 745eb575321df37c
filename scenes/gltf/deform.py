"""Meshes of glTF 2.0 that are deformed: by morph targets, then by the joints of a skin.

Format: Khronos Group, "glTF 2.0 Specification", sections 3.7.2.2 (morph targets) and 3.7.3 (skins).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.gltf.container import GltfFile
from wdpm.scenes.model.transforms import Matrix, normalized

Values = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Deformation:
    """How the mesh of a node is deformed.

    Attributes:
        weights: of its morph targets.
        joints: from the space of the mesh to the world by each joint of its skin, shape [J, 4, 4]; None without one.
    """

    weights: tuple[float, ...] = ()
    joints: Values | None = None


def deformation_of(
    gltf: GltfFile, node: dict[str, Any], mesh: dict[str, Any], places: Mapping[int, Matrix]
) -> Deformation:
    """What a node makes of its mesh.

    Args:
        node: with what animations make of it.
        places: where all nodes of the scene are.

    Raises:
        SceneError: broken.
    """
    weights = gltf.get(node, "weights", list, gltf.get(mesh, "weights", list, []))
    if not all(isinstance(each, int | float) and abs(each) < float("inf") for each in weights):
        raise gltf.error(f"broken glTF: weights of morph targets are {weights}"[:120])
    joints = _joints(gltf, node["skin"], places) if "skin" in node else None
    return Deformation(tuple(float(each) for each in weights), joints)


def _joints(gltf: GltfFile, index: Any, places: Mapping[int, Matrix]) -> Values:
    skin = gltf.item("skins", index)
    numbers = gltf.get(skin, "joints", list, [])
    lost = [number for number in numbers if not isinstance(number, int) or number not in places]
    if lost or not numbers:
        raise gltf.error(f"broken glTF: skins[{index}] has joints {lost or 'none'} that are not in the scene")
    world = np.array([places[number] for number in numbers])
    if "inverseBindMatrices" not in skin:
        return world
    inverse = gltf.converted(skin["inverseBindMatrices"], np.float64)
    if inverse.shape[1] != 16 or len(inverse) < len(numbers) or not np.isfinite(inverse).all():
        raise gltf.error(f"broken glTF: skins[{index}].inverseBindMatrices is no list of {len(numbers)} matrices")
    joints: Values = world @ inverse[: len(numbers)].reshape(-1, 4, 4).transpose(0, 2, 1)  # columns first
    return joints


def morphed(
    gltf: GltfFile, primitive: dict[str, Any], weights: tuple[float, ...], points: Values, normals: Values | None
) -> tuple[Values, Values | None]:
    """Positions and normals with the weighted differences of a primitive's morph targets."""
    targets = gltf.get(primitive, "targets", list, [])
    for target, weight in zip(targets, weights, strict=False):
        if not isinstance(target, dict):
            raise gltf.error("broken glTF: a morph target is not an object")
        if weight == 0.0:
            continue
        if "POSITION" in target:
            points = points + weight * _differences(gltf, target["POSITION"], len(points))
        if "NORMAL" in target and normals is not None:
            normals = normals + weight * _differences(gltf, target["NORMAL"], len(points))
    return points, normals if normals is None or not any(weights) else normalized(normals)


def _differences(gltf: GltfFile, accessor: Any, count: int) -> Values:
    values = gltf.converted(accessor, np.float64)
    if values.shape != (count, 3):
        raise gltf.error(f"broken glTF: a morph target has shape {values.shape}, expected ({count}, 3)")
    return values


def skinned(
    gltf: GltfFile, attributes: dict[str, Any], joints: Values, points: Values, normals: Values | None
) -> tuple[Values, Values | None, bool]:
    """Positions and normals in the world, and whether the joints mirror most of them.

    Weights are made to add up to 1; what has none follows the first joint.
    """
    blended = np.zeros((len(points), 3, 4))
    total = np.zeros((len(points), 1))
    for number in range(_sets(gltf, attributes)):
        chosen = gltf.converted(attributes[f"JOINTS_{number}"], np.int64)
        weights = gltf.converted(attributes[f"WEIGHTS_{number}"], np.float64)
        if chosen.shape != (len(points), 4) or weights.shape != (len(points), 4):
            raise gltf.error(f"broken glTF: JOINTS_{number} and WEIGHTS_{number} are not 4 for each vertex")
        if len(chosen) and not 0 <= chosen.min() <= chosen.max() < len(joints):
            raise gltf.error(f"broken glTF: JOINTS_{number} names a joint beyond the skin's {len(joints)}")
        for column in range(4):
            blended += weights[:, column, None, None] * joints[chosen[:, column], :3, :]
        total += weights.sum(axis=1, keepdims=True)
    alone = total[:, 0] <= 0.0
    blended[alone], total[alone] = joints[0, :3, :], 1.0
    blended /= total[:, :, None]
    moved = np.einsum("vij,vj->vi", blended[:, :, :3], points) + blended[:, :, 3]
    x, y, z = (blended[:, row, :3] for row in range(3))
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)
    sign = np.where(np.einsum("vi,vi->v", x, cofactors[:, 0]) < 0.0, -1.0, 1.0)[:, None]
    mirrors = bool(sign.mean() < 0.0) if len(sign) else False
    if normals is not None:
        normals = normalized(np.einsum("vij,vj->vi", cofactors, normals) * sign)
    return moved, normals, mirrors


def _sets(gltf: GltfFile, attributes: dict[str, Any]) -> int:
    """How many sets of four joints a vertex has."""
    count = 0
    while f"JOINTS_{count}" in attributes and f"WEIGHTS_{count}" in attributes:
        count += 1
    if count == 0:
        raise gltf.error("broken glTF: a mesh of a skin has no JOINTS_0 and WEIGHTS_0")
    return count
