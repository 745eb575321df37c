"""Shadow segments: does light get from a light to a surface, and how much of it.

Where nothing lets light pass, the first blocker found ends a segment: any blocker, in any order. Where light may go
straight through some surfaces (masks, boundaries of media, thin panes) or through a medium, a segment is walked from
surface to surface, each factor applied where its surface is, in the order along the segment.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.columns import FromFields, columns_of, loader, storer
from wdpm.kernels.features import Features
from wdpm.kernels.fields import chosen
from wdpm.kernels.made_for import made_for
from wdpm.kernels.materials.flights import make_flights
from wdpm.kernels.materials.medium import Media
from wdpm.kernels.materials.resolve import make_materials, medium_beyond
from wdpm.kernels.materials.surface import leave, make_surface
from wdpm.kernels.ray_fields import SEGMENT, STRETCH, WALK
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.cells import Cells, cell_of, cell_on_way, may_meet, next_cell, next_cell_of
from wdpm.kernels.rays.owners import make_owner_of
from wdpm.kernels.rays.triangle import Hit
from wdpm.kernels.rays.two_level import Trees, any_function, closest_function

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SHADOW_BLOCKED = wp.constant(-2)
SHADOW_CLEAR = wp.constant(-1)

SEGMENT_END = wp.constant(1.0)
"""Where a segment ends, in units of its direction's length."""


@columns_of(SEGMENT)
class Segments(FromFields):
    """Shadow segments from origin to origin + direction, and the radiance that arrives if nothing blocks them."""


@columns_of(WALK)
class Walks(FromFields):
    """Shadow segments that are walked, with the best hit of the moment."""


load_walk_hit = loader(Walks, Hit)
store_walk_hit = storer(Walks, Hit)


@wp.kernel
def first_shadow_cells(cells: Cells, segments: Segments, offset: wp.int32, next_cell_out: wp.array[wp.int32]) -> None:
    """The first cell on the way of each shadow segment; SHADOW_BLOCKED for one that carries nothing.

    SHADOW_CLEAR for one that no cell may hold a blocker of.
    """
    i = offset + wp.tid()
    next_cell_out[i] = SHADOW_BLOCKED
    if wp.max(segments.radiance[i]) > 0.0:
        next_cell_out[i] = cell_on_way(cells, segments.origin[i], segments.direction[i], SEGMENT_END, -1, -1, True)


@functools.cache
def make_visit_shadow_segments(features: Features) -> wp.Kernel:
    """The kernel that looks for blockers in a cell."""
    any_hit = any_function(features.instances)

    @made_for(features)
    def visit_shadow_segments(
        trees: Trees,
        cells: Cells,
        segments: Segments,
        own_cell: wp.int32,
        fresh: wp.int32,
        offset: wp.int32,
        next_cell_out: wp.array[wp.int32],
    ) -> None:
        """Look for a blocker in this cell: SHADOW_BLOCKED, SHADOW_CLEAR at the end of the way, or the next cell.

        Args:
            fresh: 1 for segments that have been nowhere yet, but begin here: those that carry nothing are
                SHADOW_BLOCKED. Else 0.
        """
        i = offset + wp.tid()
        origin, direction = segments.origin[i], segments.direction[i]
        onward = wp.int32(SHADOW_BLOCKED)
        if wp.max(segments.radiance[i]) > 0.0:
            asks = wp.bool(True)
            if fresh != 0 and cells.count > 1:
                asks = may_meet(cells, own_cell, origin, direction, SEGMENT_END)
            blocked = wp.bool(False)
            if asks:
                blocked = any_hit(trees, origin, direction, SEGMENT_END)
            if not blocked:
                end = cell_of(cells, origin + direction)
                onward = next_cell_of(cells, origin, direction, SEGMENT_END, end, own_cell, fresh)
        next_cell_out[i] = onward

    return visit_shadow_segments


@functools.cache
def make_visit_walks(features: Features) -> wp.Kernel:
    """The kernel that looks for surfaces on the way of segments that are walked."""
    closest_hit = closest_function(features.instances)
    owner_of = make_owner_of(features.instances)
    transmittance_of = make_flights(features).transmittance_of

    @made_for(features)
    def visit_walks(
        trees: Trees,
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
        hit = load_walk_hit(walks, i)
        found = closest_hit(trees, walks.origin[i], walks.direction[i], hit)
        if found.prim != hit.prim:
            store_walk_hit(found, i, walks)
            walks.owner[i] = owner_of(cells, surfaces, found)
        onward = next_cell(cells, walks.origin[i], walks.direction[i], found.t, own_cell)
        next_cell_out[i] = onward
        if onward < 0 and found.prim < 0 and walks.medium[i] >= 0:
            along = wp.normalize(walks.direction[i])
            length = wp.length(walks.direction[i])
            through = transmittance_of(media, walks.medium[i], walks.origin[i], along, length)
            walks.radiance[i] = wp.cw_mul(walks.radiance[i], through)

    return visit_walks


@wp.struct
class Passage:
    """A segment that is walked, from origin to origin + direction.

    Attributes:
        radiance: what arrives if nothing more is in its way.
        medium: that it is in, -1 for none.
        ahead: 1 where its end lies ahead of it, behind a surface that it has passed.
    """

    origin: wp.vec3
    direction: wp.vec3
    radiance: wp.vec3
    medium: wp.int32
    ahead: wp.int32


@functools.cache
def make_pass_through(features: Features) -> wp.Function:
    """The function `pass_through` for a set of features: (scene, way, met) -> Passage."""
    surface_at = make_surface(features).surface_at
    straight_transmittance = make_materials(features).straight_transmittance
    transmittance_of = make_flights(features).transmittance_of

    @wp.func
    def pass_through(scene: wp.ref[Scene], way: Passage, met: Hit) -> Passage:
        """A segment beyond the surface that it has met; its radiance is zero where nothing gets through."""
        unit = wp.normalize(way.direction)
        s = surface_at(scene.surfaces, scene.materials, scene.textures, met.prim, met.u, met.v, -unit, 0.0)
        cosine = wp.abs(wp.dot(s.normal, unit))
        factor = straight_transmittance(scene.materials, scene.textures, s.material, s.uv, s.color, cosine)
        radiance = wp.cw_mul(way.radiance, factor)
        if wp.static(features.media):
            if way.medium >= 0:
                length = met.t * wp.length(way.direction)
                through = transmittance_of(scene.media, way.medium, way.origin, unit, length)
                radiance = wp.cw_mul(radiance, through)
            way.medium = medium_beyond(scene.materials, s.material, s.front, way.medium)
        end = way.origin + way.direction
        origin = leave(s.position, -s.normal, scene.surfaces.offset_min)
        rest = end - origin
        way.ahead = wp.int32(wp.max(radiance) > 0.0 and wp.dot(rest, way.direction) > 0.0)
        way.origin = origin
        way.direction = rest
        way.radiance = radiance
        return way

    return pass_through


@functools.cache
def make_pass_surfaces(features: Features) -> wp.Kernel:
    """The kernel that takes walked segments through a surface."""
    pass_through = make_pass_through(features)

    @made_for(features)
    def pass_surfaces(scene: Scene, walks: Walks, offset: wp.int32, next_cell_out: wp.array[wp.int32]) -> None:
        """Take segments through the surface that they have met: SHADOW_BLOCKED, or the first cell on the way on."""
        i = offset + wp.tid()
        way = Passage()
        way.origin = walks.origin[i]
        way.direction = walks.direction[i]
        way.radiance = walks.radiance[i]
        way.medium = -1
        if wp.static(features.media):
            way.medium = walks.medium[i]
        way = pass_through(scene, way, load_walk_hit(walks, i))
        if wp.static(features.media):
            walks.medium[i] = way.medium
        walks.origin[i] = way.origin
        walks.direction[i] = way.direction
        walks.radiance[i] = way.radiance
        walks.t[i] = SEGMENT_END
        walks.prim[i] = -1
        walks.owner[i] = -1
        next_cell_out[i] = SHADOW_BLOCKED
        if wp.max(way.radiance) > 0.0:
            onward = wp.int32(-1)
            if way.ahead == 1:
                onward = next_cell(scene.cells, way.origin, way.direction, SEGMENT_END, -1)
            next_cell_out[i] = onward

    return pass_surfaces


@columns_of(chosen(STRETCH, "origin", "direction", "length"))
class Ways(FromFields):
    """Straight ways of some length along unit directions."""


@wp.kernel
def next_way_cells(
    cells: Cells, ways: Ways, current: wp.int32, offset: wp.int32, next_cell_out: wp.array[wp.int32]
) -> None:
    """The cell that each way visits after `current` (-1: before the first), or -1 when none is left."""
    i = offset + wp.tid()
    next_cell_out[i] = cell_on_way(cells, ways.origin[i], ways.direction[i], ways.length[i], current, -1, False)
