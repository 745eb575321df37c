"""Creases: edges across which shading normals are not smoothed, found by the angle between faces."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.meshes.mesh_data import MeshData, VertexAttribute, merge_corners
from wdpm.scenes.model.transforms import normalized


def creased(mesh: MeshData, degrees: float) -> MeshData:
    """The mesh without its normals, with vertices of their own on either side of a crease; `smooth` makes new normals.

    As Mitsuba 0.6 does for `maxSmoothAngle` (TriMesh::rebuildTopology): the faces around a vertex, in their order in
    the file, are put together with the first that is left whose normal is off by less than the angle.

    Args:
        degrees: the largest angle between the normals of two faces that are smoothed over.
    """
    corners = mesh.faces.reshape(-1)
    place = _places(mesh, corners)
    points = mesh.vertices[mesh.faces]
    facing = normalized(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]))
    cluster = _clusters(place, np.repeat(facing, 3, axis=0), math.cos(math.radians(degrees)))
    first, corner_vertex = merge_corners(place, cluster)
    kept = corners[first]
    return replace(
        mesh,
        vertices=mesh.vertices[kept],
        faces=corner_vertex.reshape(-1, 3),
        normals=None,
        uvs=None if mesh.uvs is None else mesh.uvs[kept],
        attributes={
            name: VertexAttribute(attribute.values[kept], attribute.coded)
            for name, attribute in mesh.attributes.items()
        },
    )


def _places(mesh: MeshData, corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """For every corner a number that corners with the same position, texture coordinates and attributes share."""
    columns = [mesh.vertices, *([] if mesh.uvs is None else [mesh.uvs])]
    columns += [attribute.values for attribute in mesh.attributes.values()]
    _, place = np.unique(np.concatenate(columns, axis=1), axis=0, return_inverse=True)
    return place.reshape(-1)[corners].astype(np.int64)


def _clusters(place: NDArray[np.int64], facing: NDArray[np.float64], least: float) -> NDArray[np.int64]:
    """For every corner the first corner of its place that its face is smoothed with.

    Args:
        facing: the normal of each corner's face, shape [N, 3].
        least: cosine of the largest angle.
    """
    cluster = np.full(len(place), -1, dtype=np.int64)
    left = np.arange(len(place))
    while len(left):
        _, first, group = np.unique(place[left], return_index=True, return_inverse=True)
        seed = left[first][group.reshape(-1)]
        joined = (np.sum(facing[left] * facing[seed], axis=1) > least) | (facing[left] == facing[seed]).all(axis=1)
        cluster[left[joined]] = seed[joined]
        left = left[~joined]  # fewer each time: the first corner of a place joins itself
    return cluster
