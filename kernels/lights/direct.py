"""Light that arrives straight from a light at a place: sampled, with its density, and the density for any direction.

An element is chosen by what it may send to the place (tree.py), and a point on it (choice.py). The densities are
those of solid angle about the place, and contain the chance of the element, so that directions found by other means
can be weighted against them (multiple importance sampling).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.lights.balls import way_to_ball
from wdpm.kernels.lights.choice import (
    ElementChoice,
    chance_of_light,
    choose_light,
    light_starts,
    pdf_on_triangle,
    pdf_to_ball,
)
from wdpm.kernels.lights.elements import Lights, element_of_prim, point_of_triangle
from wdpm.kernels.lights.environment import EnvironmentSample, environment_seen, environment_value, sample_environment
from wdpm.kernels.lights.guide import guided_seen, region_of, sample_guided
from wdpm.kernels.lights.kinds import make_direct_delta
from wdpm.kernels.lights.radiance import make_radiance
from wdpm.kernels.lights.samples import DirectSample, towards
from wdpm.kernels.lights.tree import Starts
from wdpm.kernels.materials.surface import leave
from wdpm.kernels.materials.texture import Textures

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@dataclass(frozen=True, eq=False)
class DirectCode:
    """Functions of light that arrives straight.

    Attributes:
        sample_direct: `(lights, textures, position, point) -> DirectSample`.
        sample_direct_from: `(lights, textures, position, starts, point) -> DirectSample`, with light_starts of the
            position: for several of one place.
        pdf_triangle: `(lights, emitter, prim, origin, position, normal) -> float`.
        environment_from: `(lights, origin, direction) -> EnvironmentSample`.
        environment_radiance: `(lights, direction) -> vec3`.
        emitted_radiance: `(lights, textures, emitter, uv, color) -> vec3`.
    """

    sample_direct: wp.Function
    sample_direct_from: wp.Function
    pdf_triangle: wp.Function
    environment_from: wp.Function
    environment_radiance: wp.Function
    emitted_radiance: wp.Function


def _make_sample_direct(sample_direct_from: wp.Function) -> wp.Function:
    """The function for places from which one way is asked for."""

    @wp.func
    def sample_direct(
        lights: wp.ref[Lights], textures: wp.ref[Textures], position: wp.vec3, point: wp.vec2d
    ) -> DirectSample:
        """As sample_direct_from."""
        starts = light_starts(lights, position)
        return sample_direct_from(lights, textures, position, starts, point)

    return sample_direct


@wp.func
def pdf_triangle(
    lights: wp.ref[Lights],
    emitter: wp.int32,
    prim: wp.int32,
    origin: wp.vec3,
    position: wp.vec3,
    normal: wp.vec3,
) -> wp.float32:
    """pdf_solid_angle with which sample_direct from `origin` goes to a point of a triangle; 0 for one not lit.

    Args:
        emitter: which glowing mesh it belongs to.
        prim: global number of the triangle.
        normal: unit geometric normal of its lit side.
    """
    ball = lights.tree.ball_of[emitter]
    if ball >= 0:
        return pdf_to_ball(lights, ball, origin)
    element = element_of_prim(lights, prim)
    if element < 0:
        return 0.0
    way = position - origin
    distance2 = wp.dot(way, way)
    if distance2 <= 0.0:
        return 0.0
    cosine = -wp.dot(normal, wp.normalize(way))
    if cosine <= 0.0:
        return 0.0
    return pdf_on_triangle(lights, chance_of_light(lights, element, origin), distance2, cosine)


@functools.cache
def make_direct(features: Features) -> DirectCode:
    """Light that arrives straight, for the lights that features name."""
    radiance = make_radiance(features)
    radiance_of = radiance.radiance_of
    direct_delta = make_direct_delta(features)

    @wp.func
    def to_triangle(
        lights: wp.ref[Lights], textures: wp.ref[Textures], position: wp.vec3, chosen: ElementChoice
    ) -> DirectSample:
        """The way to the chosen point of a triangle, or of a ball."""
        element = chosen.element
        s = DirectSample()
        if chosen.ball > 0.0:
            if chosen.probability > 0.0:
                there = way_to_ball(lights.tree.nodes[chosen.leaf], chosen.ball, position, chosen.u)
                s.direction = there.direction
                s.end = leave(there.end, there.normal, lights.offset_min + there.clearance)
                s.pdf = chosen.probability / chosen.solid_angle
                s.radiance = lights.emitter_radiance[lights.emitter[element]]
            return s
        normal = lights.normal[element]
        point = point_of_triangle(lights, element, chosen.weights)
        s = towards(position, leave(point, normal, lights.offset_min), chosen.probability)
        cosine = -wp.dot(normal, s.direction)
        if cosine > 0.0 and s.pdf > 0.0:
            way = s.end - position
            s.pdf = pdf_on_triangle(lights, chosen, wp.dot(way, way), cosine)
            s.radiance = radiance_of(lights, textures, element, chosen.weights)
        else:
            s.pdf = 0.0
        return s

    @wp.func(inline=False)  # at surfaces and in media
    def sample_direct_from(
        lights: wp.ref[Lights], textures: wp.ref[Textures], position: wp.vec3, starts: wp.ref[Starts], point: wp.vec2d
    ) -> DirectSample:
        """A way from a place to a light.

        Args:
            starts: light_starts of the place.
            point: of the unit square.
        """
        chosen = choose_light(lights, position, starts, point)
        element = chosen.element
        probability = chosen.probability
        if element < 0:
            return DirectSample()
        s = DirectSample()
        if wp.static(not (features.delta_lights or features.environment)):
            s = to_triangle(lights, textures, position, chosen)  # there are no others
        if wp.static(features.delta_lights or features.environment):
            if element < lights.triangles:
                s = to_triangle(lights, textures, position, chosen)
        if wp.static(features.delta_lights):
            if element >= lights.triangles and element < lights.first_environment:
                s = direct_delta(lights, textures, element - lights.triangles, position, probability)
        if wp.static(features.environment):
            if element >= lights.first_environment:
                region = region_of(lights.guide, position)
                found = EnvironmentSample()
                if region >= 0 and lights.guide.tiled == 1:
                    found = sample_guided(lights.environment, lights.guide, region, chosen.u)
                else:
                    found = sample_environment(lights.environment, chosen.u)
                s.direction = found.direction
                s.end = position + s.direction * lights.far_away
                s.radiance = found.radiance
                s.pdf = probability * found.pdf
                s.delta = 0
        s.light = lights.light[element]
        if wp.max(s.radiance) <= 0.0:
            s.pdf = 0.0
        return s

    @wp.func
    def environment_from(lights: wp.ref[Lights], origin: wp.vec3, direction: wp.vec3) -> EnvironmentSample:
        """A direction (unit) to the environment, as sample_direct from `origin` would have gone."""
        seen = EnvironmentSample()
        if wp.static(features.environment):
            if lights.first_environment < lights.count:
                chance = chance_of_light(lights, lights.first_environment, origin).probability
                region = region_of(lights.guide, origin)
                if region >= 0 and lights.guide.tiled == 1:
                    seen = guided_seen(lights.environment, lights.guide, region, direction)
                else:
                    seen = environment_seen(lights.environment, direction)
                seen.pdf = chance * seen.pdf
        return seen

    @wp.func
    def environment_radiance(lights: wp.ref[Lights], direction: wp.vec3) -> wp.vec3:
        """Radiance that arrives from infinitely far away in a direction (unit, pointing to where it comes from)."""
        value = wp.vec3(0.0)
        if wp.static(features.environment):
            if lights.first_environment < lights.count:
                value = environment_value(lights.environment, direction)
        return value

    return DirectCode(
        sample_direct=_make_sample_direct(sample_direct_from),
        sample_direct_from=sample_direct_from,
        pdf_triangle=pdf_triangle,
        environment_from=environment_from,
        environment_radiance=environment_radiance,
        emitted_radiance=radiance.emitted_radiance,
    )
