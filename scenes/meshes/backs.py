"""Backs of surfaces that glow to both sides: ours glow to their front only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.model.scene import Mesh
from wdpm.scenes.model.transforms import normalized

BACK_OFFSET = 1e-4
"""Between the two sides of an open surface that glows, as a share of its size."""


def is_closed(faces: NDArray[np.int64]) -> bool:
    """Whether each edge joins two faces, so that nobody sees the back.

    Args:
        faces: shape [F, 3], of vertices that faces share.
    """
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return bool((counts == 2).all())


def back_of(mesh: Mesh) -> Mesh:
    """The same surface seen from behind, a little behind it."""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(mesh.vertices)
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], across)
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    return replace(
        mesh,
        vertices=mesh.vertices - normalized(normals) * (BACK_OFFSET * size),
        faces=np.ascontiguousarray(mesh.faces[:, ::-1]),
        normals=None if mesh.normals is None else -mesh.normals,
    )


def are_closed(meshes: list[Mesh]) -> bool:
    """Whether meshes are so together, by the places of their vertices."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first, strict=False)])
    _, place = np.unique(np.concatenate([mesh.vertices for mesh in meshes]), axis=0, return_inverse=True)
    return is_closed(place.reshape(-1)[faces])
