"""Vertices of camera paths on surfaces: what each shows, is lit by, asks of the photon map, and where its path goes on.

The counterpart in media is medium_vertices. What the diffuse part of a surface does is up to
`diffuse_light`: see shading.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.onward_rays import make_go_on
from wdpm.kernels.camera.paths import Vertex
from wdpm.kernels.camera.photon_queries import make_query
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.surface_light import make_surface_light
from wdpm.kernels.camera.vertices import (
    BY_FINAL_GATHER,
    BY_PATHS,
    CHOICE,
    TRACE_ON,
    Orders,
    Shaded,
    number_1d,
    shoot,
    shot_of,
)
from wdpm.kernels.features import Features
from wdpm.kernels.lights.choice import light_starts
from wdpm.kernels.lights.tree import Starts
from wdpm.kernels.materials.bsdf import make_bsdf
from wdpm.kernels.materials.resolve import medium_beyond
from wdpm.kernels.materials.surface import make_surface, to_local, unfolded
from wdpm.kernels.materials.types import BLACK, NULL

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@functools.cache
def make_shade_surface(features: Features) -> wp.Function:
    """The function `shade_surface` for a set of features."""
    surface_at = make_surface(features).surface_at
    probability_diffuse = make_bsdf(features).probability_diffuse
    light = make_surface_light(features)
    emitted = light.emitted
    direct = light.direct
    query = make_query(features)
    go_on = make_go_on(features)

    @wp.func
    def shade_surface(
        scene: wp.ref[Scene], p: Vertex, reached: wp.bool, orders: Orders, shaded_out: wp.ref[Shaded]
    ) -> None:
        """A vertex on a surface.

        Args:
            p: with the throughput of the path where it arrives.
            reached: whether light does; if not, only what the layers of depth, normals and albedo tell is told.
        """
        i = p.row
        to_viewer = -wp.normalize(p.direction)
        u_choice = wp.float32(0.0)
        if wp.static(features.blend or features.passing):
            u_choice = number_1d(scene.camera.seed, p, CHOICE)
        s = surface_at(scene.surfaces, scene.materials, scene.textures, p.prim, p.u, p.v, to_viewer, u_choice)
        w_from = to_local(s, unfolded(s, to_viewer))
        if wp.static(features.media):
            if s.bsdf.kind != NULL or medium_beyond(scene.materials, s.material, s.front, p.medium) != p.medium:
                shaded_out.stretches.end[i] = s.normal

        diffuse_share = wp.float32(0.0)
        shines = orders.max_depth == 0 or p.edges <= orders.max_depth
        lit = scene.lights.count > 0 and (orders.max_depth == 0 or p.edges + 1 <= orders.max_depth)
        if wp.static(features.traced):
            if orders.diffuse_light == BY_PATHS or (orders.diffuse_light == BY_FINAL_GATHER and p.action == TRACE_ON):
                diffuse_share = probability_diffuse(s.bsdf, w_from)
            if orders.diffuse_light == BY_FINAL_GATHER and p.diffuse > 0:
                shines = False

        emission = wp.vec3(0.0)
        if shines and reached:
            emission = emitted(scene, s, p)
        shaded_out.seen.emission[i] = emission
        albedo = query(scene.surfaces, s, p, w_from, orders, shaded_out.queries, shaded_out.coats)
        if p.bounce == 0:
            shaded_out.seen.depth[i] = wp.length(s.position - scene.camera.eye)
            shaded_out.seen.normal[i] = s.shading_normal
            shaded_out.seen.albedo[i] = albedo
        if reached:
            lit = lit and s.bsdf.kind != BLACK and s.bsdf.kind != NULL
            starts = Starts()
            if lit and orders.shots > 0:
                starts = light_starts(scene.lights, s.position)
            for j in range(orders.shots):
                if lit:
                    direct(scene, s, p, w_from, diffuse_share, starts, orders, j, shaded_out.shots)
                else:
                    shoot(p, orders, j, shot_of(p, p.diffuse, orders, j), shaded_out.shots)
            if wp.static(features.goes_on):
                go_on(scene, s, p, w_from, diffuse_share, orders, shaded_out.paths)

    return shade_surface
