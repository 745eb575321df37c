"""What a launch that follows camera paths within one of several cells writes down: light for homes, and what leaves.

These are lists, written one after another as one path is followed after another. They have room for more than paths
need as a rule. Where that ends, so do the paths, and go on in another launch.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.paths import Vertex
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.vertices import (
    BY_FINAL_GATHER,
    CAUSTIC_PART,
    EMISSION_PART,
    INDIRECT_PART,
    REACH_PART,
    Orders,
    Shots,
    place_of,
)
from wdpm.kernels.columns import FromFields, columns_of, storer
from wdpm.kernels.features import Features
from wdpm.kernels.fields import chosen, integer
from wdpm.kernels.ray_fields import GATHERED, PART, PATH, PIXEL, SAMPLE, SEGMENT
from wdpm.kernels.rays.cells import next_cell_of
from wdpm.kernels.rays.owners import make_owner_of
from wdpm.kernels.rays.triangle import Hit
from wdpm.kernels.rays.two_level import Trees, closest_function
from wdpm.kernels.whole_samples.indirect_light import (
    PATHS_LEFT,
    RAYS_GATHERED,
    SEEN,
    SHOTS_LEFT,
    TOLD,
    Notes,
    count,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

WHOLE_SCENE = wp.constant(-1)
"""In place of a cell's number: the cell is the scene, and nothing leaves it."""

PARTS_A_VERTEX = 5
"""That a vertex may bring home, besides those of its shadow rays: emission, indirect light, caustics, reach, and what
shines from beyond the scene where its path ends there."""

_PARTS_A_VERTEX = wp.constant(PARTS_A_VERTEX)

_WHOSE = {"whose": integer("number of the path among those that are followed", least=0)}
_ONWARD = {"onward": integer("the cell that it is to visit next, negative where its hit is final")}


@columns_of({**PART, **_WHOSE})
class Parts(FromFields):
    """Light that arrived."""


@columns_of({**SEGMENT, **_WHOSE, **_ONWARD})
class LeavingShots(FromFields):
    """Shadow segments that other cells are to be asked about."""


@columns_of({**PATH, **_WHOSE, **_ONWARD})
class LeavingPaths(FromFields):
    """Paths that go on elsewhere, at most one for each that is followed."""


@columns_of({**chosen(SAMPLE, "slot", "emission", "indirect", "depth", "normal", "albedo"), **_WHOSE})
class FirstVertices(FromFields):
    """What first vertices show."""


@columns_of({**GATHERED, **_WHOSE})
class GatheredRays(FromFields):
    """What gather rays of records bring that end in the cell with all that follows from them, in place of its parts."""


@columns_of({**PIXEL, **_WHOSE})
class PixelSums(FromFields):
    """Samples that set out together and came to their ends in the cell, added up, in place of their parts."""


@wp.struct
class Leaving:
    """All that is written down. How many items the lists have is counted in Notes."""

    parts: Parts
    shots: LeavingShots
    paths: LeavingPaths
    first: FirstVertices
    gathered: GatheredRays
    pixels: PixelSums


@wp.struct
class Within:
    """Where a path is followed, and whose it is.

    Attributes:
        cell: number of the cell, or WHOLE_SCENE.
        whose: number of the path.
        later: paths of the launch that come after it, for whose first vertices room in the lists is kept.
        first_ray: number of a record's first gather ray: samples of pixels have smaller ones.
        visits: 1 where its first ray is on its way through the cell, with the best hit of those before; 0 where what
            that meets is known, or nobody has looked.
    """

    cell: wp.int32
    whose: wp.int32
    later: wp.int32
    first_ray: wp.int32
    visits: wp.int32


@wp.struct
class Look:
    """What a path's ray meets.

    Attributes:
        owner: the cell that contains the hit.
        onward: the cell that the ray is to visit next, negative where its hit is final, or it has none.
    """

    hit: Hit
    owner: wp.int32
    onward: wp.int32


@wp.struct
class Found:
    """Light of one vertex that came there by no shadow ray, as its sample counts it."""

    emission: wp.vec3
    indirect: wp.vec3
    caustic: wp.vec3


_store_leaving = storer(LeavingPaths, Vertex)


@wp.func
def hit_of(p: Vertex) -> Hit:
    """The best hit so far of a path's ray."""
    hit = Hit()
    hit.t = p.t
    hit.prim = p.prim
    hit.u = p.u
    hit.v = p.v
    return hit


@functools.cache
def make_look_along(features: Features) -> wp.Function:
    """The function `look_along` for a set of features: (scene, trees, p, cell, visits) -> Look."""
    closest_hit = closest_function(features.instances)
    owner_of = make_owner_of(features.instances)

    @wp.func
    def look_along(scene: wp.ref[Scene], trees: wp.ref[Trees], p: Vertex, cell: wp.int32, visits: wp.int32) -> Look:
        """What a path's ray meets, as visit_paths finds it.

        Args:
            p: with (prim >= 0) what its ray meets in the cell, or as it sets out.
            visits: 1 where it comes from other cells, or from its home, with (prim >= 0) its best hit so far. Else 0.
        """
        look = Look()
        look.hit = hit_of(p)
        look.owner = cell
        look.onward = -1
        if visits == 1 and p.prim >= 0:
            look.owner = p.owner
        if p.prim < 0 or visits == 1:
            look.hit = closest_hit(trees, p.origin, p.direction, look.hit)
            if cell != WHOLE_SCENE:
                if look.hit.prim != p.prim:
                    look.owner = owner_of(scene.cells, scene.surfaces, look.hit)
                end = wp.where(look.hit.prim >= 0, look.owner, -1)
                look.onward = next_cell_of(scene.cells, p.origin, p.direction, look.hit.t, end, cell, 1 - visits)
        return look

    return look_along


@wp.func
def has_room(leaving: wp.ref[Leaving], notes: wp.ref[Notes], shots: wp.int32, vertices: wp.int32) -> wp.bool:
    """Whether the lists have room for all of so many vertices with so many shadow rays each."""
    parts = notes.counts[TOLD] + vertices * (shots + _PARTS_A_VERTEX) <= leaving.parts.slot.shape[0]
    return parts and notes.counts[SHOTS_LEFT] + vertices * shots <= leaving.shots.slot.shape[0]


@wp.func
def leave_by_path(p: Vertex, look: Look, within: Within, paths_out: wp.ref[LeavingPaths], notes: wp.ref[Notes]) -> None:
    """Have a path go on elsewhere: with this best hit, which may be final."""
    p.t = look.hit.t
    p.prim = look.hit.prim
    p.u = look.hit.u
    p.v = look.hit.v
    p.owner = wp.where(look.hit.prim >= 0, look.owner, -1)
    n = notes.counts[PATHS_LEFT]
    _store_leaving(p, n, paths_out)
    paths_out.whose[n] = within.whose
    paths_out.onward[n] = look.onward
    count(notes, PATHS_LEFT, 1)


@wp.func
def leave_by_shot(
    shots: wp.ref[Shots],
    j: wp.int32,
    onward: wp.int32,
    within: Within,
    shots_out: wp.ref[LeavingShots],
    notes: wp.ref[Notes],
) -> None:
    """Have shadow segment j go on to another cell."""
    n = notes.counts[SHOTS_LEFT]
    shots_out.slot[n] = shots.slot[j]
    shots_out.place[n] = shots.place[j]
    shots_out.origin[n] = shots.origin[j]
    shots_out.direction[n] = shots.direction[j]
    shots_out.radiance[n] = shots.radiance[j]
    shots_out.whose[n] = within.whose
    shots_out.onward[n] = onward
    count(notes, SHOTS_LEFT, 1)


@wp.func
def tell(
    slot: wp.int32,
    place: wp.int32,
    radiance: wp.vec3,
    within: Within,
    parts_out: wp.ref[Parts],
    notes: wp.ref[Notes],
) -> None:
    """Bring light home, if there is any."""
    if radiance[0] != 0.0 or radiance[1] != 0.0 or radiance[2] != 0.0:
        n = notes.counts[TOLD]
        parts_out.slot[n] = slot
        parts_out.place[n] = place
        parts_out.radiance[n] = radiance
        parts_out.whose[n] = within.whose
        count(notes, TOLD, 1)


@wp.func
def place_of_emission(p: Vertex, light_samples: wp.int32) -> wp.int32:
    """Where light that a vertex, or what lies beyond the scene, sends out itself stands in its sample."""
    # A lamp that the ray of the first diffuse scattering meets is direct light.
    return place_of(p.bounce, wp.max(p.diffuse - 1, 0), light_samples, light_samples + EMISSION_PART)


@wp.func
def is_gather_ray(p: Vertex, orders: Orders, first_ray: wp.int32) -> wp.bool:
    """Whether a path is a gather ray of a record where it arrives.

    Args:
        first_ray: number of a record's first.
    """
    return orders.diffuse_light == BY_FINAL_GATHER and p.bounce == 1 and p.sample >= first_ray


@wp.func
def tell_of_vertex(
    p: Vertex,
    found: Found,
    orders: Orders,
    within: Within,
    first_out: wp.ref[FirstVertices],
    parts_out: wp.ref[Parts],
    notes: wp.ref[Notes],
) -> None:
    """Bring home what a vertex shows. Of a first one the rest is told once its path is at its end: tell_of_first."""
    each = orders.light_samples
    if p.bounce == 0:
        n = notes.counts[SEEN]
        first_out.emission[n] = found.emission
        first_out.indirect[n] = found.indirect
    else:
        tell(p.slot, place_of_emission(p, each), found.emission, within, parts_out, notes)
        tell(
            p.slot, place_of(p.bounce, p.diffuse, each, each + INDIRECT_PART), found.indirect, within, parts_out, notes
        )
        if is_gather_ray(p, orders, within.first_ray):
            place = place_of(p.bounce, p.diffuse, each, each + REACH_PART)
            how_far = wp.vec3(p.t * wp.length(p.direction), 0.0, 0.0)
            tell(p.slot, place, how_far, within, parts_out, notes)
    tell(p.slot, place_of(p.bounce, p.diffuse, each, each + CAUSTIC_PART), found.caustic, within, parts_out, notes)


@wp.func
def left_by(notes: wp.ref[Notes]) -> wp.int32:
    """How much has left the cell so far."""
    return notes.counts[SHOTS_LEFT] + notes.counts[PATHS_LEFT]


@wp.func
def tell_of_ray(
    slot: wp.int32,
    radiance: wp.vec3d,
    distance: wp.float32,
    told: wp.int32,
    within: Within,
    gathered_out: wp.ref[GatheredRays],
    notes: wp.ref[Notes],
) -> None:
    """Bring home a gather ray of which nothing has left the cell, in place of the parts that were told of it.

    Args:
        told: how many parts there were before it.
    """
    notes.counts[TOLD] = told
    n = notes.counts[RAYS_GATHERED]
    gathered_out.slot[n] = slot
    gathered_out.radiance[n] = radiance
    gathered_out.distance[n] = distance
    gathered_out.whose[n] = within.whose
    count(notes, RAYS_GATHERED, 1)
