"""The box that holds a scene's triangles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.model.scene import Mesh


def bounding_box(meshes: Sequence[Mesh]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest coordinates of the finite vertices that faces use, each of shape [3].

    Raises:
        SceneError: there are no triangles.
    """
    used = [_used_vertices(mesh) for mesh in meshes]
    used = [vertices for vertices in used if len(vertices)]
    if not used:
        raise SceneError("the scene is empty: it has no triangles")
    return np.min([v.min(axis=0) for v in used], axis=0), np.max([v.max(axis=0) for v in used], axis=0)


def _used_vertices(mesh: Mesh) -> NDArray[np.float64]:
    in_use = np.zeros(len(mesh.vertices), dtype=np.bool_)
    in_use[mesh.faces[(mesh.faces >= 0) & (mesh.faces < len(mesh.vertices))]] = True
    return mesh.vertices[in_use & np.isfinite(mesh.vertices).all(axis=1)]
