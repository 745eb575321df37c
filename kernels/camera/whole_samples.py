"""Samples of pixels from the camera to the end of their paths, in one launch: where one cell is the whole scene.

Elsewhere rays, hits and shadow rays travel between cells as batches, and each step of a path is a launch of its own.
With one cell nothing travels, and to write down what a ray found, sort it and read it again takes longer than to find
it. So here a path is followed to its end, by the functions of those kernels and with their random numbers, and what its
vertices show is added in the order of their places (vertices.place_of, add_samples): the bits are the same.

Nothing is said of what is not finite, nor of paths that are cut off. A pixel that meets any of it is told of, and
whoever launched this has it rendered in the other way, which counts such things.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.add_samples import Sums
from wdpm.kernels.camera.camera import make_camera
from wdpm.kernels.camera.misses import make_escaped
from wdpm.kernels.camera.paths import Vertex, camera_path
from wdpm.kernels.camera.rays import begin_path
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.shading import make_shade
from wdpm.kernels.camera.shadow_rays import SEGMENT_END, Passage, make_pass_through
from wdpm.kernels.camera.vertices import SHOTS_LATER, Orders, Shaded
from wdpm.kernels.features import Features
from wdpm.kernels.limits import CHAIN_LIMIT
from wdpm.kernels.made_for import made_for
from wdpm.kernels.rays.triangle import Hit
from wdpm.kernels.rays.two_level import Trees, any_function, closest_function

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_CHAIN_LIMIT = wp.constant(CHAIN_LIMIT)


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


@wp.struct
class Outcome:
    """What the samples of each pixel came to, besides its sums.

    Attributes:
        hit: 1 where the first of the samples met a surface.
        vertices: of all samples, beyond their first.
        spoilt: 1 where something is not finite, or a path was cut off.
    """

    hit: wp.array[wp.int32]
    vertices: wp.array[wp.int32]
    spoilt: wp.array[wp.int32]


@wp.struct
class Sample:
    """What one sample comes to; depth is negative where it met nothing."""

    direct: wp.vec3d
    indirect: wp.vec3d
    normal: wp.vec3
    albedo: wp.vec3
    depth: wp.float32
    vertices: wp.int32
    spoilt: wp.int32


@wp.func
def hit_of(p: Vertex) -> Hit:
    """The best hit so far of a path's ray."""
    hit = Hit()
    hit.t = p.t
    hit.prim = p.prim
    hit.u = p.u
    hit.v = p.v
    return hit


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
    """The function `arriving` for a set of features: (scene, trees, j, scratch) -> radiance."""
    closest_hit = closest_function(features.instances)
    any_hit = any_function(features.instances)
    pass_through = make_pass_through(features)

    @wp.func
    def arriving(scene: wp.ref[Scene], trees: wp.ref[Trees], j: wp.int32, scratch: wp.ref[Shaded]) -> wp.vec3:
        """What of the light of shadow ray j arrives."""
        radiance = scratch.shots.radiance[j]
        if wp.max(radiance) > 0.0:
            origin = scratch.shots.origin[j]
            direction = scratch.shots.direction[j]
            if wp.static(not features.walks):
                if any_hit(trees, origin, direction, SEGMENT_END):
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


@functools.cache
def make_trace(features: Features) -> wp.Function:
    """The function `trace` for a set of features: one sample, by (scene, trees, pixel, number, weight, orders, ...)."""
    camera_ray = make_camera(features)
    closest_hit = closest_function(features.instances)
    arriving = make_arriving(features)
    shade = make_shade(features)
    escaped = make_escaped(features)

    @wp.func
    def trace(
        scene: wp.ref[Scene],
        trees: wp.ref[Trees],
        pixel: wp.int32,
        number: wp.int32,
        weight: wp.float32,
        orders: Orders,
        scratch: wp.ref[Shaded],
    ) -> Sample:
        """One sample.

        Args:
            scratch: of one vertex, for all of the path, one after another.
        """
        found = Sample()
        found.depth = -1.0
        p = Vertex()
        p.pixel = pixel
        p.sample = number
        p.row = 0
        ray = camera_ray(scene.camera, pixel, number)
        p.t = ray.t_max
        p.prim = -1
        p = begin_path(scene.camera, ray, p)
        goes_on = wp.int32(1)
        while goes_on == 1:
            goes_on = 0
            met = closest_hit(trees, p.origin, p.direction, hit_of(p))
            if met.prim < 0:
                if wp.static(features.misses):
                    beyond = escaped(scene, p, orders, scratch.stretches)
                    if not wp.isfinite(beyond):
                        found.spoilt = 1
                    if p.diffuse > 1:
                        found.indirect += wp.vec3d(beyond * weight)
                    else:
                        found.direct += wp.vec3d(beyond * weight)
            else:
                p = arrived_at(p, met)
                now = orders_at(orders, p.bounce)
                shade(scene, p, now, scratch)
                lit = wp.vec3d()
                for j in range(now.shots):
                    if not wp.isfinite(scratch.shots.radiance[j]):
                        found.spoilt = 1
                    lit += wp.vec3d(arriving(scene, trees, j, scratch) * weight)
                emission = scratch.seen.emission[0]
                if not wp.isfinite(emission):
                    found.spoilt = 1
                if p.bounce == 0:
                    found.depth = scratch.seen.depth[0]
                    found.normal = scratch.seen.normal[0] * weight
                    found.albedo = scratch.seen.albedo[0] * weight
                    share = wp.float64(1.0) / wp.float64(orders.light_samples)
                    found.direct = wp.vec3d(emission * weight) + lit * share
                else:
                    found.vertices += 1
                    if p.diffuse > 0:
                        found.indirect += lit
                    else:
                        found.direct += lit
                    if p.diffuse > 1:
                        found.indirect += wp.vec3d(emission * weight)
                    else:
                        found.direct += wp.vec3d(emission * weight)
                throughput = scratch.paths.throughput[0]
                if not wp.isfinite(throughput) or scratch.paths.bounce[0] >= _CHAIN_LIMIT:
                    found.spoilt = 1
                elif wp.max(throughput) > 0.0:
                    p = camera_path(scene.camera, scratch.paths, 0)
                    goes_on = 1
        return found

    return trace


@functools.cache
def make_trace_samples(features: Features) -> wp.Kernel:
    """The kernel `trace_samples` for a set of features without media, in which paths go on by diffuse parts."""
    trace = make_trace(features)

    @made_for(features)
    def trace_samples(
        scene: Scene,
        trees: Trees,
        pixels: Pixels,
        start: wp.int32,
        samples: wp.int32,
        orders: Orders,
        sums: Sums,
        offset: wp.int32,
        scratch: Shaded,
        sums_out: Sums,
        outcome_out: Outcome,
    ) -> None:
        """Add samples `start` to `start + samples` of some pixels to their sums, as add_samples does. On the CPU alone.

        Args:
            orders: of first vertices; by BY_PATHS, or by BY_MAP where there are no photons.
            sums: so far.
            scratch: of one vertex, and of this launch alone: one sample is traced after another.
        """
        i = offset + wp.tid()
        direct = sums.direct[i]
        indirect = sums.indirect[i]
        normal = sums.normal[i]
        albedo = sums.albedo[i]
        depth = sums.depth[i]
        hits = sums.hits[i]
        first_hit = wp.int32(0)
        vertices = wp.int32(0)
        spoilt = wp.int32(0)
        for s in range(samples):
            weight = wp.float32(1.0)
            if pixels.weight.shape[0] > 0:
                weight = pixels.weight[i * samples + s]
            found = trace(scene, trees, pixels.pixel[i], pixels.first[i] + start + s, weight, orders, scratch)
            if found.depth >= 0.0:
                hits += 1
                depth += wp.float64(found.depth)
                normal += wp.vec3d(found.normal)
                albedo += wp.vec3d(found.albedo)
                if s == 0:
                    first_hit = 1
            direct += found.direct
            indirect += found.indirect
            vertices += found.vertices
            spoilt = wp.max(spoilt, found.spoilt)
        sums_out.direct[i] = direct
        sums_out.indirect[i] = indirect
        sums_out.caustic[i] = sums.caustic[i]
        sums_out.volume[i] = sums.volume[i]
        sums_out.normal[i] = normal
        sums_out.albedo[i] = albedo
        sums_out.depth[i] = depth
        sums_out.hits[i] = hits
        outcome_out.hit[i] = first_hit
        outcome_out.vertices[i] = vertices
        outcome_out.spoilt[i] = spoilt

    return trace_samples
