"""Triangles of shapes where they stand: computed from the shape's corners, to the very floats that a copy would have.

scenes.flat.instances computes the same with NumPy, for copies: the same operations in the same order, in double,
rounded once. A ray is tested against these triangles, with the test of all others; what trees are made of decides
nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.scenes.flat.instances import Instances
from wdpm.scenes.flat.renderer_space import NOTHING

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_NOTHING = wp.constant(wp.float64(NOTHING))


@wp.struct
class DeviceInstances:
    """Instances of a cell, in the order of their triangles' numbers, and the corners of their shapes.

    Attributes:
        count: how many instances.
        base: global number of each one's first triangle, shape [I], ascending; size: how many it has.
        first: row of that triangle in `corners`, shape [I].
        mirrored: 1 where corners go the other way round, shape [I].
        matrix: rows of the matrix to the renderer's space, shape [I, 3].
        normal_matrix: rows of the matrix for normals, shape [I, 3].
        corners, normals: of the shapes' triangles, in their own spaces, shape [G, 3].
    """

    count: wp.int32
    base: wp.array[wp.int32]
    size: wp.array[wp.int32]
    first: wp.array[wp.int32]
    mirrored: wp.array[wp.int32]
    matrix: wp.array2d[wp.vec4d]
    normal_matrix: wp.array2d[wp.vec3d]
    corners: wp.array2d[wp.vec3d]
    normals: wp.array2d[wp.vec3d]


def upload_instances(instances: Instances, device: str) -> Any:
    """Instances on a device: DeviceInstances."""

    def integers(values: NDArray[np.int32]) -> wp.array:
        return wp.array(values.astype(np.int32), dtype=wp.int32, device=device)

    shapes = instances.shapes
    uploaded = DeviceInstances()
    uploaded.count = len(instances)
    uploaded.base, uploaded.size = integers(instances.base), integers(instances.sizes)
    uploaded.first, uploaded.mirrored = integers(shapes.first[instances.shape]), integers(instances.mirrored)
    uploaded.matrix = wp.array(instances.matrix, dtype=wp.vec4d, device=device)
    uploaded.normal_matrix = wp.array(instances.normal_matrix, dtype=wp.vec3d, device=device)
    uploaded.corners = wp.array(shapes.corners, dtype=wp.vec3d, device=device)
    uploaded.normals = wp.array(shapes.normals, dtype=wp.vec3d, device=device)
    return uploaded


@wp.func
def coordinate(row: wp.vec4d, point: wp.vec3d) -> wp.float32:
    """One coordinate of a point of a shape where it stands."""
    x = row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3]
    if wp.abs(x) <= _NOTHING:
        x = wp.float64(0.0)
    return wp.float32(x)


@wp.func
def shape_corner(instances: wp.ref[DeviceInstances], instance: wp.int32, corner: wp.int32) -> wp.int32:
    """Which corner of the shape's triangle is this corner of the instance's."""
    own = corner
    if instances.mirrored[instance] == 1:
        own = 2 - corner
    return own


@wp.func
def instance_corner(instances: wp.ref[DeviceInstances], instance: wp.int32, row: wp.int32, corner: wp.int32) -> wp.vec3:
    """A corner of an instance's triangle.

    Args:
        row: of the triangle among those of all shapes.
    """
    p = instances.corners[row, shape_corner(instances, instance, corner)]
    return wp.vec3(
        coordinate(instances.matrix[instance, 0], p),
        coordinate(instances.matrix[instance, 1], p),
        coordinate(instances.matrix[instance, 2], p),
    )


@wp.func
def instance_normal(instances: wp.ref[DeviceInstances], instance: wp.int32, row: wp.int32, corner: wp.int32) -> wp.vec3:
    """The unit normal at a corner of an instance's triangle; zero where the mesh is flat."""
    n = instances.normals[row, shape_corner(instances, instance, corner)]
    turned = wp.vec3d()
    for axis in range(3):
        m = instances.normal_matrix[instance, axis]
        turned[axis] = m[0] * n[0] + m[1] * n[1] + m[2] * n[2]
    length = wp.sqrt(turned[0] * turned[0] + turned[1] * turned[1] + turned[2] * turned[2])
    unit = wp.vec3(0.0)
    if length > wp.float64(0.0):
        unit = wp.vec3(wp.float32(turned[0] / length), wp.float32(turned[1] / length), wp.float32(turned[2] / length))
    return unit


@wp.func
def front_of_corners(a: wp.vec3, b: wp.vec3, c: wp.vec3, normals: wp.vec3d) -> wp.vec3:
    """Unit geometric normal of a triangle's front, of instances as of triangles with arrays of their own.

    Args:
        normals: sum of the normals at its corners.
    """
    p = wp.vec3d(a)
    e = wp.vec3d(b) - p
    f = wp.vec3d(c) - p
    n = wp.vec3d(e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0])
    length = wp.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    n = wp.vec3d(n[0] / length, n[1] / length, n[2] / length)
    if n[0] * normals[0] + n[1] * normals[1] + n[2] * normals[2] < wp.float64(0.0):
        n = -n
    return wp.vec3(wp.float32(n[0]), wp.float32(n[1]), wp.float32(n[2]))


@wp.func
def instance_front(instances: wp.ref[DeviceInstances], instance: wp.int32, row: wp.int32) -> wp.vec3:
    """Unit geometric normal of the front of an instance's triangle."""
    a = instance_corner(instances, instance, row, 0)
    b = instance_corner(instances, instance, row, 1)
    c = instance_corner(instances, instance, row, 2)
    normals = wp.vec3d(instance_normal(instances, instance, row, 0))
    normals += wp.vec3d(instance_normal(instances, instance, row, 1))
    normals += wp.vec3d(instance_normal(instances, instance, row, 2))
    return front_of_corners(a, b, c, normals)


@wp.func
def instance_among(instances: wp.ref[DeviceInstances], prim: wp.int32, first: wp.int32, last: wp.int32) -> wp.int32:
    """Which of the instances first to last - 1 a triangle is of, by its global number; -1 for none of them."""
    low = first  # instances before `low` begin at prim or before
    high = last
    while low < high:
        middle = (low + high) // 2
        if instances.base[middle] <= prim:
            low = middle + 1
        else:
            high = middle
    found = low - 1
    if found < first:
        return -1
    if prim - instances.base[found] >= instances.size[found]:
        return -1
    return found


@wp.func
def instance_of(instances: wp.ref[DeviceInstances], prim: wp.int32) -> wp.int32:
    """Which instance a triangle is of, by its global number; -1 for none."""
    return instance_among(instances, prim, 0, instances.count)
