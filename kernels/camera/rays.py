"""Camera rays and the paths that go on from them: from cell to cell, to their nearest hit."""

from __future__ import annotations

import functools
from types import SimpleNamespace

import warp as wp

from wdpm.kernels.camera.camera import CameraView, make_camera
from wdpm.kernels.features import Features
from wdpm.kernels.materials.surface import Surfaces, position_at, row_of
from wdpm.kernels.rays.bvh import Bvh, closest_hit
from wdpm.kernels.rays.cells import Cells, cell_of, entry_of, inverse_direction, next_cell
from wdpm.kernels.rays.triangle import Hit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Rays:
    """Camera rays, one an item, with their best hits so far; see cluster.batch.SCHEMAS.

    A ray is a function of its pixel and its sample number; `slot` is where its home wants the result.
    """

    slot: wp.array[wp.int32]
    pixel: wp.array[wp.int32]
    sample: wp.array[wp.int32]
    t: wp.array[wp.float32]
    prim: wp.array[wp.int32]
    u: wp.array[wp.float32]
    v: wp.array[wp.float32]
    owner: wp.array[wp.int32]


@wp.struct
class Paths:
    """Camera paths beyond their first surface, one an item, with their best hits so far; see cluster.batch.SCHEMAS."""

    slot: wp.array[wp.int32]
    pixel: wp.array[wp.int32]
    sample: wp.array[wp.int32]
    bounce: wp.array[wp.int32]
    edges: wp.array[wp.int32]
    diffuse: wp.array[wp.int32]
    medium: wp.array[wp.int32]
    origin: wp.array[wp.vec3]
    direction: wp.array[wp.vec3]
    anchor: wp.array[wp.vec3]
    throughput: wp.array[wp.vec3]
    pdf: wp.array[wp.float32]
    t: wp.array[wp.float32]
    prim: wp.array[wp.int32]
    u: wp.array[wp.float32]
    v: wp.array[wp.float32]
    owner: wp.array[wp.int32]


@functools.cache
def make_camera_rays(features: Features) -> SimpleNamespace:
    """Kernels for camera rays: `first_camera_cells`, `mark_touched_cells`, `visit_camera_rays`, `start_paths`."""
    camera_ray = make_camera(features).camera_ray

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def first_camera_cells(
        camera: CameraView, cells: Cells, rays: Rays, offset: wp.int32, next_cell_out: wp.array[wp.int32]
    ) -> None:
        """The first cell on the way of every ray."""
        i = offset + wp.tid()
        ray = camera_ray(camera, rays.pixel[i], rays.sample[i])
        next_cell_out[i] = next_cell(cells, ray.origin, ray.direction, ray.t_max, -1)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def mark_touched_cells(
        camera: CameraView, cells: Cells, rays: Rays, offset: wp.int32, touched_out: wp.array2d[wp.uint8]
    ) -> None:
        """Which cells each ray may find its hit in, uint8, shape [rays, cells]."""
        i = offset + wp.tid()
        ray = camera_ray(camera, rays.pixel[i], rays.sample[i])
        inverse = inverse_direction(ray.direction)
        for cell in range(cells.count):
            if entry_of(cells, cell, ray.origin, inverse, ray.t_max) >= 0.0:
                touched_out[i, cell] = wp.uint8(1)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def visit_camera_rays(
        bvh: Bvh,
        surfaces: Surfaces,
        cells: Cells,
        camera: CameraView,
        rays: Rays,
        own_cell: wp.int32,
        offset: wp.int32,
        next_cell_out: wp.array[wp.int32],
    ) -> None:
        """Intersect rays with this cell. Best hits are refined in place; -1 in next_cell_out: the hit is final."""
        i = offset + wp.tid()
        ray = camera_ray(camera, rays.pixel[i], rays.sample[i])
        hit = Hit()
        hit.t = rays.t[i]
        hit.prim = rays.prim[i]
        hit.u = rays.u[i]
        hit.v = rays.v[i]
        found = closest_hit(bvh, ray.origin, ray.direction, hit)
        if found.prim != hit.prim:
            rays.t[i] = found.t
            rays.prim[i] = found.prim
            rays.u[i] = found.u
            rays.v[i] = found.v
            row = row_of(surfaces, found.prim)
            rays.owner[i] = cell_of(cells, position_at(surfaces, row, found.u, found.v))
        next_cell_out[i] = next_cell(cells, ray.origin, ray.direction, found.t, own_cell)

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def start_paths(camera: CameraView, rays: Rays, offset: wp.int32, paths_out: Paths) -> None:
        """Camera rays as the beginnings of paths."""
        i = offset + wp.tid()
        ray = camera_ray(camera, rays.pixel[i], rays.sample[i])
        paths_out.slot[i] = rays.slot[i]
        paths_out.pixel[i] = rays.pixel[i]
        paths_out.sample[i] = rays.sample[i]
        paths_out.bounce[i] = 0
        paths_out.edges[i] = 1
        paths_out.diffuse[i] = 0
        paths_out.medium[i] = camera.medium
        paths_out.origin[i] = ray.origin
        paths_out.direction[i] = ray.direction
        paths_out.anchor[i] = ray.origin
        paths_out.throughput[i] = wp.vec3(1.0)
        paths_out.pdf[i] = 0.0
        paths_out.t[i] = rays.t[i]
        paths_out.prim[i] = rays.prim[i]
        paths_out.u[i] = rays.u[i]
        paths_out.v[i] = rays.v[i]
        paths_out.owner[i] = rays.owner[i]

    return SimpleNamespace(
        start_paths=start_paths,
        first_camera_cells=first_camera_cells,
        mark_touched_cells=mark_touched_cells,
        visit_camera_rays=visit_camera_rays,
    )


@wp.kernel
def first_path_cells(cells: Cells, paths: Paths, offset: wp.int32, next_cell_out: wp.array[wp.int32]) -> None:
    """The first cell on the way of each path's next ray; -1 for one that carries nothing."""
    i = offset + wp.tid()
    next_cell_out[i] = -1
    if wp.max(paths.throughput[i]) > 0.0:
        next_cell_out[i] = next_cell(cells, paths.origin[i], paths.direction[i], paths.t[i], -1)


@wp.kernel
def visit_paths(
    bvh: Bvh,
    surfaces: Surfaces,
    cells: Cells,
    paths: Paths,
    own_cell: wp.int32,
    offset: wp.int32,
    next_cell_out: wp.array[wp.int32],
) -> None:
    """As visit_camera_rays, for rays that carry where they come from."""
    i = offset + wp.tid()
    hit = Hit()
    hit.t = paths.t[i]
    hit.prim = paths.prim[i]
    hit.u = paths.u[i]
    hit.v = paths.v[i]
    found = closest_hit(bvh, paths.origin[i], paths.direction[i], hit)
    if found.prim != hit.prim:
        paths.t[i] = found.t
        paths.prim[i] = found.prim
        paths.u[i] = found.u
        paths.v[i] = found.v
        row = row_of(surfaces, found.prim)
        paths.owner[i] = cell_of(cells, position_at(surfaces, row, found.u, found.v))
    next_cell_out[i] = next_cell(cells, paths.origin[i], paths.direction[i], found.t, own_cell)
