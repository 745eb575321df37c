"""Camera rays and the paths that go on from them: from cell to cell, to their nearest hit."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import warp as wp

from wdpm.kernels.camera.camera import CameraView, Ray, make_camera, whole_pixel
from wdpm.kernels.camera.paths import Paths, Vertex, load_hit, store_hit, store_path
from wdpm.kernels.columns import FromFields, columns_of, loader, storer
from wdpm.kernels.features import Features
from wdpm.kernels.made_for import made_for
from wdpm.kernels.maths.sample_numbers import item_of_sample
from wdpm.kernels.ray_fields import CAMERA_RAY
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.cells import Cells, cell_of, cell_on_way, entry_of, inverse_direction, next_cell, next_cell_of
from wdpm.kernels.rays.outlines import meets_outline
from wdpm.kernels.rays.owners import make_owner_of
from wdpm.kernels.rays.triangle import Hit
from wdpm.kernels.rays.two_level import Trees, closest_function

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


PATH_ENDED = wp.constant(-2)
"""In place of the next cell: a ray that carries nothing. One whose hit is final has -1 there."""


@columns_of(CAMERA_RAY)
class Rays(FromFields):
    """Camera rays, one an item, with their best hits so far."""


load_ray = loader(Rays, Vertex)
load_ray_hit = loader(Rays, Hit)
store_ray_hit = storer(Rays, Hit)


@dataclass(frozen=True)
class CameraRays:
    """Kernels for camera rays of a set of features."""

    first_camera_cells: wp.Kernel
    mark_touched_cells: wp.Kernel
    visit_camera_rays: wp.Kernel
    start_paths: wp.Kernel


@wp.func
def begin_path(camera: wp.ref[CameraView], ray: Ray, p: Vertex) -> Vertex:
    """A camera ray as the beginning of a path.

    Args:
        p: which pixel's and sample's it is, and what it has met.
    """
    p.item = item_of_sample(whole_pixel(camera, p.pixel), p.sample)
    p.edges = 1
    p.medium = camera.medium
    p.origin = ray.origin
    p.direction = ray.direction
    p.anchor = ray.origin
    p.throughput = wp.vec3(1.0)
    return p


@functools.cache
def make_first_vertex(features: Features) -> wp.Function:
    """The function `first_vertex` for cameras with a set of features: (camera, rays, i) -> Vertex."""
    camera_ray = make_camera(features)

    @wp.func
    def first_vertex(camera: wp.ref[CameraView], rays: wp.ref[Rays], i: wp.int32) -> Vertex:
        """A camera ray as the beginning of a path."""
        p = load_ray(rays, i)
        p.row = i
        return begin_path(camera, camera_ray(camera, p.pixel, p.sample), p)

    return first_vertex


@functools.cache
def make_first_path(features: Features) -> wp.Function:
    """The function `first_path` for a set of features: (camera, pixel, number) -> Vertex."""
    camera_ray = make_camera(features)

    @wp.func
    def first_path(camera: wp.ref[CameraView], pixel: wp.int32, number: wp.int32) -> Vertex:
        """The path of a sample as it leaves the camera."""
        p = Vertex()
        p.pixel = pixel
        p.sample = number
        ray = camera_ray(camera, pixel, number)
        p.t = ray.t_max
        p.prim = -1
        return begin_path(camera, ray, p)

    return first_path


@functools.cache
def make_camera_rays(features: Features) -> CameraRays:
    """The kernels for a set of features."""
    camera_ray = make_camera(features)
    first_vertex = make_first_vertex(features)
    closest_hit = closest_function(features.instances)
    owner_of = make_owner_of(features.instances)

    @made_for(features)
    def first_camera_cells(
        camera: CameraView, cells: Cells, rays: Rays, offset: wp.int32, next_cell_out: wp.array[wp.int32]
    ) -> None:
        """The first cell on the way of every ray."""
        i = offset + wp.tid()
        ray = camera_ray(camera, rays.pixel[i], rays.sample[i])
        next_cell_out[i] = next_cell(cells, ray.origin, ray.direction, ray.t_max, -1)

    @made_for(features)
    def mark_touched_cells(
        camera: CameraView, cells: Cells, rays: Rays, offset: wp.int32, touched_out: wp.array2d[wp.uint8]
    ) -> None:
        """Which cells each ray may find its hit in, at least one, uint8, shape [rays, cells]."""
        i = offset + wp.tid()
        ray = camera_ray(camera, rays.pixel[i], rays.sample[i])
        inverse = inverse_direction(ray.direction)
        nowhere = wp.bool(True)
        for cell in range(cells.count):
            if entry_of(cells, cell, ray.origin, inverse, ray.t_max) >= 0.0:
                if meets_outline(cells.outlines, cell, ray.origin, ray.direction, inverse, ray.t_max):
                    touched_out[i, cell] = wp.uint8(1)
                    nowhere = False
        if nowhere:
            touched_out[i, cell_of(cells, ray.origin)] = wp.uint8(1)

    @made_for(features)
    def visit_camera_rays(
        trees: Trees,
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
        hit = load_ray_hit(rays, i)
        found = closest_hit(trees, ray.origin, ray.direction, hit)
        if found.prim != hit.prim:
            store_ray_hit(found, i, rays)
            rays.owner[i] = owner_of(cells, surfaces, found)
        end = wp.where(found.prim >= 0, rays.owner[i], -1)
        next_cell_out[i] = next_cell_of(cells, ray.origin, ray.direction, found.t, end, own_cell, 0)

    @made_for(features)
    def start_paths(camera: CameraView, rays: Rays, offset: wp.int32, paths_out: Paths) -> None:
        """Camera rays as the beginnings of paths."""
        i = offset + wp.tid()
        store_path(first_vertex(camera, rays, i), i, paths_out)

    return CameraRays(first_camera_cells, mark_touched_cells, visit_camera_rays, start_paths)


@wp.kernel
def first_path_cells(
    cells: Cells, paths: Paths, misses: wp.int32, offset: wp.int32, next_cell_out: wp.array[wp.int32]
) -> None:
    """The first cell on the way of each path's next ray; -1 for one that carries nothing.

    Args:
        misses: 1 if rays bring light from beyond the scene; 0 if one that meets no cell's outline carries nothing.
    """
    i = offset + wp.tid()
    cell = wp.int32(-1)
    if wp.max(paths.throughput[i]) > 0.0:
        cell = cell_on_way(cells, paths.origin[i], paths.direction[i], paths.t[i], -1, -1, True)
        if cell < 0 and misses != 0:
            cell = cell_of(cells, paths.origin[i])
    next_cell_out[i] = cell


@functools.cache
def make_visit_paths(features: Features) -> wp.Kernel:
    """The kernel that intersects rays of paths with a cell."""
    closest_hit = closest_function(features.instances)
    owner_of = make_owner_of(features.instances)

    @made_for(features)
    def visit_paths(
        trees: Trees,
        surfaces: Surfaces,
        cells: Cells,
        paths: Paths,
        own_cell: wp.int32,
        fresh: wp.int32,
        offset: wp.int32,
        next_cell_out: wp.array[wp.int32],
    ) -> None:
        """As visit_camera_rays, for rays that carry where they come from.

        Args:
            fresh: 1 for rays that have been nowhere yet, but begin here: those that carry nothing are PATH_ENDED.
                Else 0.
        """
        i = offset + wp.tid()
        origin, direction = paths.origin[i], paths.direction[i]
        onward = wp.int32(PATH_ENDED)
        if fresh == 0 or wp.max(paths.throughput[i]) > 0.0:
            hit = load_hit(paths, i)
            found = closest_hit(trees, origin, direction, hit)
            if found.prim != hit.prim:
                store_hit(found, i, paths)
                paths.owner[i] = owner_of(cells, surfaces, found)
            end = wp.where(found.prim >= 0, paths.owner[i], -1)
            onward = next_cell_of(cells, origin, direction, found.t, end, own_cell, fresh)
        next_cell_out[i] = onward

    return visit_paths
