"""Vertices of camera paths on surfaces: what each shows, is lit by, asks of the photon map, and where its path goes on.

The counterpart in media is medium_vertices. What the diffuse part of a surface does is up to
`diffuse_light`: see shading.
"""

from __future__ import annotations

import functools
from types import SimpleNamespace

import warp as wp

from wdpm.kernels.camera.onward_rays import make_onward_rays
from wdpm.kernels.camera.photon_queries import make_photon_queries
from wdpm.kernels.camera.rays import Paths
from wdpm.kernels.camera.surface_light import make_surface_light
from wdpm.kernels.camera.vertices import (
    BY_FINAL_GATHER,
    BY_PATHS,
    CHOICE,
    READ_MAP,
    TRACE_ON,
    Coats,
    Orders,
    Queries,
    Seen,
    Shots,
    Vertex,
    nothing_lit,
    number_1d,
)
from wdpm.kernels.features import Features
from wdpm.kernels.lights.lights import Lights
from wdpm.kernels.materials.bsdf import make_bsdf
from wdpm.kernels.materials.resolve import Materials
from wdpm.kernels.materials.surface import Surfaces, make_surface, to_local
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import BLACK, NULL

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@functools.cache
def make_surface_vertices(features: Features) -> SimpleNamespace:
    """Function `shade_surface`."""
    surface_at = make_surface(features).surface_at
    probability_diffuse = make_bsdf(features).probability_diffuse
    light = make_surface_light(features)
    emitted = light.emitted
    direct = light.direct
    query = make_photon_queries(features).query
    go_on = make_onward_rays(features).go_on

    @wp.func
    def shade_surface(
        surfaces: Surfaces,
        materials: Materials,
        textures: Textures,
        lights: Lights,
        p: Vertex,
        reached: wp.bool,
        orders: Orders,
        seen_out: Seen,
        queries_out: Queries,
        coats_out: Coats,
        shots_out: Shots,
        paths_out: Paths,
    ) -> None:
        """A vertex on a surface.

        Args:
            p: with the throughput of the path where it arrives.
            reached: whether light does; if not, only what the layers of depth, normals and albedo tell is told.
        """
        i = orders.i
        to_viewer = -wp.normalize(p.direction)
        u_choice = wp.float32(0.0)
        if wp.static(features.blend or features.passing):
            u_choice = number_1d(orders.seed, p, CHOICE)
        s = surface_at(surfaces, materials, textures, p.prim, p.u, p.v, to_viewer, u_choice)
        w_from = to_local(s, to_viewer)

        diffuse_share = wp.float32(0.0)
        shines = orders.max_depth == 0 or p.edges <= orders.max_depth
        lit = lights.count > 0 and (orders.max_depth == 0 or p.edges + 1 <= orders.max_depth)
        if wp.static(features.traced):
            if orders.diffuse_light == BY_PATHS or (
                orders.diffuse_light == BY_FINAL_GATHER and orders.action == TRACE_ON
            ):
                diffuse_share = probability_diffuse(s.bsdf, w_from)
            if orders.diffuse_light == BY_FINAL_GATHER and p.diffuse > 0:
                shines = False
                lit = lit and orders.action != READ_MAP

        emission = wp.vec3(0.0)
        if shines and reached:
            emission = emitted(textures, lights, s, p)
        seen_out.emission[i] = emission
        seen_out.depth[i] = wp.length(s.position - orders.eye)
        seen_out.normal[i] = s.shading_normal
        seen_out.albedo[i] = query(surfaces, s, p, w_from, orders, queries_out, coats_out)
        if reached:
            for j in range(orders.shots):
                if lit and s.bsdf.kind != BLACK and s.bsdf.kind != NULL:
                    direct(materials, textures, lights, s, p, w_from, diffuse_share, orders, j, shots_out)
                else:
                    nothing_lit(p, orders, j, shots_out)
            if wp.static(features.goes_on):
                go_on(materials, s, p, w_from, diffuse_share, orders, paths_out)

    return SimpleNamespace(shade_surface=shade_surface)
