"""Indirect light of diffuse parts at one vertex of a camera path: read, interpolated or gathered where it is needed.

What launches of their own do for batches of vertices (cluster.work.final_gather, cluster.work.photon_gathers), by the
same functions.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import warp as wp

from wdpm.kernels.camera.gather_glossy import make_gather_at
from wdpm.kernels.camera.paths import Vertex
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.vertices import (
    BY_FINAL_GATHER,
    BY_MAP,
    CACHED,
    TRACE_ON,
    Coats,
    Orders,
    Queries,
    Shaded,
    share_by_grazing,
)
from wdpm.kernels.constants import INV_PI
from wdpm.kernels.features import Features
from wdpm.kernels.irradiance.arrivals import arrive
from wdpm.kernels.irradiance.cache import interpolated
from wdpm.kernels.irradiance.gather_places import Place, place_at
from wdpm.kernels.irradiance.lit_places import make_lit_place
from wdpm.kernels.irradiance.record_tree import IrradianceCache
from wdpm.kernels.photons.gather_guess import follow
from wdpm.kernels.photons.photon_map import PhotonMap
from wdpm.kernels.photons.surface_points import of_surface

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# What is counted, as cluster.work counts it for batches.
VERTICES = wp.constant(0)
SPOILT = wp.constant(1)
GATHERS = wp.constant(2)
TRUNCATED = wp.constant(3)
RAYS = wp.constant(4)
SHORT = wp.constant(5)
UNREAD = wp.constant(6)
INTERPOLATED = wp.constant(7)
UNCOVERED = wp.constant(8)
# Of what leaves a cell: how long the lists of kernels.whole_samples.leaving are.
TOLD = wp.constant(9)
SHOTS_LEFT = wp.constant(10)
PATHS_LEFT = wp.constant(11)
RAYS_GATHERED = wp.constant(12)
SEEN = wp.constant(13)
PIXELS_DONE = wp.constant(14)
COUNTS = wp.constant(15)

# Of what is remembered of gathers.
_OF_GLOBAL_MAP = wp.constant(0)
_OF_CAUSTIC_MAP = wp.constant(1)
GATHERED_MAPS = wp.constant(2)


@wp.struct
class GatheredMap:
    """A photon map that vertices of camera paths ask.

    Attributes:
        there: 1 where there is one.
        edges: of the photons' paths, in the order of their numbers.
        points: its surface points.
        k: photons that a gather looks for where the camera looks.
        k_of_rays: the same where a gather ray arrives.
        r_max, r_least: as of gathers.
        point_area: the area that each surface point stands for.
        scale: 1 / photon paths.
        run, asks: where the camera looks, of each run of so many samples of a pixel the first `asks` ask.
        share: samples that one which asks stands for.
    """

    there: wp.int32
    photons: PhotonMap
    edges: wp.array[wp.int32]
    points: PhotonMap
    k: wp.int32
    k_of_rays: wp.int32
    r_max: wp.float32
    r_least: wp.float32
    point_area: wp.float32
    scale: wp.float32
    run: wp.int32
    asks: wp.int32
    share: wp.float32


@wp.struct
class KnownLight:
    """What is known of indirect light before samples are traced.

    Attributes:
        global_map, caustic_map: that vertices ask themselves.
        read_ahead: 1 where there is irradiance at photons.
        points: that irradiance.
        reach: how far away it may be read.
        longest: edges of the longest paths that bring light to it.
        interpolates: 1 where there are irradiance records.
        records: these.
        rounds: that they were made in.
        wanted: least weight of records where a gather ray reads them.
        even_sides: of each material, as scenes.flat.material_sides has them.
    """

    global_map: GatheredMap
    caustic_map: GatheredMap
    read_ahead: wp.int32
    points: PhotonMap
    reach: wp.float32
    longest: wp.int32
    interpolates: wp.int32
    records: IrradianceCache
    rounds: wp.int32
    wanted: wp.float32
    even_sides: wp.array[wp.int32]


@wp.struct
class Notes:
    """What one launch keeps from sample to sample.

    Attributes:
        counts: by the numbers VERTICES and so on, shape [COUNTS].
        radius: of the last gather of each map, 0 before the first, shape [GATHERED_MAPS].
        place: of that gather.
    """

    counts: wp.array[wp.int32]
    radius: wp.array[wp.float32]
    place: wp.array[wp.vec3]


@wp.struct
class Decision:
    """What the diffuse part of a vertex does, and what is known of its light.

    Attributes:
        action: TRACE_ON or CACHED.
        by_photons: 1 where a gather ray ends, which is told by photons.
        by_length: 1 where irradiance at photons may be of longer paths than there are to be.
        radiance: what a white Lambertian surface reflects there, if the action is CACHED.
        grazing: how much that light grazes the surface (kernels.maths.schlick).
    """

    action: wp.int32
    by_photons: wp.int32
    by_length: wp.int32
    radiance: wp.vec3
    grazing: wp.float32


@dataclass(frozen=True)
class IndirectLight:
    """Functions for indirect light at vertices.

    Attributes:
        at_vertex: (known, p, decision, orders, scratch, keys, ints, notes) -> radiance by the global map.
        caustics: the same for the caustic map.
    """

    at_vertex: wp.Function
    caustics: wp.Function


@wp.func
def count(notes: wp.ref[Notes], what: wp.int32, times: wp.int32) -> None:
    """Count something of a vertex."""
    notes.counts[what] = notes.counts[what] + times


@wp.func
def may_be_cached(known: wp.ref[KnownLight], place: Place) -> wp.bool:
    """Whether there are records, and the diffuse part of the seen side is even."""
    return known.interpolates == 1 and (known.even_sides[place.side >> 1] & (2 - (place.side & 1))) != 0


@functools.cache
def make_decide(features: Features) -> wp.Function:
    """The function `decide` for surfaces with a set of features."""
    lit_place = make_lit_place(features)

    @wp.func
    def decide(
        scene: wp.ref[Scene],
        known: wp.ref[KnownLight],
        p: Vertex,
        max_depth: wp.int32,
        keys: wp.array[wp.uint64],
        ints: wp.array[wp.int32],
        notes: wp.ref[Notes],
    ) -> Decision:
        """What the diffuse part of a vertex does in BY_FINAL_GATHER, as cluster.work.final_gather decides.

        Args:
            p: as it arrives on a surface.
            keys, ints: scratch of gathers.
        """
        decision = Decision()
        decision.action = TRACE_ON
        decision.by_length = wp.int32(max_depth > 0 and p.edges + known.longest > max_depth)
        place = place_at(scene.surfaces, p.direction, p.t, p.prim, p.u, p.v)
        if wp.static(features.translucent):
            place = lit_place(scene, p, place)
        if p.diffuse > 0:
            count(notes, RAYS, 1)
            near = wp.int32(0)
            if known.read_ahead == 1:
                arrival = arrive(known.points, place, p.diffuse, known.reach, keys)
                near = arrival.found
                if arrival.code == CACHED:
                    decision.action = CACHED
                    decision.by_photons = 1
                    decision.radiance = arrival.value
                    decision.grazing = arrival.grazing
            # What records read was read by others before them, at most one of each round.
            too_long = max_depth > 0 and p.edges + known.rounds + known.longest > max_depth
            if decision.action == TRACE_ON and not too_long and may_be_cached(known, place):
                told = interpolated(known.records, place.position, place.shading_normal, ints, keys)
                if told.weight > 0.0 and told.weight >= known.wanted:
                    decision.action = CACHED
                    decision.radiance = told.irradiance * INV_PI
                    decision.grazing = told.grazing
            if decision.action == TRACE_ON:
                count(notes, UNREAD, 1 - near)
                count(notes, SHORT, near)
        else:
            # Records are made for paths of one edge: from others all light is as many edges longer.
            too_long = max_depth > 0 and p.edges > 1 and p.edges + 1 + known.longest > max_depth
            if not too_long and may_be_cached(known, place):
                told = interpolated(known.records, place.position, place.shading_normal, ints, keys)
                if told.weight > 0.0:
                    decision.action = CACHED
                    decision.radiance = told.irradiance * INV_PI
                    decision.grazing = told.grazing
                    count(notes, INTERPOLATED, 1)
                else:
                    count(notes, UNCOVERED, 1)
        return decision

    return decide


@functools.cache
def make_reflected(features: Features) -> wp.Function:
    """The function `reflected` for surfaces with a set of features."""
    gather_at = make_gather_at(features)

    @wp.func
    def reflected(
        of_map: wp.ref[GatheredMap],
        number: wp.int32,
        diffuse: wp.int32,
        queries: wp.ref[Queries],
        coats: wp.ref[Coats],
        max_depth: wp.int32,
        keys: wp.array[wp.uint64],
        ints: wp.array[wp.int32],
        notes: wp.ref[Notes],
    ) -> wp.vec3:
        """Radiance that a vertex reflects of the photons of a map.

        Args:
            number: of what is remembered of its last gather.
            diffuse: vertices before it that reflected diffusely: above 0 a gather ray arrives.
            queries, coats: of the vertex alone.
        """
        k = of_map.k
        if diffuse > 0:
            k = of_map.k_of_rays
        x = queries.position[0]
        guess = wp.float32(0.0)
        if notes.radius[number] > 0.0:
            guess = follow(notes.radius[number], wp.length(x - notes.place[number]))
        found = gather_at(
            of_map.photons,
            of_map.edges,
            queries,
            coats,
            0,
            k,
            of_map.r_max,
            of_map.r_least,
            max_depth,
            guess,
            keys,
            ints,
        )
        notes.radius[number] = found.radius
        notes.place[number] = x
        count(notes, GATHERS, 1)
        if found.truncated:
            count(notes, TRUNCATED, 1)
        elif found.radius == of_map.r_max:  # perhaps of photons that all lie in one place, which is told of
            count(notes, SPOILT, 1)
        incoming = of_surface(
            of_map.points,
            x,
            queries.front_normal[0],
            queries.clearance[0],
            found.irradiance,
            found.radius,
            of_map.point_area,
            of_map.r_max,
            ints,
        )
        return wp.cw_mul(queries.weight[0], incoming) * (INV_PI * of_map.scale)

    return reflected


@functools.cache
def make_even(features: Features) -> wp.Function:
    """The function `is_even` for surfaces with a set of features."""

    @wp.func
    def is_even(coats: wp.ref[Coats]) -> wp.bool:
        """Whether irradiance tells what the diffuse part of a vertex reflects."""
        even = wp.bool(True)
        if wp.static(features.coated):
            even = coats.even[0]
        return even

    return is_even


@functools.cache
def make_indirect_light(features: Features) -> IndirectLight:
    """The functions for surfaces with a set of features."""
    reflected = make_reflected(features)
    is_even = make_even(features)

    @wp.func
    def at_vertex(
        known: wp.ref[KnownLight],
        p: Vertex,
        decision: Decision,
        orders: Orders,
        scratch: wp.ref[Shaded],
        keys: wp.array[wp.uint64],
        ints: wp.array[wp.int32],
        notes: wp.ref[Notes],
    ) -> wp.vec3:
        """Indirect light that is known at a vertex, by photons or by what was computed from them."""
        asks = orders.diffuse_light == BY_MAP
        radiance = wp.vec3(0.0)
        if wp.static(features.traced):
            if orders.diffuse_light == BY_FINAL_GATHER:
                even = is_even(scratch.coats)
                asks = decision.by_photons == 1 and (not even or decision.by_length == 1)
                if even and not asks and decision.action != TRACE_ON:
                    radiance = wp.cw_mul(scratch.queries.weight[0], decision.radiance)
                    if wp.static(features.coated):
                        radiance = wp.cw_mul(radiance, scratch.coats.reflectance[0])
                        radiance = radiance * share_by_grazing(scratch.coats.grazing_gain[0], decision.grazing)
        if asks and known.global_map.there == 1 and wp.max(scratch.queries.weight[0]) > 0.0:
            radiance = reflected(
                known.global_map,
                _OF_GLOBAL_MAP,
                p.diffuse,
                scratch.queries,
                scratch.coats,
                orders.max_depth,
                keys,
                ints,
                notes,
            )
        return radiance

    @wp.func
    def caustics(
        known: wp.ref[KnownLight],
        p: Vertex,
        decision: Decision,
        orders: Orders,
        scratch: wp.ref[Shaded],
        keys: wp.array[wp.uint64],
        ints: wp.array[wp.int32],
        notes: wp.ref[Notes],
    ) -> wp.vec3:
        """Light of the caustic map at a vertex; irradiance that was computed ahead has it in it."""
        radiance = wp.vec3(0.0)
        asks = known.caustic_map.there == 1 and wp.max(scratch.queries.weight[0]) > 0.0
        if asks and p.diffuse <= 0:
            asks = p.sample % known.caustic_map.run < known.caustic_map.asks
        if asks:
            ahead = decision.by_photons == 1 and decision.by_length == 0
            if not (ahead and is_even(scratch.coats)):
                radiance = reflected(
                    known.caustic_map,
                    _OF_CAUSTIC_MAP,
                    p.diffuse,
                    scratch.queries,
                    scratch.coats,
                    orders.max_depth,
                    keys,
                    ints,
                    notes,
                )
                if p.diffuse <= 0:
                    radiance = radiance * known.caustic_map.share
        return radiance

    return IndirectLight(at_vertex, caustics)
