"""Camera samples: find what they see, light it directly, and ask the photon map for the rest."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.bvh import Bvh, any_hit, closest_hit
from wdpm.kernels.camera import CameraView, camera_ray
from wdpm.kernels.cells import Cells, cell_of, entry_of, inverse_direction, next_cell
from wdpm.kernels.constants import INV_PI
from wdpm.kernels.lights import LightTable, sample_light
from wdpm.kernels.random import PURPOSE_LIGHT, sample_1d, sample_2d, stream_of
from wdpm.kernels.surface import Surface, Surfaces, clearance, leave, position_at, row_of, surface_at
from wdpm.kernels.triangle import Hit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

DIRECT_DEPTH = wp.constant(2)
"""Edges of the paths that direct light travels: light to surface, surface to camera."""


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
class Seen:
    """What camera samples see. The indirect part is filled in from the gather."""

    emission: wp.array[wp.vec3]
    depth: wp.array[wp.float32]
    normal: wp.array[wp.vec3]
    albedo: wp.array[wp.vec3]


@wp.struct
class Queries:
    """Places where photons are to be gathered; what does not reflect towards the camera has an albedo of zero."""

    position: wp.array[wp.vec3]
    normal: wp.array[wp.vec3]
    shading_normal: wp.array[wp.vec3]
    front_normal: wp.array[wp.vec3]
    clearance: wp.array[wp.float32]  # distance to the nearest edge of the triangle


@wp.struct
class Segments:
    """Shadow segments from origin to origin + direction, and the radiance that arrives if nothing blocks them."""

    slot: wp.array[wp.int32]
    origin: wp.array[wp.vec3]
    direction: wp.array[wp.vec3]
    radiance: wp.array[wp.vec3]


@wp.kernel
def first_camera_cells(
    camera: CameraView, cells: Cells, rays: Rays, offset: wp.int32, next_cell_out: wp.array[wp.int32]
) -> None:
    """The first cell on the way of every ray."""
    i = offset + wp.tid()
    ray = camera_ray(camera, rays.pixel[i], rays.sample[i])
    next_cell_out[i] = next_cell(cells, ray.origin, ray.direction, ray.t_max, -1)


@wp.kernel
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


@wp.kernel
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
    """Intersect rays with this cell. Best hits are refined in place; -1 in next_cell_out says that a hit is final."""
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


@wp.func
def incoming_direct(
    lights: LightTable,
    s: Surface,
    origin: wp.vec3,
    u_element: wp.float64,
    u_position: wp.vec2,
    slot: wp.int32,
    j: wp.int32,
    segments_out: Segments,
) -> None:
    """One sample of the direct light that a surface reflects: a shadow segment, and what it carries."""
    light = sample_light(lights, u_element, u_position)
    end = light.position
    if light.element < lights.triangles:
        end = leave(light.position, light.normal, lights.offset_min)
    direction = end - origin
    radiance = wp.vec3(0.0)
    distance2 = wp.dot(direction, direction)
    if distance2 > 0.0:
        to_light = wp.normalize(direction)
        cos_surface = wp.dot(s.shading_normal, to_light)
        cos_light = wp.float32(1.0)
        if light.element < lights.triangles:
            cos_light = -wp.dot(light.normal, to_light)
        if cos_surface > 0.0 and cos_light > 0.0 and wp.dot(s.normal, to_light) > 0.0 and light.pdf > 0.0:
            weight = INV_PI * cos_surface * (cos_light / (distance2 * light.pdf))
            radiance = wp.cw_mul(s.albedo, light.radiance) * weight
    segments_out.slot[j] = slot
    segments_out.origin[j] = origin
    segments_out.direction[j] = direction
    segments_out.radiance[j] = radiance


@wp.kernel
def shade_camera_hits(
    surfaces: Surfaces,
    lights: LightTable,
    camera: CameraView,
    rays: Rays,
    light_samples: wp.int32,
    max_depth: wp.int32,
    offset: wp.int32,
    seen_out: Seen,
    queries_out: Queries,
    segments_out: Segments,
) -> None:
    """Emission, shadow segments and gather query of final hits that lie in this cell.

    Args:
        light_samples: shadow segments a hit; segment j of hit i is number i * light_samples + j.
        max_depth: longest path in edges; 0 for no limit.
    """
    i = offset + wp.tid()
    pixel = rays.pixel[i]
    sample = rays.sample[i]
    slot = rays.slot[i] * light_samples
    ray = camera_ray(camera, pixel, sample)
    to_camera = -wp.normalize(ray.direction)
    s = surface_at(surfaces, rays.prim[i], rays.u[i], rays.v[i], to_camera)
    if not s.reflects:
        s.albedo = wp.vec3(0.0)

    emission = wp.vec3(0.0)
    if s.emitter >= 0 and s.front:
        emission = surfaces.emitter_radiance[s.emitter]
    seen_out.emission[i] = emission
    seen_out.depth[i] = wp.length(s.position - camera.eye)
    seen_out.normal[i] = s.shading_normal
    seen_out.albedo[i] = s.albedo
    queries_out.position[i] = s.position
    queries_out.normal[i] = s.normal
    queries_out.shading_normal[i] = s.shading_normal
    queries_out.front_normal[i] = s.normal
    if not s.front:
        queries_out.front_normal[i] = -s.normal
    queries_out.clearance[i] = clearance(surfaces, rays.prim[i], s.position)

    origin = leave(s.position, s.normal, surfaces.offset_min)
    index = wp.uint32(sample) * wp.uint32(light_samples)
    for j in range(light_samples):
        if wp.max(s.albedo) > 0.0 and lights.count > 0 and (max_depth == 0 or max_depth >= DIRECT_DEPTH):
            incoming_direct(
                lights,
                s,
                origin,
                sample_1d(index + wp.uint32(j), stream_of(camera.seed, PURPOSE_LIGHT, wp.uint32(pixel), 0)),
                sample_2d(index + wp.uint32(j), stream_of(camera.seed, PURPOSE_LIGHT, wp.uint32(pixel), 1)),
                slot + j,
                i * light_samples + j,
                segments_out,
            )
        else:
            segments_out.slot[i * light_samples + j] = slot + j
            segments_out.radiance[i * light_samples + j] = wp.vec3(0.0)


@wp.kernel
def first_shadow_cells(cells: Cells, segments: Segments, offset: wp.int32, next_cell_out: wp.array[wp.int32]) -> None:
    """The first cell on the way of each shadow segment; -1 for one that carries nothing."""
    i = offset + wp.tid()
    next_cell_out[i] = -1
    if wp.max(segments.radiance[i]) > 0.0:
        next_cell_out[i] = next_cell(cells, segments.origin[i], segments.direction[i], 1.0, -1)


SHADOW_BLOCKED = wp.constant(-2)
SHADOW_CLEAR = wp.constant(-1)


@wp.kernel
def visit_shadow_segments(
    bvh: Bvh, cells: Cells, segments: Segments, own_cell: wp.int32, offset: wp.int32, next_cell_out: wp.array[wp.int32]
) -> None:
    """Look for a blocker in this cell: SHADOW_BLOCKED, SHADOW_CLEAR at the end of the way, or the next cell."""
    i = offset + wp.tid()
    if wp.max(segments.radiance[i]) == 0.0 or any_hit(bvh, segments.origin[i], segments.direction[i], 1.0):
        next_cell_out[i] = SHADOW_BLOCKED
    else:
        next_cell_out[i] = next_cell(cells, segments.origin[i], segments.direction[i], 1.0, own_cell)
