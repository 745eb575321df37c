"""The ray that goes on from a vertex on a surface: by one of its parts, or straight through."""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.caustic_guide import (
    CausticGuide,
    guided_direction,
    guided_pdf,
    lobes_at,
    onward_number,
    over_both,
)
from wdpm.kernels.camera.paths import Paths, Vertex
from wdpm.kernels.camera.picked_light import ways_of_vertex
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.vertices import (
    BY_FINAL_GATHER,
    BY_PATHS,
    LOBE,
    Orders,
    carry_on,
    number_1d,
    numbers_2d,
    path_from,
    scattered_again,
)
from wdpm.kernels.constants import (
    INV_PI,
    PI,
    ROULETTE_FROM,
    ROULETTE_FROM_OF_GATHERS,
    ROULETTE_FROM_OF_PATHS,
    SURVIVAL_MOST,
    WEAK_REFLECTION,
    WEAK_REFLECTION_OF_GATHERS,
)
from wdpm.kernels.features import Features
from wdpm.kernels.materials.bsdf import cosine_direction, make_bsdf
from wdpm.kernels.materials.resolve import medium_beyond
from wdpm.kernels.materials.surface import Surface, bump_shading, goes_through, leave, lit_normal, to_local, to_world
from wdpm.kernels.materials.types import BLACK, DIFFUSE, NULL, RADIANCE

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_BELOW_ONE = wp.constant(wp.float32(1 - 2.0**-24))


@wp.struct
class DiffuseWay:
    """A direction in which a path goes on by a diffuse part.

    Attributes:
        local: in the frame of the surface's material.
        over: density by the cosine alone over that with which it was drawn.
    """

    direction: wp.vec3
    local: wp.vec3
    over: wp.float32


@wp.func
def by_diffuse_part(guide: wp.ref[CausticGuide], s: Surface, u: wp.vec2, guided: wp.bool) -> DiffuseWay:
    """A direction drawn by the cosine, or, if paths may be guided, from lobes."""
    way = DiffuseWay()
    way.over = 1.0
    region = wp.int32(-1)
    if guided:
        region = lobes_at(guide, s.position)
    if region < 0:
        way.local = cosine_direction(u)
        way.direction = to_world(s, way.local)
        return way
    part = guide.part[region]
    left = wp.vec2(onward_number(u[0], part), u[1])
    if u[0] < part:
        way.direction = guided_direction(guide, region, s.position, left)
        way.local = to_local(s, way.direction)
    else:
        way.local = cosine_direction(left)
        way.direction = to_world(s, way.local)
    by_lobes = guided_pdf(guide, region, s.position, way.direction)
    way.over = over_both(wp.max(way.local[2], 0.0) * INV_PI, by_lobes, part)
    return way


@functools.cache
def make_go_on(features: Features) -> wp.Function:
    """The function `go_on` for surfaces with a set of features."""
    bsdf = make_bsdf(features)
    has_diffuse = bsdf.has_diffuse
    eval_diffuse = bsdf.eval_diffuse
    sample_glossy = bsdf.sample_glossy

    @wp.func
    def go_on(
        scene: wp.ref[Scene],
        s: Surface,
        p: Vertex,
        w_from: wp.vec3,
        diffuse_share: wp.float32,
        orders: Orders,
        paths_out: wp.ref[Paths],
    ) -> None:
        """The ray that goes on by one part, or straight through; a throughput of zero where none does.

        Args:
            diffuse_share: probability of the diffuse part.
        """
        max_depth = orders.max_depth
        seed = scene.camera.seed
        onward = path_from(p)
        leaves = s.normal
        straight = wp.int32(0)
        through = wp.bool(False)
        u_lobe = wp.float32(0.0)
        if wp.static(features.glossy):
            u_lobe = number_1d(seed, p, LOBE)
        if wp.static(features.passing):
            if s.bsdf.kind == NULL:
                straight = 1
                through = True
                onward.throughput = p.throughput
                leaves = -s.normal
                onward.medium = medium_beyond(scene.materials, s.material, s.front, onward.medium)
        ways = wp.float32(ways_of_vertex(scene.lights, s, p, orders))
        by_diffuse = wp.bool(False)
        worth = wp.float32(1.0)
        if wp.static(features.traced):
            by_diffuse = straight == 0 and diffuse_share > 0.0 and (u_lobe < diffuse_share or diffuse_share == 1.0)
            if by_diffuse:
                leaves = lit_normal(s)
                if s.through == 1:
                    onward.medium = medium_beyond(scene.materials, s.material, s.front, onward.medium)
                way = by_diffuse_part(scene.caustics, s, numbers_2d(seed, p), orders.diffuse_light == BY_PATHS)
                w_to = way.local
                onward.direction = way.direction
                # Shadow rays know of this density alone. Lamps that a ray meets count by it whichever way it was drawn:
                # what both weigh by has to be the same, and need not be what the ray was drawn by.
                onward.pdf = diffuse_share * (wp.max(w_to[2], 0.0) * INV_PI) / ways
                onward.anchor = s.position
                onward.edges = p.edges + 1
                onward.diffuse = wp.where(p.diffuse == 0, 1, scattered_again(p.diffuse))
                if wp.dot(leaves, onward.direction) > 0.0 and (max_depth == 0 or onward.edges <= max_depth):
                    onward.throughput = wp.cw_mul(
                        p.throughput, eval_diffuse(s.bsdf, w_from, w_to) * (PI / diffuse_share)
                    )
                    onward.throughput = onward.throughput * way.over
                    # By throughput alone Russian roulette would end what was drawn for being bright.
                    if way.over > 0.0 and way.over < 1.0:
                        worth = 1.0 / way.over
                    if wp.static(features.bent):
                        onward.throughput = onward.throughput * bump_shading(s, onward.direction)
        if wp.static(features.glossy):
            if straight == 0 and not by_diffuse and s.bsdf.kind != DIFFUSE and s.bsdf.kind != BLACK:
                u = numbers_2d(seed, p)
                rest = wp.float32(1.0)
                if wp.static(features.traced):
                    if diffuse_share > 0.0:
                        rest = 1.0 - diffuse_share
                        u_lobe = wp.min((u_lobe - diffuse_share) / rest, _BELOW_ONE)
                sampled = sample_glossy(s.bsdf, w_from, u_lobe, u, RADIANCE)
                crosses = sampled.crosses
                if wp.static(features.sheer):
                    crosses = goes_through(s, sampled)
                if crosses == 1:
                    leaves = -s.normal
                    onward.medium = medium_beyond(scene.materials, s.material, s.front, onward.medium)
                through = crosses == 1 and sampled.straight == 1
                if sampled.straight == 1:
                    onward.throughput = wp.cw_mul(p.throughput, sampled.weight) / rest
                else:
                    onward.direction = to_world(s, sampled.to)
                    onward.pdf = rest * sampled.pdf / ways
                    onward.anchor = s.position
                    onward.edges = p.edges + 1
                    onward.diffuse = scattered_again(p.diffuse)
                    if wp.dot(leaves, onward.direction) > 0.0 and (max_depth == 0 or onward.edges <= max_depth):
                        onward.throughput = wp.cw_mul(p.throughput, sampled.weight) / rest
                        if wp.static(features.bent):
                            onward.throughput = onward.throughput * bump_shading(s, onward.direction)
        onward.origin = leave(s.position, leaves, scene.surfaces.offset_min)
        if wp.static(features.media):
            onward.left = leaves
            if through and onward.medium == p.medium:
                onward.left = wp.vec3(0.0)
        roulette_from = wp.int32(ROULETTE_FROM)
        if wp.static(features.traced):
            if orders.diffuse_light == BY_PATHS:
                roulette_from = ROULETTE_FROM_OF_PATHS
            if orders.diffuse_light == BY_FINAL_GATHER and by_diffuse and p.diffuse > 0:
                roulette_from = ROULETTE_FROM_OF_GATHERS
        weak = wp.float32(0.0)
        if wp.static(features.glossy):
            # Behind glass and in mirrors there is nothing else to see, however dark they are.
            shows = w_from[2] > 0.0 and has_diffuse(s.bsdf)
            if orders.diffuse_light != BY_PATHS and shows and not by_diffuse and straight == 0:
                if p.diffuse > 0:
                    weak = WEAK_REFLECTION_OF_GATHERS
                elif p.bounce > 0:
                    weak = WEAK_REFLECTION
        carry_on(p, onward, roulette_from, SURVIVAL_MOST, worth, weak, seed, paths_out)

    return go_on
