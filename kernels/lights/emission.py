"""Photons as they leave the lights: by each light's own distribution, or aimed at spheres that hold what is specular.

The flux of a photon is radiance * cos / (chance of the element * density of the point * density of the direction), so
that photons of any distribution that leaves out no direction give the same mean.
"""

from __future__ import annotations

import functools
from types import SimpleNamespace

import warp as wp

from wdpm.kernels.constants import PI
from wdpm.kernels.features import Features
from wdpm.kernels.lights.elements import Lights, choose_element, point_of_triangle, probability_of
from wdpm.kernels.lights.environment import sample_environment
from wdpm.kernels.lights.photon_targets import Targets, aim, aim_parallel, sum_of_cones, sum_of_discs
from wdpm.kernels.lights.radiance import make_radiance
from wdpm.kernels.lights.spots import make_spots
from wdpm.kernels.materials.surface import leave
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.maths.directions import (
    around,
    concentric_disk,
    cosine_hemisphere,
    triangle_weights,
    uniform_cone,
    uniform_sphere,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


_HEMISPHERE = wp.constant(wp.float32(1.0))  # 1 - cos of the half angle
_SPHERE = wp.constant(wp.float32(2.0))


@wp.struct
class Emission:
    """A photon as it leaves a light.

    Attributes:
        flux: that of a map of one path: divide by the number of paths. Zero where nothing is sent.
        medium: that it starts in, -1 for none.
    """

    light: wp.int32
    element: wp.int32
    origin: wp.vec3
    direction: wp.vec3
    flux: wp.vec3
    medium: wp.int32


@wp.func
def parallel_emission(
    lights: Lights,
    targets: Targets,
    aimed: wp.int32,
    direction: wp.vec3,
    irradiance: wp.vec3,
    u_target: wp.float32,
    u: wp.vec2,
) -> Emission:
    """A photon of parallel light: through a point of the scene's silhouette, or of the spheres'."""
    e = Emission()
    e.direction = direction
    radius = lights.scene_radius
    total = wp.float32(0.0)
    if aimed == 1:
        total = sum_of_discs(targets)
    through = wp.vec3(0.0)
    if total > 0.0 and total < radius * radius:
        a = aim_parallel(targets, direction, total, u_target, u)
        through = a.vector
        e.flux = irradiance / a.pdf
    else:
        d = concentric_disk(u) * radius
        through = around(direction, wp.vec3(d[0], d[1], 0.0))
        e.flux = irradiance * (PI * radius * radius)
    # It starts where its line enters the scene's sphere.
    through = through - direction * wp.dot(through, direction)
    e.origin = through - direction * wp.sqrt(wp.max(0.0, radius * radius - wp.dot(through, through)))
    return e


@functools.cache
def make_emission(features: Features) -> SimpleNamespace:
    """Functions: `emit`."""
    radiance_of = make_radiance(features).radiance_of
    spot_intensity = make_spots(features).spot_intensity

    @wp.func
    def from_triangle(
        lights: Lights,
        textures: Textures,
        targets: Targets,
        aimed: wp.int32,
        element: wp.int32,
        u_position: wp.vec2,
        u_direction: wp.vec2,
        u_target: wp.float32,
    ) -> Emission:
        e = Emission()
        w = triangle_weights(u_position)
        normal = lights.normal[element]
        e.origin = leave(point_of_triangle(lights, element, w), normal, lights.offset_min)
        value = radiance_of(lights, textures, element, w) * lights.area[element]
        total = _HEMISPHERE
        if aimed == 1:
            total = sum_of_cones(targets, e.origin, normal, 0.0)
        if total < _HEMISPHERE:
            a = aim(targets, e.origin, normal, 0.0, total, u_target, u_direction)
            e.direction = a.vector
            cosine = wp.dot(normal, a.vector)
            if cosine > 0.0 and a.pdf > 0.0:
                e.flux = value * (cosine / a.pdf)
        else:
            e.direction = cosine_hemisphere(normal, u_direction)
            e.flux = value * PI
        return e

    @wp.func
    def from_point(
        lights: Lights,
        targets: Targets,
        aimed: wp.int32,
        number: wp.int32,
        u_direction: wp.vec2,
        u_target: wp.float32,
    ) -> Emission:
        e = Emission()
        e.origin = lights.point_position[number]
        intensity = lights.point_intensity[number]
        total = _SPHERE
        axis = wp.vec3(0.0, 0.0, 1.0)
        if aimed == 1:
            total = sum_of_cones(targets, e.origin, axis, -1.0)
        if total < _SPHERE:
            a = aim(targets, e.origin, axis, -1.0, total, u_target, u_direction)
            e.direction = a.vector
            if a.pdf > 0.0:
                e.flux = intensity / a.pdf
        else:
            e.direction = uniform_sphere(u_direction)
            e.flux = intensity * (4.0 * PI)
        return e

    @wp.func
    def from_spot(
        lights: Lights,
        textures: Textures,
        targets: Targets,
        aimed: wp.int32,
        number: wp.int32,
        u_direction: wp.vec2,
        u_target: wp.float32,
    ) -> Emission:
        e = Emission()
        e.origin = lights.spots.position[number]
        axis = lights.spots.z[number]
        cutoff = lights.spots.cutoff[number]
        own = 1.0 - cutoff
        total = own
        if aimed == 1:
            total = sum_of_cones(targets, e.origin, axis, cutoff)
        weight = 2.0 * PI * own
        if total < own:
            a = aim(targets, e.origin, axis, cutoff, total, u_target, u_direction)
            e.direction = a.vector
            weight = 0.0
            if a.pdf > 0.0:
                weight = 1.0 / a.pdf
        else:
            e.direction = around(axis, uniform_cone(u_direction, own))
        e.flux = spot_intensity(lights.spots, textures, number, e.direction) * weight
        return e

    @wp.func
    def emit(
        lights: Lights,
        textures: Textures,
        cumulative: wp.array[wp.float64],
        targets: Targets,
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
        e = Emission()
        if element < lights.triangles:
            e = from_triangle(lights, textures, targets, towards, element, u_position, u_direction, u_target)
        if wp.static(features.points):
            if element >= lights.triangles and element < lights.first_spot:
                e = from_point(lights, targets, towards, element - lights.triangles, u_direction, u_target)
        if wp.static(features.spots):
            if element >= lights.first_spot and element < lights.first_directional:
                e = from_spot(lights, textures, targets, towards, element - lights.first_spot, u_direction, u_target)
        if wp.static(features.directionals):
            if element >= lights.first_directional and element < lights.first_environment:
                number = element - lights.first_directional
                e = parallel_emission(
                    lights,
                    targets,
                    towards,
                    lights.directional_direction[number],
                    lights.directional_irradiance[number],
                    u_target,
                    u_position,
                )
        if wp.static(features.environment):
            if element >= lights.first_environment:
                found = sample_environment(lights.environment, u_direction)
                value = wp.vec3(0.0)
                if found.pdf > 0.0:
                    value = found.radiance / found.pdf
                e = parallel_emission(lights, targets, towards, -found.direction, value, u_target, u_position)
        e.element = element
        e.light = lights.light[element]
        e.medium = lights.medium[e.light]
        if probability > 0.0:
            e.flux = e.flux / probability
        else:
            e.flux = wp.vec3(0.0)
        return e

    return SimpleNamespace(emit=emit)
