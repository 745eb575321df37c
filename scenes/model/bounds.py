"""The box that holds a scene's triangles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.model.scene import Instance, Mesh, Solid
from wdpm.scenes.model.transforms import placed

Box = NDArray[np.float64]
"""Coordinates, or many of them."""


def bounding_box(meshes: Sequence[Solid]) -> tuple[Box, Box]:
    """Lowest and highest coordinates of the finite vertices that faces use, each of shape [3].

    Raises:
        SceneError: there are no triangles.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    shapes: dict[int, Box] = {}
    own: dict[int, tuple[Box, Box]] = {}
    instances: list[tuple[Box, Box, Instance]] = []
    for mesh in meshes:
        if isinstance(mesh, Instance):
            if id(mesh.shape) not in shapes:
                shapes[id(mesh.shape)] = used = _used_vertices(mesh.shape)
                if len(used):
                    own[id(mesh.shape)] = used.min(axis=0), used.max(axis=0)
            if id(mesh.shape) in own:
                instances.append((*_outer_box(mesh.to_world, *own[id(mesh.shape)]), mesh))
        elif len(used := _used_vertices(mesh)):
            low, high = np.minimum(low, used.min(axis=0)), np.maximum(high, used.max(axis=0))
    low = _lowest(low, [(box_low, 1.0, mesh) for box_low, _, mesh in instances], shapes)
    high = -_lowest(-high, [(-box_high, -1.0, mesh) for _, box_high, mesh in instances], shapes)
    if not (low <= high).all():
        raise SceneError("the scene is empty: it has no triangles")
    return low, high


def boxes_around(meshes: Sequence[Solid]) -> list[tuple[Box, Box] | None]:
    """A box around each mesh, as bounding_box says; None of one without triangles.

    That of an instance holds it, and may be larger: there may be very many of a shape, which is looked at once.
    """
    own: dict[int, tuple[Box, Box] | None] = {}

    def box_of(mesh: Mesh) -> tuple[Box, Box] | None:
        used = _used_vertices(mesh)
        return (used.min(axis=0), used.max(axis=0)) if len(used) else None

    found: list[tuple[Box, Box] | None] = []
    for mesh in meshes:
        if not isinstance(mesh, Instance):
            found.append(box_of(mesh))
            continue
        if id(mesh.shape) not in own:
            own[id(mesh.shape)] = box_of(mesh.shape)
        box = own[id(mesh.shape)]
        found.append(None if box is None else _outer_box(mesh.to_world, *box))
    return found


def _lowest(low: Box, instances: list[tuple[Box, float, Instance]], shapes: dict[int, Box]) -> Box:
    """The lowest coordinates of instances, or `low`: only those are looked at in full whose boxes reach that far.

    Args:
        instances: the least that coordinates times the sign can be, the sign, and the instance.
    """
    low = low.copy()
    for axis in range(3):
        for least, sign, mesh in sorted(instances, key=lambda entry: float(entry[0][axis])):
            if least[axis] >= low[axis]:
                break
            row = mesh.to_world[axis : axis + 1].repeat(3, axis=0)
            low[axis] = min(low[axis], float((sign * placed(row, shapes[id(mesh.shape)])[:, 0]).min()))
    return low


def _outer_box(to_world: NDArray[np.float64], low: Box, high: Box) -> tuple[Box, Box]:
    """A box that certainly holds what is placed of another, grown by more than roundings."""
    size = np.abs(to_world[:3, :3]) @ np.maximum(np.abs(low), np.abs(high)) + np.abs(to_world[:3, 3])
    middle = to_world[:3, :3] @ ((low + high) / 2.0) + to_world[:3, 3]
    reach = np.abs(to_world[:3, :3]) @ ((high - low) / 2.0) + 1e-12 * size
    return middle - reach, middle + reach


def _used_vertices(mesh: Mesh) -> NDArray[np.float64]:
    faces = mesh.faces
    if faces.size and not (faces.min() >= 0 and faces.max() < len(mesh.vertices)):
        faces = faces[(faces >= 0) & (faces < len(mesh.vertices))]
    in_use = np.zeros(len(mesh.vertices), dtype=np.bool_)
    in_use[faces] = True
    if in_use.all() and are_finite(mesh.vertices):
        return mesh.vertices
    return mesh.vertices[in_use & np.isfinite(mesh.vertices).all(axis=1)]


def are_finite(values: NDArray[np.floating]) -> bool:
    """Whether all are finite, without an array of answers."""
    return not values.size or bool(np.isfinite(values.min()) and np.isfinite(values.max()))
