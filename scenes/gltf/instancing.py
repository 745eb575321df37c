"""glTF's EXT_mesh_gpu_instancing: a node's mesh in many places.

Format: Khronos Group, "EXT_mesh_gpu_instancing". Attributes besides place, rotation and scale belong to applications.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.gltf.container import GltfFile
from wdpm.scenes.model.transforms import Matrix

INSTANCING = "EXT_mesh_gpu_instancing"

_ATTRIBUTES = {"TRANSLATION": 3, "ROTATION": 4, "SCALE": 3}


def places_of(gltf: GltfFile, node: dict[str, Any], name: str, to_world: Matrix) -> list[Matrix] | None:
    """Where a node's mesh stands, if the node says so by the extension; None where it does not.

    Raises:
        SceneError: broken.
    """
    extensions = gltf.get(node, "extensions", dict, {})
    if INSTANCING not in extensions:
        return None
    given = gltf.get(gltf.get(extensions, INSTANCING, dict, {}), "attributes", dict, {})
    values = {}
    for key, width in _ATTRIBUTES.items():
        if key in given:
            values[key] = gltf.accessor(given[key]).astype(np.float64)
            if values[key].ndim != 2 or values[key].shape[1] != width or not np.isfinite(values[key]).all():
                raise gltf.error(f'node "{name}": {INSTANCING}: {key} is not a list of {width} finite numbers each')
    lengths = {len(each) for each in values.values()}
    if len(lengths) != 1:
        raise gltf.error(
            f'node "{name}": {INSTANCING}: its attributes have {sorted(lengths)} entries; expected one count'
        )
    count = lengths.pop()
    matrices = np.tile(np.eye(4), (count, 1, 1))
    if "ROTATION" in values:
        length = np.linalg.norm(values["ROTATION"], axis=1, keepdims=True)
        if not (length > 0).all():
            raise gltf.error(f'node "{name}": {INSTANCING}: a ROTATION is zero')
        matrices[:, :3, :3] = rotations(values["ROTATION"] / length)
    if "SCALE" in values:
        matrices[:, :3, :3] *= values["SCALE"][:, None, :]
    if "TRANSLATION" in values:
        matrices[:, :3, 3] = values["TRANSLATION"]
    return [to_world @ matrix for matrix in matrices]


def rotations(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrices of unit quaternions, shape [N, 4]; shape [N, 3, 3]."""
    x, y, z, w = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)
