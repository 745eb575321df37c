"""What a vertex on a surface asks of the photon map: where photons are wanted, and what they count for."""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.paths import Vertex
from wdpm.kernels.camera.vertices import BY_PATHS, Coats, Orders, Queries
from wdpm.kernels.features import Features
from wdpm.kernels.materials.bsdf import make_bsdf
from wdpm.kernels.materials.surface import Surface, lit_normal, lit_shading_normal
from wdpm.kernels.materials.types import DIFFUSE, NULL
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.instanced_triangles import make_triangles

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@functools.cache
def make_query(features: Features) -> wp.Function:
    """The function `query` for surfaces with a set of features."""
    bsdf = make_bsdf(features)
    has_diffuse = bsdf.has_diffuse
    is_even = bsdf.is_even
    reflectance = bsdf.reflectance
    grazing_gain = bsdf.grazing_gain
    clearance = make_triangles(features.instances).clearance

    @wp.func
    def query(
        surfaces: wp.ref[Surfaces],
        s: Surface,
        p: Vertex,
        w_from: wp.vec3,
        orders: Orders,
        queries_out: wp.ref[Queries],
        coats_out: wp.ref[Coats],
    ) -> wp.vec3:
        """Where photons are wanted, and for what. Returns the albedo of the surface, for its layer."""
        i = p.row
        albedo = wp.vec3(0.0)
        weight = wp.vec3(0.0)
        if w_from[2] > 0.0 and has_diffuse(s.bsdf):
            albedo = s.bsdf.color
            weight = p.throughput
            if s.bsdf.kind == DIFFUSE:
                weight = wp.cw_mul(p.throughput, albedo)
        elif s.bsdf.kind != NULL and s.bsdf.kind != DIFFUSE:
            albedo = s.bsdf.specular
        if wp.static(features.traced):
            if orders.diffuse_light == BY_PATHS:
                weight = wp.vec3(0.0)
        queries_out.weight[i] = weight
        if orders.asks == 1:
            queries_out.position[i] = s.position
            queries_out.normal[i] = lit_normal(s)
            queries_out.shading_normal[i] = lit_shading_normal(s)
            queries_out.front_normal[i] = s.normal
            if s.front == 0:
                queries_out.front_normal[i] = -s.normal
            queries_out.clearance[i] = clearance(surfaces, p.prim, s.position)
            queries_out.edges[i] = p.edges
            if wp.static(features.bent):
                coats_out.unbent[i] = s.unbent
                coats_out.bumps2[i] = s.bumps2
            if wp.static(features.coated):
                coats_out.bsdf[i] = s.bsdf
                coats_out.s[i] = s.s
                coats_out.t[i] = s.t
                coats_out.n[i] = s.n
                coats_out.w_from[i] = w_from
                even = is_even(s.bsdf)
                if wp.static(features.bent):  # irradiance is that of the surface as it is, not as it seems
                    even = even and s.bumps2 <= 0.0
                coats_out.even[i] = even
                coats_out.reflectance[i] = wp.vec3(1.0)
                coats_out.grazing_gain[i] = 0.0
                if s.bsdf.kind != DIFFUSE:
                    coats_out.reflectance[i] = reflectance(s.bsdf, w_from)
                    coats_out.grazing_gain[i] = grazing_gain(s.bsdf, w_from)
        return albedo

    return query
