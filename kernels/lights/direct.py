"""Light that arrives straight from a light at a place: sampled, with its density, and the density for any direction.

An element is chosen by what it may send to the place (light_tree), and a point on it (light_choice). The densities are
those of solid angle about the place, and contain the chance of the element, so that directions found by other means
can be weighted against them (multiple importance sampling).
"""

from __future__ import annotations

import functools
from types import SimpleNamespace

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.lights.choice import ElementChoice, chance_of_light, choose_light, pdf_on_triangle
from wdpm.kernels.lights.elements import Lights, element_of_prim, point_of_triangle
from wdpm.kernels.lights.environment import environment_pdf, environment_value, sample_environment
from wdpm.kernels.lights.radiance import make_radiance
from wdpm.kernels.lights.spots import make_spots
from wdpm.kernels.materials.surface import leave
from wdpm.kernels.materials.texture import Textures

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class DirectSample:
    """A way to a light. What arrives by it is scattering * cos * radiance / pdf.

    Attributes:
        direction: towards the light, unit.
        end: of the shadow segment.
        radiance: radiance; of a delta light, the irradiance across the direction.
        pdf: pdf_solid_angle times probability of the element, of a delta light just the latter. 0: nothing arrives.
        delta: 1 where only this way leads to the light: a point, spot or directional.
        light: which light of the scene.
    """

    direction: wp.vec3
    end: wp.vec3
    radiance: wp.vec3
    pdf: wp.float32
    delta: wp.int32
    light: wp.int32


@functools.cache
def make_direct(features: Features) -> SimpleNamespace:
    """Functions `sample_direct`, `pdf_triangle`, `pdf_environment`, `environment_radiance`, `emitted_radiance`."""
    radiance = make_radiance(features)
    radiance_of = radiance.radiance_of
    spot_intensity = make_spots(features).spot_intensity

    @wp.func
    def towards(position: wp.vec3, end: wp.vec3, probability: wp.float32) -> DirectSample:
        """The way to a point from which intensity is still to be set."""
        s = DirectSample()
        s.end = end
        way = end - position
        if wp.dot(way, way) > 0.0:
            s.direction = wp.normalize(way)
            s.pdf = probability
        return s

    @wp.func
    def to_triangle(lights: Lights, textures: Textures, position: wp.vec3, chosen: ElementChoice) -> DirectSample:
        """The way to the chosen point of a triangle."""
        element = chosen.element
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

    @wp.func
    def sample_direct(lights: Lights, textures: Textures, position: wp.vec3, point: wp.vec2d) -> DirectSample:
        """A way from a place to a light.

        Args:
            point: of the unit square.
        """
        chosen = choose_light(lights, position, point)
        element = chosen.element
        probability = chosen.probability
        s = DirectSample()
        if element < 0:
            return s
        if element < lights.triangles:
            s = to_triangle(lights, textures, position, chosen)
        if wp.static(features.points):
            if element >= lights.triangles and element < lights.first_spot:
                number = element - lights.triangles
                s = towards(position, lights.point_position[number], probability)
                way = s.end - position
                s.delta = 1
                if s.pdf > 0.0:
                    s.radiance = lights.point_intensity[number] / wp.dot(way, way)
        if wp.static(features.spots):
            if element >= lights.first_spot and element < lights.first_directional:
                number = element - lights.first_spot
                s = towards(position, lights.spots.position[number], probability)
                way = s.end - position
                s.delta = 1
                if s.pdf > 0.0:
                    s.radiance = spot_intensity(lights.spots, textures, number, -s.direction) / wp.dot(way, way)
        if wp.static(features.directionals):
            if element >= lights.first_directional and element < lights.first_environment:
                number = element - lights.first_directional
                s.direction = -lights.directional_direction[number]
                s.end = position + s.direction * lights.far_away
                s.radiance = lights.directional_irradiance[number]
                s.pdf = probability
                s.delta = 1
        if wp.static(features.environment):
            if element >= lights.first_environment:
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
    def pdf_triangle(lights: Lights, prim: wp.int32, origin: wp.vec3, position: wp.vec3, normal: wp.vec3) -> wp.float32:
        """pdf_solid_angle with which sample_direct from `origin` goes to a point of a triangle; 0 for one not lit.

        Args:
            prim: global number of the triangle.
            normal: unit geometric normal of its lit side.
        """
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

    @wp.func
    def pdf_environment(lights: Lights, origin: wp.vec3, direction: wp.vec3) -> wp.float32:
        """pdf_solid_angle with which sample_direct from `origin` goes in a direction (unit) to the environment."""
        pdf = wp.float32(0.0)
        if wp.static(features.environment):
            if lights.first_environment < lights.count:
                chance = chance_of_light(lights, lights.first_environment, origin).probability
                pdf = chance * environment_pdf(lights.environment, direction)
        return pdf

    @wp.func
    def environment_radiance(lights: Lights, direction: wp.vec3) -> wp.vec3:
        """Radiance that arrives from infinitely far away in a direction (unit, pointing to where it comes from)."""
        value = wp.vec3(0.0)
        if wp.static(features.environment):
            if lights.first_environment < lights.count:
                value = environment_value(lights.environment, direction)
        return value

    return SimpleNamespace(
        sample_direct=sample_direct,
        pdf_triangle=pdf_triangle,
        pdf_environment=pdf_environment,
        environment_radiance=environment_radiance,
        emitted_radiance=radiance.emitted_radiance,
    )
