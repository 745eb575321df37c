"""Shadow segments: does light get from a light to a surface, and how much of it.

Where nothing lets light pass, the first blocker found ends a segment: any blocker, in any order. Where light may go
straight through some surfaces (masks, boundaries of media, thin panes) or through a medium, a segment is walked from
surface to surface, each factor applied where its surface is, in the order along the segment.
"""

from __future__ import annotations

import functools
from types import SimpleNamespace

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.medium import Media, transmittance
from wdpm.kernels.materials.resolve import Materials, make_materials, medium_beyond
from wdpm.kernels.materials.surface import Surfaces, leave, make_surface, position_at, row_of
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.rays.bvh import Bvh, any_hit, closest_hit
from wdpm.kernels.rays.cells import Cells, cell_of, next_cell
from wdpm.kernels.rays.triangle import Hit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SHADOW_BLOCKED = wp.constant(-2)
SHADOW_CLEAR = wp.constant(-1)

SEGMENT_END = wp.constant(1.0)
"""Where a segment ends, in units of its direction's length."""


@wp.struct
class Segments:
    """Shadow segments from origin to origin + direction, and the radiance that arrives if nothing blocks them."""

    slot: wp.array[wp.int32]
    place: wp.array[wp.int32]
    origin: wp.array[wp.vec3]
    direction: wp.array[wp.vec3]
    radiance: wp.array[wp.vec3]


@wp.struct
class Walks:
    """Shadow segments that are walked, with the best hit of the moment; see cluster.batch.SCHEMAS."""

    slot: wp.array[wp.int32]
    place: wp.array[wp.int32]
    origin: wp.array[wp.vec3]
    direction: wp.array[wp.vec3]
    radiance: wp.array[wp.vec3]
    medium: wp.array[wp.int32]
    t: wp.array[wp.float32]
    prim: wp.array[wp.int32]
    u: wp.array[wp.float32]
    v: wp.array[wp.float32]
    owner: wp.array[wp.int32]


@wp.kernel
def first_shadow_cells(cells: Cells, segments: Segments, offset: wp.int32, next_cell_out: wp.array[wp.int32]) -> None:
    """The first cell on the way of each shadow segment; -1 for one that carries nothing."""
    i = offset + wp.tid()
    next_cell_out[i] = -1
    if wp.max(segments.radiance[i]) > 0.0:
        next_cell_out[i] = next_cell(cells, segments.origin[i], segments.direction[i], SEGMENT_END, -1)


@wp.kernel
def visit_shadow_segments(
    bvh: Bvh, cells: Cells, segments: Segments, own_cell: wp.int32, offset: wp.int32, next_cell_out: wp.array[wp.int32]
) -> None:
    """Look for a blocker in this cell: SHADOW_BLOCKED, SHADOW_CLEAR at the end of the way, or the next cell."""
    i = offset + wp.tid()
    if wp.max(segments.radiance[i]) == 0.0 or any_hit(bvh, segments.origin[i], segments.direction[i], SEGMENT_END):
        next_cell_out[i] = SHADOW_BLOCKED
    else:
        next_cell_out[i] = next_cell(cells, segments.origin[i], segments.direction[i], SEGMENT_END, own_cell)


@wp.kernel
def visit_walks(
    bvh: Bvh,
    surfaces: Surfaces,
    media: Media,
    cells: Cells,
    walks: Walks,
    own_cell: wp.int32,
    offset: wp.int32,
    next_cell_out: wp.array[wp.int32],
) -> None:
    """Look for the nearest surface in this cell; SHADOW_CLEAR where all cells have been asked.

    A segment that has then met none is attenuated by what is left of its medium, and has arrived.
    """
    i = offset + wp.tid()
    hit = Hit()
    hit.t = walks.t[i]
    hit.prim = walks.prim[i]
    hit.u = walks.u[i]
    hit.v = walks.v[i]
    found = closest_hit(bvh, walks.origin[i], walks.direction[i], hit)
    if found.prim != hit.prim:
        walks.t[i] = found.t
        walks.prim[i] = found.prim
        walks.u[i] = found.u
        walks.v[i] = found.v
        row = row_of(surfaces, found.prim)
        walks.owner[i] = cell_of(cells, position_at(surfaces, row, found.u, found.v))
    onward = next_cell(cells, walks.origin[i], walks.direction[i], found.t, own_cell)
    next_cell_out[i] = onward
    if onward < 0 and found.prim < 0 and walks.medium[i] >= 0:
        walks.radiance[i] = wp.cw_mul(
            walks.radiance[i], transmittance(media, walks.medium[i], wp.length(walks.direction[i]))
        )


@functools.cache
def make_shadow_walk(features: Features) -> SimpleNamespace:
    """The kernel that takes walked segments through a surface: `pass_panes`."""
    surface_at = make_surface(features).surface_at
    straight_transmittance = make_materials(features).straight_transmittance

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def pass_panes(
        surfaces: Surfaces,
        materials: Materials,
        textures: Textures,
        media: Media,
        cells: Cells,
        walks: Walks,
        offset: wp.int32,
        next_cell_out: wp.array[wp.int32],
    ) -> None:
        """Take segments through the surface that they have met: SHADOW_BLOCKED, or the first cell on the way on."""
        i = offset + wp.tid()
        direction = walks.direction[i]
        unit = wp.normalize(direction)
        s = surface_at(surfaces, materials, textures, walks.prim[i], walks.u[i], walks.v[i], -unit, 0.0)
        factor = straight_transmittance(materials, textures, s.material, s.uv, s.color, wp.abs(wp.dot(s.normal, unit)))
        radiance = wp.cw_mul(walks.radiance[i], factor)
        if wp.static(features.media):
            if walks.medium[i] >= 0:
                radiance = wp.cw_mul(radiance, transmittance(media, walks.medium[i], walks.t[i] * wp.length(direction)))
            walks.medium[i] = medium_beyond(materials, s.material, s.front, walks.medium[i])
        end = walks.origin[i] + direction
        origin = leave(s.position, -s.normal, surfaces.offset_min)
        rest = end - origin
        walks.origin[i] = origin
        walks.direction[i] = rest
        walks.radiance[i] = radiance
        walks.t[i] = SEGMENT_END
        walks.prim[i] = -1
        walks.owner[i] = -1
        next_cell_out[i] = SHADOW_BLOCKED
        if wp.max(radiance) > 0.0:
            onward = wp.int32(-1)
            if wp.dot(rest, direction) > 0.0:
                onward = next_cell(cells, origin, rest, SEGMENT_END, -1)
            next_cell_out[i] = onward

    return SimpleNamespace(pass_panes=pass_panes)


@wp.struct
class Ways:
    """Straight ways of some length along unit directions."""

    origin: wp.array[wp.vec3]
    direction: wp.array[wp.vec3]
    length: wp.array[wp.float32]


@wp.kernel
def next_way_cells(
    cells: Cells, ways: Ways, current: wp.int32, offset: wp.int32, next_cell_out: wp.array[wp.int32]
) -> None:
    """The cell that each way visits after `current` (-1: before the first), or -1 when none is left."""
    i = offset + wp.tid()
    next_cell_out[i] = next_cell(cells, ways.origin[i], ways.direction[i], ways.length[i], current)
