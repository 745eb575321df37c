"""Light straight from lights at a vertex on a surface: what the surface emits, and direct light by shadow rays.

What the ray that goes on may find as well counts by both, with weights: see shading. The density that a path carries
along is over the number of ways to lights that were drawn where it set out (picked_light): a lamp that is found through
a mask, some vertices later, need not know how many there were.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import warp as wp

from wdpm.kernels.camera.paths import Vertex
from wdpm.kernels.camera.picked_light import make_picked_light
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.vertices import Orders, Shots, shoot, shot_of
from wdpm.kernels.features import Features
from wdpm.kernels.lights.lights import make_lights
from wdpm.kernels.lights.tree import Starts
from wdpm.kernels.materials.resolve import medium_beyond
from wdpm.kernels.materials.surface import Surface, leave, lit_normal

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
    light = make_lights(features)
    pdf_triangle = light.pdf_triangle
    emitted_radiance = light.emitted_radiance
    picked_light = make_picked_light(features)

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
        way = picked_light(scene, s, p, w_from, diffuse_share, starts, orders, j)
        radiance = way.radiance
        leaves = lit_normal(s)
        if way.side < 0.0:
            leaves = -leaves
        if p.bounce > 0:
            radiance = radiance / wp.float32(orders.shots)
        shot = shot_of(p, p.diffuse, orders, j)
        shot.origin = leave(s.position, leaves, scene.surfaces.offset_min)
        shot.direction = way.end - shot.origin
        shot.radiance = radiance
        if wp.static(features.media):
            if wp.dot(leaves, s.normal) < 0.0:
                shot.medium = medium_beyond(scene.materials, s.material, s.front, p.medium)
        shoot(p, orders, j, shot, shots_out)

    return SurfaceLight(emitted, direct)
