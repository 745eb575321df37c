"""Light straight from lights at a vertex on a surface: what the surface emits, and direct light by shadow rays.

What the ray that goes on may find as well counts by both, with weights: see shading. The weights are those of one
shadow ray and one ray that goes on, also where there are several shadow rays, of which the mean is taken: a lamp that
is found through a mask, some vertices later, need not know how many there were.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import warp as wp

from wdpm.kernels.camera.paths import Vertex
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.vertices import BY_FINAL_GATHER, BY_PATHS, Orders, Shots, shoot, shot_of
from wdpm.kernels.constants import INV_PI
from wdpm.kernels.features import Features
from wdpm.kernels.lights.lights import make_lights
from wdpm.kernels.lights.tree import Starts
from wdpm.kernels.materials.bsdf import make_bsdf
from wdpm.kernels.materials.resolve import medium_beyond
from wdpm.kernels.materials.surface import Surface, bump_shading, leave, scatters_to_either_side, to_local
from wdpm.kernels.materials.types import RADIANCE
from wdpm.kernels.maths.random import PURPOSE_LIGHT, sample_2d_fine, stream_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@dataclass(frozen=True)
class SurfaceLight:
    """Functions for light straight from lights.

    Attributes:
        emitted: (scene, s, p) -> radiance.
        direct: (scene, s, p, w_from, diffuse_share, starts, orders, j, shots_out).
    """

    emitted: wp.Function
    direct: wp.Function


@functools.cache
def make_surface_light(features: Features) -> SurfaceLight:
    """The functions for surfaces and lights with a set of features."""
    bsdf = make_bsdf(features)
    eval_diffuse = bsdf.eval_diffuse
    eval_glossy = bsdf.eval_glossy
    pdf_glossy = bsdf.pdf_glossy
    light = make_lights(features)
    sample_direct_from = light.sample_direct_from
    pdf_triangle = light.pdf_triangle
    emitted_radiance = light.emitted_radiance

    @wp.func
    def emitted(scene: wp.ref[Scene], s: Surface, p: Vertex) -> wp.vec3:
        """Radiance of the surface itself, weighted against the shadow rays that might have found it."""
        radiance = wp.vec3(0.0)
        if s.emitter >= 0 and s.front == 1:
            radiance = emitted_radiance(scene.lights, scene.textures, s.emitter, s.uv, s.color)
            if wp.static(features.glossy or features.traced):
                if p.pdf > 0.0:
                    by_light = pdf_triangle(scene.lights, s.emitter, p.prim, p.anchor, s.position, s.normal)
                    radiance = radiance * (p.pdf / (p.pdf + by_light))
        return wp.cw_mul(p.throughput, radiance)

    @wp.func
    def direct(
        scene: wp.ref[Scene],
        s: Surface,
        p: Vertex,
        w_from: wp.vec3,
        diffuse_share: wp.float32,
        starts: wp.ref[Starts],
        orders: Orders,
        j: wp.int32,
        shots_out: wp.ref[Shots],
    ) -> None:
        """One sample of the direct light that a surface reflects: shadow segment j, and what it carries.

        Args:
            diffuse_share: probability that the ray that goes on does so by the diffuse part.
            starts: light_starts of the place.
        """
        index = wp.uint32(p.sample) * wp.uint32(orders.shots) + wp.uint32(j)
        point = sample_2d_fine(index, stream_of(scene.camera.seed, PURPOSE_LIGHT, p.item, p.bounce))
        found = sample_direct_from(scene.lights, scene.textures, s.position, starts, point)
        radiance = wp.vec3(0.0)
        side = wp.dot(s.normal, found.direction)
        leaves = s.normal
        if side < 0.0:
            leaves = -s.normal
        if found.pdf > 0.0:
            w_to = to_local(s, found.direction)
            # Both normals must agree on the side that light comes from, or it would leak through what is opaque.
            seen_from = w_from[2]
            reflects = side > 0.0 and w_to[2] * seen_from > 0.0
            crosses = side < 0.0 and w_to[2] * seen_from < 0.0
            scattering = wp.vec3(0.0)
            if reflects:
                scattering = eval_diffuse(s.bsdf, w_from, w_to) * wp.abs(w_to[2])
                if wp.static(features.traced):
                    if orders.diffuse_light == BY_PATHS and found.delta == 0:
                        by_diffuse = diffuse_share * (wp.max(w_to[2], 0.0) * INV_PI)
                        scattering = scattering * (found.pdf / (found.pdf + by_diffuse))
            if wp.static(features.glossy):
                scatters = reflects or crosses
                if wp.static(features.sheer):
                    scatters = scatters or (side != 0.0 and scatters_to_either_side(s))
                if scatters and (orders.diffuse_light != BY_FINAL_GATHER or p.diffuse == 0):
                    glossy = eval_glossy(s.bsdf, w_from, w_to, RADIANCE)
                    if wp.max(glossy) > 0.0:
                        if found.delta == 0:
                            by_glossy = pdf_glossy(s.bsdf, w_from, w_to)
                            if wp.static(features.traced):
                                by_glossy = (1.0 - diffuse_share) * by_glossy
                            glossy = glossy * (found.pdf / (found.pdf + by_glossy))
                        scattering = scattering + glossy
            if wp.static(features.bent):
                scattering = scattering * bump_shading(s, found.direction)
            radiance = wp.cw_mul(p.throughput, wp.cw_mul(scattering, found.radiance)) / found.pdf
        if p.bounce > 0:
            radiance = radiance / wp.float32(orders.shots)
        shot = shot_of(p, p.diffuse, orders, j)
        shot.origin = leave(s.position, leaves, scene.surfaces.offset_min)
        shot.direction = found.end - shot.origin
        shot.radiance = radiance
        if wp.static(features.media):
            if side < 0.0:
                shot.medium = medium_beyond(scene.materials, s.material, s.front, p.medium)
        shoot(p, orders, j, shot, shots_out)

    return SurfaceLight(emitted, direct)
