"""The triangles of a cell: where they are, and what is said of them. Functions for scenes without instances."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.constants import OFFSET_MIN_SHARE
from wdpm.kernels.rays.instances import DeviceInstances, front_of_corners, upload_instances
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.room import let_go

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Surfaces:
    """The triangles of a cell, sorted by global number, then those of shapes that stand in it.

    Attributes:
        count: those with arrays of their own; of shapes, only what does not depend on where they stand is held here, in
            the rows that follow: smooth, uvs, colors, material, emitter.
        front: unit geometric normal of each triangle's front.
        smooth: 1 where there are normals to interpolate.
        normals: zero where flat.
        colored: 1 where there are vertex colours.
        offset_min: least distance at which rays leave a surface.
        instances: instances of the shapes.
    """

    count: wp.int32
    ids: wp.array[wp.int32]
    corners: wp.array2d[wp.vec3]
    front: wp.array[wp.vec3]
    smooth: wp.array[wp.int32]
    normals: wp.array2d[wp.vec3]
    uvs: wp.array2d[wp.vec2]
    colored: wp.int32
    colors: wp.array2d[wp.vec3]
    material: wp.array[wp.int32]
    emitter: wp.array[wp.int32]
    offset_min: wp.float32
    instances: DeviceInstances


def upload(triangles: Triangles, extent: float, device: str, instances: Any = None) -> Surfaces:
    """A cell's triangles on a device.

    Args:
        instances: its instances (rays.instances.DeviceInstances), if they are there already.
    """
    shapes = triangles.instances.shapes
    surfaces = Surfaces()
    surfaces.count = len(triangles)
    surfaces.ids = shared(triangles.ids, wp.int32, device)
    surfaces.corners = shared(triangles.positions, wp.vec3, device)
    front, smooth = front_normals(triangles)
    surfaces.front = shared(front, wp.vec3, device)
    smooth = _joined(smooth, smooth_of(shapes.normals))
    surfaces.smooth = shared(smooth, wp.int32, device)
    surfaces.normals = shared(triangles.normals, wp.vec3, device)
    surfaces.uvs = shared(_joined(triangles.uvs, shapes.uvs), wp.vec2, device)
    colors = _joined(triangles.colors.reshape(-1, 3, 3), shapes.colors)
    surfaces.colored = int(len(colors) > 0)
    surfaces.colors = shared(colors, wp.vec3, device)
    material = _joined(triangles.material, shapes.material)
    surfaces.material = shared(material, wp.int32, device)
    emitter = _joined(triangles.emitter, np.full(len(shapes.material), -1, np.int32))
    surfaces.emitter = shared(emitter, wp.int32, device)
    surfaces.offset_min = float(extent) * OFFSET_MIN_SHARE
    surfaces.instances = upload_instances(triangles.instances, device) if instances is None else instances
    return surfaces


def shared(values: NDArray[Any], dtype: Any, device: str) -> Any:
    """An array of Warp that on the CPU lies where the values are: nobody may change them any more."""
    if device != "cpu" or not len(values):
        return wp.array(values, dtype=dtype, device=device)
    single = np.require(values, np.int32 if dtype is wp.int32 else np.float32, ["C", "A"])
    return wp.array(single, dtype=dtype, device=device, copy=False)


def _joined(own: NDArray[Any], of_shapes: NDArray[Any]) -> NDArray[Any]:
    """One array, without a copy where there are no shapes."""
    return np.concatenate([own, of_shapes]) if len(of_shapes) else own


def smooth_of(normals: NDArray[Any]) -> NDArray[np.int32]:
    """1 for triangles with a normal at each corner, int32, shape [T]."""
    smooth: NDArray[np.int32] = (normals != 0).any(axis=2).all(axis=1).astype(np.int32)
    return smooth


@wp.kernel
def find_fronts(
    corners: wp.array2d[wp.vec3],
    normals: wp.array2d[wp.vec3],
    front_out: wp.array[wp.vec3],
    smooth_out: wp.array[wp.int32],
) -> None:
    i = wp.tid()
    smooth = wp.int32(1)
    for corner in range(3):
        n = normals[i, corner]
        if n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0:
            smooth = 0
    smooth_out[i] = smooth
    together = wp.vec3d(normals[i, 0]) + wp.vec3d(normals[i, 1]) + wp.vec3d(normals[i, 2])
    front_out[i] = front_of_corners(corners[i, 0], corners[i, 1], corners[i, 2], together)


def front_normals(triangles: Triangles) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Unit geometric normals of the triangles' fronts, and whether each has normals to interpolate.

    The front is the side that the vertex normals are on; without them, the one from which the corners go
    counter-clockwise. Computed in double: a cross product of needles cancels.
    """
    front = np.empty((len(triangles), 3), np.float32)
    smooth = np.empty(len(triangles), np.int32)
    for first in range(0, len(triangles), _AT_ONCE):
        rows = slice(first, first + _AT_ONCE)
        seen = [shared(column[rows], wp.vec3, "cpu") for column in (triangles.positions, triangles.normals)]
        count = len(front[rows])
        found = [wp.empty(count, dtype=dtype, device="cpu") for dtype in (wp.vec3, wp.int32)]
        wp.launch(find_fronts, count, inputs=seen, outputs=found, device="cpu")
        front[rows], smooth[rows] = (array.numpy() for array in found)
        let_go(triangles.positions[rows], triangles.normals[rows])
    return front, smooth


_AT_ONCE = 1 << 16
"""Triangles that are looked at together: what lies in files leaves memory after that."""


@wp.func
def row_of(surfaces: wp.ref[Surfaces], prim: wp.int32) -> wp.int32:
    """The row of a global triangle number; the triangle must be in the cell."""
    # Numbers rise by one from row to row, but for triangles that are not here: so many rows before its number at most.
    last = surfaces.count - 1
    high = wp.clamp(prim, 0, last)
    low = wp.clamp(prim - (surfaces.ids[last] - last), 0, high)
    while low < high:
        middle = (low + high) // 2
        if surfaces.ids[middle] < prim:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def combined(p0: wp.vec3, p1: wp.vec3, p2: wp.vec3, u: wp.float32, v: wp.float32) -> wp.vec3:
    """A point between corners, combined in double and rounded once.

    That is what makes the offset of leaving rays provable (constants.OFFSET_SHARE).
    """
    b = wp.float64(u)
    c = wp.float64(v)
    a = wp.float64(1.0) - b - c
    return wp.vec3(wp.vec3d(p0) * a + wp.vec3d(p1) * b + wp.vec3d(p2) * c)


@wp.func
def position_at(surfaces: wp.ref[Surfaces], row: wp.int32, u: wp.float32, v: wp.float32) -> wp.vec3:
    """A point of a triangle."""
    return combined(surfaces.corners[row, 0], surfaces.corners[row, 1], surfaces.corners[row, 2], u, v)


@wp.func
def distance_to_line(start: wp.vec3, end: wp.vec3, position: wp.vec3) -> wp.float32:
    """Distance of a point to the line through two others."""
    return wp.length(wp.cross(wp.normalize(end - start), position - start))


@wp.func
def clearance(surfaces: wp.ref[Surfaces], prim: wp.int32, position: wp.vec3) -> wp.float32:
    """Distance of a point of a triangle to the nearest of its edges."""
    row = row_of(surfaces, prim)
    nearest = wp.float32(3.0e38)
    for corner in range(3):
        start = surfaces.corners[row, corner]
        end = surfaces.corners[row, (corner + 1) % 3]
        nearest = wp.min(nearest, distance_to_line(start, end, position))
    return nearest


@wp.func
def table_row(row: wp.int32) -> wp.int32:
    """The row in the arrays that do not depend on where a triangle stands."""
    return row


@wp.func
def front_of(surfaces: wp.ref[Surfaces], row: wp.int32) -> wp.vec3:
    """Unit geometric normal of a triangle's front."""
    return surfaces.front[row]


@wp.func
def corner_at(surfaces: wp.ref[Surfaces], row: wp.int32, corner: wp.int32) -> wp.vec3:
    """A corner of a triangle."""
    return surfaces.corners[row, corner]


@wp.func
def normal_at(surfaces: wp.ref[Surfaces], row: wp.int32, corner: wp.int32) -> wp.vec3:
    """The normal at a corner of a triangle; zero where it is flat."""
    return surfaces.normals[row, corner]


@wp.func
def uv_at(surfaces: wp.ref[Surfaces], row: wp.int32, corner: wp.int32) -> wp.vec2:
    """Texture coordinates at a corner of a triangle."""
    return surfaces.uvs[row, corner]


@wp.func
def color_at(surfaces: wp.ref[Surfaces], row: wp.int32, corner: wp.int32) -> wp.vec3:
    """The colour at a corner of a triangle, where there are any."""
    return surfaces.colors[row, corner]
