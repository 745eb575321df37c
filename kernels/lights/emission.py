"""Photons as they leave the lights: by each light's own distribution, or aimed at spheres that hold what is specular.

The flux of a photon is radiance * cos / (chance of the element * density of the point * density of the direction), so
that photons of any distribution that leaves out no direction give the same mean.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.constants import PI
from wdpm.kernels.features import Features
from wdpm.kernels.lights.elements import Lights, choose_element, point_of_triangle, probability_of
from wdpm.kernels.lights.environment import sample_environment
from wdpm.kernels.lights.kinds import make_emit_delta
from wdpm.kernels.lights.parallel import parallel_emission
from wdpm.kernels.lights.photon_targets import Targets, aim, sum_of_cones
from wdpm.kernels.lights.radiance import make_radiance
from wdpm.kernels.lights.samples import Emission
from wdpm.kernels.materials.surface import leave
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.maths.directions import cosine_hemisphere, triangle_weights

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


_HEMISPHERE = wp.constant(wp.float32(1.0))  # 1 - cos of the half angle


@functools.cache
def make_emission(features: Features) -> wp.Function:
    """`emit(lights, textures, shares, targets, aimed, u_element, u_position, u_direction, u_target) -> Emission`."""
    radiance_of = make_radiance(features).radiance_of
    emit_delta = make_emit_delta(features)

    @wp.func
    def from_triangle(
        lights: wp.ref[Lights],
        textures: wp.ref[Textures],
        targets: wp.ref[Targets],
        aimed: wp.int32,
        element: wp.int32,
        u_position: wp.vec2,
        u_direction: wp.vec2,
        u_target: wp.float32,
    ) -> Emission:
        emitted = Emission()
        w = triangle_weights(u_position)
        normal = lights.normal[element]
        emitted.origin = leave(point_of_triangle(lights, element, w), normal, lights.offset_min)
        value = radiance_of(lights, textures, element, w) * lights.area[element]
        total = _HEMISPHERE
        if aimed == 1:
            total = sum_of_cones(targets, emitted.origin, normal, 0.0)
        if total < _HEMISPHERE:
            a = aim(targets, emitted.origin, normal, 0.0, total, u_target, u_direction)
            emitted.direction = a.vector
            cosine = wp.dot(normal, a.vector)
            if cosine > 0.0 and a.pdf > 0.0:
                emitted.flux = value * (cosine / a.pdf)
        else:
            emitted.direction = cosine_hemisphere(normal, u_direction)
            emitted.flux = value * PI
        return emitted

    @wp.func
    def emit(
        lights: wp.ref[Lights],
        textures: wp.ref[Textures],
        cumulative: wp.array[wp.float64],
        targets: wp.ref[Targets],
        aimed: wp.int32,
        u_element: wp.float64,
        u_position: wp.vec2,
        u_direction: wp.vec2,
        u_target: wp.float32,
    ) -> Emission:
        """A photon from the lights.

        Args:
            cumulative: shares of the elements up to and with each.
            aimed: 1 where the photon is only of use if it meets one of the targets.
            u_element, u_position, u_direction, u_target: numbers in [0, 1); the last may be 1.
        """
        element = choose_element(cumulative, lights.count, u_element)
        probability = probability_of(cumulative, element)
        towards = aimed
        if targets.count == 0:
            towards = 0
        emitted = Emission()
        if element < lights.triangles:
            emitted = from_triangle(lights, textures, targets, towards, element, u_position, u_direction, u_target)
        if wp.static(features.delta_lights):
            if element >= lights.triangles and element < lights.first_environment:
                number = element - lights.triangles
                emitted = emit_delta(lights, textures, targets, towards, number, u_position, u_direction, u_target)
        if wp.static(features.environment):
            if element >= lights.first_environment:
                found = sample_environment(lights.environment, u_direction)
                value = wp.vec3(0.0)
                if found.pdf > 0.0:
                    value = found.radiance / found.pdf
                emitted = parallel_emission(lights, targets, towards, -found.direction, value, u_target, u_position)
        emitted.element = element
        emitted.light = lights.light[element]
        emitted.medium = lights.medium[element]
        if probability > 0.0:
            emitted.flux = emitted.flux / probability
        else:
            emitted.flux = wp.vec3(0.0)
        return emitted

    return emit
