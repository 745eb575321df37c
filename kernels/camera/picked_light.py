"""A shadow ray that is picked from several ways to lights: resampled importance sampling (Talbot et al. 2005).

Lights are chosen by what they may send to a place. What the surface does with it they do not know: a rough metal sends
most of it past the viewer. So several ways to lights are drawn, which takes less than to trace them, and one is picked
in proportion to what the surface scatters of it to the viewer. It alone is traced, and counts by the mean of all over
its own. So nothing is left out, whatever they are picked by.

It is not what arrives by a way that they are picked by, as is usual: where shadow rays are guided, a way that hardly
ever reaches its light is rarely drawn and promises the more, and would be picked nearly always.

Lamps that the ray that goes on meets are weighted against as many ways as were drawn, by the balance heuristic.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.paths import Vertex
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.vertices import BY_FINAL_GATHER, BY_PATHS, Orders
from wdpm.kernels.constants import INV_PI
from wdpm.kernels.features import Features
from wdpm.kernels.lights.lights import DirectSample, Lights, make_lights
from wdpm.kernels.lights.tree import BELOW_ONE, Starts
from wdpm.kernels.materials.bsdf import make_bsdf
from wdpm.kernels.materials.microfacet import is_smooth
from wdpm.kernels.materials.surface import Surface, bump_shading, lit_normal, scatters_to_either_side, to_local
from wdpm.kernels.materials.types import RADIANCE
from wdpm.kernels.maths.random import PURPOSE_LIGHT, PURPOSE_PICK, sample_1d, sample_2d_fine, stream_of
from wdpm.kernels.maths.sample_numbers import number_of_sample

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

WAYS_ON_GLOSSY = wp.constant(4)
"""Ways that are drawn at a vertex with a rough glossy part, over all of its shadow rays."""

WAYS_TO_SKY = wp.constant(2)
"""Ways that are drawn for a shadow ray of a diffuse surface under an environment, half of which may lie below it.

Only where diffuse surfaces have their indirect light from photons, and the camera sees them, by itself or in what is
glossy: else other light makes more noise. With lamps alone it is not worth it, since points on these are even over the
solid angle, and a pick by chance is less even than no pick: 1.06 of the squared error in Sibenik cathedral."""

_ONE = wp.constant(wp.float64(1.0))


@wp.struct
class PickedLight:
    """A way to a light.

    Attributes:
        end: of the shadow segment.
        side: above 0 where it leaves the surface by the side that its diffuse part is lit from, below 0 by the other.
        radiance: that the surface sends to the viewer if nothing is in the way, over the density of the way.
    """

    end: wp.vec3
    side: wp.float32
    radiance: wp.vec3


@wp.func
def ways_of_shot(lights: wp.ref[Lights], s: Surface, p: Vertex, orders: Orders) -> wp.int32:
    """How many ways are drawn for each shadow ray of a vertex."""
    if lights.count == 1 and lights.triangles == 0 and lights.first_environment == 1:
        return 1  # there is but one: to a light without extent
    if not is_smooth(s.bsdf.alpha):
        if orders.diffuse_light != BY_FINAL_GATHER or p.diffuse == 0:
            return wp.max(1, WAYS_ON_GLOSSY // orders.shots)
    if orders.diffuse_light != BY_PATHS and p.diffuse == 0 and lights.first_environment < lights.count:
        return WAYS_TO_SKY
    return 1


@wp.func
def ways_of_vertex(lights: wp.ref[Lights], s: Surface, p: Vertex, orders: Orders) -> wp.int32:
    """How many ways are drawn for all shadow rays of a vertex; 1 where there are none."""
    return wp.max(1, orders.shots * ways_of_shot(lights, s, p, orders))


@functools.cache
def make_picked_light(features: Features) -> wp.Function:
    """The function `picked_light` for surfaces and lights with a set of features."""
    bsdf = make_bsdf(features)
    eval_diffuse = bsdf.eval_diffuse
    eval_glossy = bsdf.eval_glossy
    pdf_glossy = bsdf.pdf_glossy
    sample_direct_from = make_lights(features).sample_direct_from

    @wp.func
    def scattered(
        s: Surface,
        p: Vertex,
        w_from: wp.vec3,
        diffuse_share: wp.float32,
        orders: Orders,
        found: DirectSample,
        by_light: wp.float32,
    ) -> wp.vec3:
        """Scattering function times cosine of a way to a light, weighted against the ray that goes on.

        Args:
            by_light: pdf_solid_angle of the way, times how many are drawn.
        """
        side = wp.dot(lit_normal(s), found.direction)
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
                    scattering = scattering * (by_light / (by_light + by_diffuse))
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
                        glossy = glossy * (by_light / (by_light + by_glossy))
                    scattering = scattering + glossy
        if wp.static(features.bent):
            scattering = scattering * bump_shading(s, found.direction)
        return scattering

    @wp.func
    def picked_light(
        scene: wp.ref[Scene],
        s: Surface,
        p: Vertex,
        w_from: wp.vec3,
        diffuse_share: wp.float32,
        starts: wp.ref[Starts],
        orders: Orders,
        j: wp.int32,
    ) -> PickedLight:
        """The way of shadow ray j; its radiance is zero where none of those drawn brings any.

        Args:
            diffuse_share: probability that the ray that goes on does so by the diffuse part.
            starts: light_starts of the place.
        """
        seed = scene.camera.seed
        number = number_of_sample(p.sample) * wp.uint32(orders.shots) + wp.uint32(j)
        drawn = ways_of_shot(scene.lights, s, p, orders)
        of_vertex = wp.float32(ways_of_vertex(scene.lights, s, p, orders))
        points = stream_of(seed, PURPOSE_LIGHT, p.item, p.bounce)
        u = wp.float64(0.0)
        if drawn > 1:
            u = sample_1d(number, stream_of(seed, PURPOSE_PICK, p.item, p.bounce))
        total = wp.float32(0.0)
        own = wp.float32(0.0)
        picked = PickedLight()
        for i in range(drawn):
            point = sample_2d_fine(number * wp.uint32(drawn) + wp.uint32(i), points)
            found = sample_direct_from(scene.lights, scene.textures, s.position, starts, point)
            scattering = wp.vec3(0.0)
            if found.pdf > 0.0:
                scattering = scattered(s, p, w_from, diffuse_share, orders, found, found.pdf * of_vertex)
            weight = wp.dot(p.throughput, scattering)
            total += weight
            takes = i == 0
            if i > 0 and weight > 0.0:
                share = wp.float64(weight) / wp.float64(total)
                takes = u < share
                # What is left of the number is as good as a fresh one.
                if takes:
                    u = wp.min(u / share, BELOW_ONE)
                else:
                    u = wp.min((u - share) / (_ONE - share), BELOW_ONE)
            if takes:
                own = weight
                picked.end = found.end
                picked.side = wp.dot(lit_normal(s), found.direction)
                picked.radiance = wp.vec3(0.0)
                if found.pdf > 0.0:
                    picked.radiance = wp.cw_mul(p.throughput, wp.cw_mul(scattering, found.radiance)) / found.pdf
        if drawn > 1 and own > 0.0:
            picked.radiance = picked.radiance * (total / (own * wp.float32(drawn)))
        return picked

    return picked_light
