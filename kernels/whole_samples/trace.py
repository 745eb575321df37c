"""Samples of pixels, and gather rays of records, to the end of their paths in one launch, as far as a cell reaches.

Between cells rays, hits and shadow rays travel as batches, and each step of a path is a launch of its own. With one
cell nothing travels, and to write down what a ray found, sort it and read it again takes longer than to find it. So
here a path is followed to its end, by the functions of those kernels and with their random numbers, and what its
vertices show is added in the order of their places (vertices.place_of, add_samples): the bits are the same.

Gather rays of irradiance records (record_rays) are paths that have left their first surface. And in one of several
cells, paths that have come to a surface there are followed until they leave it; what they show is written down
(leaving), and added at home. One kernel follows all, since nearly all of it is the same, and takes long to compile.

Nothing is said of what is not finite, nor of paths that are cut off, nor of photons in one place. Samples that meet any
of it are told of, and whoever launched this has them rendered in the other way, which counts such things.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.add_samples import Sums
from wdpm.kernels.camera.camera import whole_pixel
from wdpm.kernels.camera.misses import make_escaped
from wdpm.kernels.camera.paths import Paths, Vertex, camera_path
from wdpm.kernels.camera.rays import Rays, make_first_path, make_first_vertex
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.shading import make_shade
from wdpm.kernels.camera.shadow_rays import SEGMENT_END, Passage, make_pass_through
from wdpm.kernels.camera.vertices import BY_FINAL_GATHER, BY_PATHS, SHOTS_LATER, TRACE_ON, Orders, Shaded
from wdpm.kernels.features import Features
from wdpm.kernels.irradiance.record_rays import ArrivedRays, Sites, record_path
from wdpm.kernels.limits import CHAIN_LIMIT
from wdpm.kernels.made_for import made_for
from wdpm.kernels.maths.sample_numbers import item_of_sample
from wdpm.kernels.photons.gather import INT_SCRATCH, KEY_SCRATCH
from wdpm.kernels.rays.cells import cell_of, cell_on_way, may_meet, next_cell_of
from wdpm.kernels.rays.triangle import Hit
from wdpm.kernels.rays.two_level import Trees, any_function, closest_function
from wdpm.kernels.whole_samples.indirect_light import (
    SEEN,
    SPOILT,
    TOLD,
    VERTICES,
    Decision,
    KnownLight,
    Notes,
    count,
    make_decide,
    make_indirect_light,
)
from wdpm.kernels.whole_samples.leaving import (
    WHOLE_SCENE,
    Found,
    Leaving,
    Within,
    has_room,
    is_gather_ray,
    leave_by_path,
    leave_by_shot,
    left_by,
    make_look_along,
    place_of_emission,
    tell,
    tell_of_ray,
    tell_of_vertex,
)
from wdpm.kernels.whole_samples.sample import (
    Pixel,
    Sample,
    load_pixel,
    store_pixel,
    tell_of_first,
    tell_of_pixel,
    with_sample,
    with_vertex,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_CHAIN_LIMIT = wp.constant(CHAIN_LIMIT)
_INF = wp.constant(wp.float32(float("inf")))


@wp.struct
class Pixels:
    """Whose samples are wanted.

    Attributes:
        pixel: numbers of the pixels.
        first: number of the first sample of each.
        weight: of each sample, pixel by pixel; none where all weigh 1.
    """

    pixel: wp.array[wp.int32]
    first: wp.array[wp.int32]
    weight: wp.array[wp.float32]


@wp.func
def arrived_at(p: Vertex, hit: Hit) -> Vertex:
    """A path where its ray ends."""
    p.t = hit.t
    p.prim = hit.prim
    p.u = hit.u
    p.v = hit.v
    return p


@wp.func
def orders_at(orders: Orders, bounce: wp.int32) -> Orders:
    """What is asked of a vertex, by what is asked of first ones."""
    if bounce > 0:
        orders.shots = SHOTS_LATER
    return orders


@functools.cache
def make_arriving(features: Features) -> wp.Function:
    """The function `arriving` for a set of features: (scene, trees, j, within, scratch, leaving, notes) -> radiance."""
    closest_hit = closest_function(features.instances)
    any_hit = any_function(features.instances)
    pass_through = make_pass_through(features)

    @wp.func
    def arriving(
        scene: wp.ref[Scene],
        trees: wp.ref[Trees],
        j: wp.int32,
        within: Within,
        scratch: wp.ref[Shaded],
        leaving: wp.ref[Leaving],
        notes: wp.ref[Notes],
    ) -> wp.vec3:
        """What of the light of shadow ray j arrives, as far as the cell knows: others may be asked about the rest."""
        radiance = scratch.shots.radiance[j]
        if wp.max(radiance) > 0.0:
            origin = scratch.shots.origin[j]
            direction = scratch.shots.direction[j]
            onward = within.cell
            if within.cell != WHOLE_SCENE:
                if wp.static(features.walks):  # it is walked by other kernels, from the cell where it begins
                    onward = cell_on_way(scene.cells, origin, direction, SEGMENT_END, -1, -1, True)
                    onward = wp.where(onward < 0, within.cell, onward)
                    leave_by_shot(scratch.shots, j, onward, within, leaving.shots, notes)
                    return wp.vec3(0.0)
            if wp.static(not features.walks):
                asks = wp.bool(True)
                if within.cell != WHOLE_SCENE:
                    asks = may_meet(scene.cells, within.cell, origin, direction, SEGMENT_END)
                if asks:
                    if any_hit(trees, origin, direction, SEGMENT_END):
                        return wp.vec3(0.0)
                if within.cell != WHOLE_SCENE:
                    end = cell_of(scene.cells, origin + direction)
                    onward = next_cell_of(scene.cells, origin, direction, SEGMENT_END, end, within.cell, 1)
                if onward >= 0:
                    leave_by_shot(scratch.shots, j, onward, within, leaving.shots, notes)
                    return wp.vec3(0.0)
            if wp.static(features.walks):
                way = Passage()
                way.origin = origin
                way.direction = direction
                way.radiance = radiance
                way.medium = -1
                end = Hit()
                end.t = SEGMENT_END
                end.prim = -1
                met = closest_hit(trees, origin, direction, end)
                while met.prim >= 0:
                    way = pass_through(scene, way, met)
                    met = end
                    if way.ahead == 1:
                        met = closest_hit(trees, way.origin, way.direction, end)
                return way.radiance
            return radiance
        return wp.vec3(0.0)

    return arriving


@wp.func
def finite_or_spoilt(radiance: wp.vec3, notes: wp.ref[Notes]) -> wp.vec3:
    """What contributes to a sample, which is spoilt if that is not finite."""
    if not wp.isfinite(radiance):
        count(notes, SPOILT, 1)
    return radiance


@functools.cache
def make_light_at(features: Features) -> wp.Function:
    """The function `light_at` for a set of features: (scene, known, p, orders, scratch, keys, ints, notes) -> Found."""
    shade = make_shade(features)
    decide = make_decide(features)
    indirect_light = make_indirect_light(features)
    at_vertex = indirect_light.at_vertex
    caustics = indirect_light.caustics

    @wp.func
    def light_at(
        scene: wp.ref[Scene],
        known: wp.ref[KnownLight],
        p: Vertex,
        orders: Orders,
        scratch: wp.ref[Shaded],
        keys: wp.array[wp.uint64],
        ints: wp.array[wp.int32],
        notes: wp.ref[Notes],
    ) -> Found:
        """What a vertex shows besides the light of its shadow rays, which are left in the scratch.

        Args:
            orders: of this vertex.
        """
        found = Found()
        decision = Decision()
        p.action = TRACE_ON
        if wp.static(features.traced):
            if orders.diffuse_light == BY_FINAL_GATHER:
                decision = decide(scene, known, p, orders.max_depth, keys, ints, notes)
                p.action = decision.action
        shade(scene, p, orders, scratch)
        found.emission = finite_or_spoilt(scratch.seen.emission[0], notes)
        if orders.diffuse_light != BY_PATHS:
            light = at_vertex(known, p, decision, orders, scratch, keys, ints, notes)
            found.indirect = finite_or_spoilt(light, notes)
            light = caustics(known, p, decision, orders, scratch, keys, ints, notes)
            found.caustic = finite_or_spoilt(light, notes)
        return found

    return light_at


@functools.cache
def make_trace(features: Features) -> wp.Function:
    """The function `trace` for a set of features: one path, by (scene, trees, known, p, weight, ...)."""
    look_along = make_look_along(features)
    arriving = make_arriving(features)
    escaped = make_escaped(features)
    light_at = make_light_at(features)

    @wp.func
    def trace(
        scene: wp.ref[Scene],
        trees: wp.ref[Trees],
        known: wp.ref[KnownLight],
        p: Vertex,
        weight: wp.float32,
        orders: Orders,
        within: Within,
        scratch: wp.ref[Shaded],
        leaving: wp.ref[Leaving],
        keys: wp.array[wp.uint64],
        ints: wp.array[wp.int32],
        notes: wp.ref[Notes],
    ) -> Sample:
        """One path: to its end, or to where it leaves the cell. What it comes to within one of several is written down
        too.

        Args:
            p: as its first ray sets out or comes by (within.visits), or (prim >= 0) with what that met.
            orders: of first vertices.
            scratch: of one vertex, for all of the path, one after another.
            keys, ints: scratch of gathers.
        """
        sample = Sample()
        sample.depth = -1.0
        sample.reach = _INF
        begins = p.bounce
        visits = within.visits
        p.row = 0
        goes_on = wp.int32(1)
        while goes_on == 1:
            goes_on = 0
            look = look_along(scene, trees, p, within.cell, visits)
            visits = 0
            now = orders_at(orders, p.bounce)
            stays = look.onward < 0
            if within.cell != WHOLE_SCENE:
                if stays and look.hit.prim >= 0:
                    stays = look.owner == within.cell and has_room(leaving, notes, orders.shots, 1 + within.later)
                if not stays:
                    leave_by_path(p, look, within, leaving.paths, notes)
            if stays and look.hit.prim < 0:
                if wp.static(features.misses):
                    beyond = finite_or_spoilt(escaped(scene, p, orders, scratch.stretches), notes)
                    if within.cell != WHOLE_SCENE:
                        place = place_of_emission(p, orders.light_samples)
                        tell(p.slot, place, beyond, within, leaving.parts, notes)
                    if p.diffuse > 1:
                        sample.indirect += wp.vec3d(beyond * weight)
                    else:
                        sample.direct += wp.vec3d(beyond * weight)
            elif stays:
                p = arrived_at(p, look.hit)
                if p.bounce == begins:
                    sample.reach = p.t * wp.length(p.direction)
                found = light_at(scene, known, p, now, scratch, keys, ints, notes)
                lit = wp.vec3d()
                for j in range(now.shots):
                    finite_or_spoilt(scratch.shots.radiance[j], notes)
                    arrives = arriving(scene, trees, j, within, scratch, leaving, notes)
                    if within.cell != WHOLE_SCENE:
                        tell(p.slot, scratch.shots.place[j], arrives, within, leaving.parts, notes)
                    lit += wp.vec3d(arrives * weight)
                if within.cell != WHOLE_SCENE:
                    tell_of_vertex(p, found, orders, within, leaving.first, leaving.parts, notes)
                if p.bounce > 0:
                    count(notes, VERTICES, 1)
                sample = with_vertex(sample, p, found, lit, weight, orders)
                if p.bounce == 0:
                    sample.depth = scratch.seen.depth[0]
                    sample.normal = scratch.seen.normal[0] * weight
                    sample.albedo = scratch.seen.albedo[0] * weight
                if wp.static(features.goes_on):
                    throughput = finite_or_spoilt(scratch.paths.throughput[0], notes)
                    if scratch.paths.bounce[0] >= _CHAIN_LIMIT:
                        count(notes, SPOILT, 1)
                    elif wp.max(throughput) > 0.0 and wp.isfinite(throughput):
                        p = camera_path(scene.camera, scratch.paths, 0)
                        goes_on = 1
        return sample

    return trace


@wp.func
def arrived_ray(
    scene: wp.ref[Scene], sites: wp.ref[Sites], rays: wp.ref[ArrivedRays], i: wp.int32, first_sample: wp.int32
) -> Vertex:
    """A gather ray where it arrives."""
    sample = first_sample + rays.ray[i]
    offset_min = scene.lights.offset_min
    p = record_path(sites, rays.record[i], sample, rays.direction[i], scene.camera.medium, offset_min)
    p.item = item_of_sample(whole_pixel(scene.camera, p.pixel), p.sample)
    p.t = rays.t[i]
    p.prim = rays.prim[i]
    p.u = rays.u[i]
    p.v = rays.v[i]
    return p


@functools.cache
def make_trace_samples(features: Features) -> wp.Kernel:
    """The kernel `trace_samples` for a set of features without media."""
    first_path = make_first_path(features)
    first_vertex = make_first_vertex(features)
    trace = make_trace(features)

    @made_for(features)
    def trace_samples(
        scene: Scene,
        trees: Trees,
        known: KnownLight,
        pixels: Pixels,
        sites: Sites,
        rays: ArrivedRays,
        paths: Paths,
        camera_rays: Rays,
        together: wp.array[wp.int32],
        cell: wp.int32,
        visits: wp.int32,
        start: wp.int32,
        samples: wp.int32,
        orders: Orders,
        sums: Sums,
        first: wp.int32,
        end: wp.int32,
        scratch: Shaded,
        notes: Notes,
        leaving_out: Leaving,
        sums_out: Sums,
        hit_out: wp.array[wp.int32],
        radiance_out: wp.array[wp.vec3d],
        distance_out: wp.array[wp.float32],
    ) -> None:
        """Add samples `start` to `start + samples` of some pixels to their sums, as add_samples does. On the CPU alone.

        Or find what comes along gather rays of records: where there are any, they are its items in place of pixels.
        Or follow paths or camera rays within one of several cells, which then are its items.

        It is launched for one item, which is pixels `first` to `end`: one sample is traced after another.

        Args:
            sites: of the records.
            paths, camera_rays: with final hits in the cell, or on their way through it.
            together: of camera rays, as kernels.ray_fields.START; without any, each comes home alone.
            cell: its number; WHOLE_SCENE where it is the only one.
            visits: 1 where they are on their way. Else 0.
            start: of gather rays, and of paths, the number of a record's first.
            orders: of first vertices.
            sums: so far.
            scratch: of one vertex, and of this launch alone.
            notes: of this launch alone.
            leaving_out: what is written down of paths, by their places from `first` on.
            hit_out: 1 where the first of the samples met a surface.
            radiance_out: what came along each gather ray, its parts added in their order.
            distance_out: how far it went [scene units].
        """
        keys = wp.zeros(shape=(KEY_SCRATCH,), dtype=wp.uint64)
        ints = wp.zeros(shape=(INT_SCRATCH,), dtype=wp.int32)
        within = Within()
        within.cell = cell
        within.first_ray = start
        within.visits = visits
        i = first + wp.tid()
        while i < end:
            rows = wp.int32(1)
            if cell != WHOLE_SCENE:
                told = notes.counts[TOLD]
                seen = notes.counts[SEEN]
                left = left_by(notes)
                if together.shape[0] > 0 and together[i] > 1:
                    rows = wp.min(together[i], end - i)
                pixel = Pixel()
                for s in range(rows):
                    within.whose = i + s - first
                    within.later = end - 1 - i - s
                    p = Vertex()
                    if camera_rays.pixel.shape[0] > 0:
                        p = first_vertex(scene.camera, camera_rays, i + s)
                    else:
                        p = camera_path(scene.camera, paths, i + s)
                    found = trace(scene, trees, known, p, 1.0, orders, within, scratch, leaving_out, keys, ints, notes)
                    pixel = with_sample(pixel, found)
                    if s == 0:
                        pixel.slot = p.slot
                        pixel.cell = wp.where(found.depth >= 0.0, cell, -1)
                    if p.bounce == 0:
                        tell_of_first(p.slot, found, within, leaving_out.first, notes)
                    elif is_gather_ray(p, orders, start) and left_by(notes) == left:
                        radiance = found.direct + found.indirect
                        tell_of_ray(p.slot, radiance, found.reach, told, within, leaving_out.gathered, notes)
                if rows > 1 and rows == together[i] and left_by(notes) == left:
                    tell_of_pixel(pixel, told, seen, within, leaving_out.pixels, notes)
            elif rays.prim.shape[0] > 0:
                p = arrived_ray(scene, sites, rays, i, start)
                found = trace(scene, trees, known, p, 1.0, orders, within, scratch, leaving_out, keys, ints, notes)
                radiance_out[i] = found.direct + found.indirect
                distance_out[i] = found.reach
            else:
                pixel = load_pixel(sums, i)
                hit_out[i] = 0
                for s in range(samples):
                    weight = wp.float32(1.0)
                    if pixels.weight.shape[0] > 0:
                        weight = pixels.weight[i * samples + s]
                    p = first_path(scene.camera, pixels.pixel[i], pixels.first[i] + start + s)
                    found = trace(
                        scene, trees, known, p, weight, orders, within, scratch, leaving_out, keys, ints, notes
                    )
                    pixel = with_sample(pixel, found)
                    if s == 0 and found.depth >= 0.0:
                        hit_out[i] = 1
                store_pixel(pixel, i, sums_out)
                sums_out.volume[i] = sums.volume[i]
            i += rows

    return trace_samples
