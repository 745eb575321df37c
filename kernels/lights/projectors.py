"""Projectors: a picture thrown from a point, of the same irradiance on any plane across the axis (Mitsuba)."""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.lights.elements import Lights
from wdpm.kernels.lights.photon_targets import Targets, aim, sum_of_cones
from wdpm.kernels.lights.samples import DeltaLightCode, DirectSample, Emission, towards
from wdpm.kernels.materials.texture import Textures, make_textures
from wdpm.scenes.model.lights import ProjectorLight

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_HALF_WIDTH = wp.constant(ProjectorLight.KIND.numbers.index("half_width"))
_HALF_HEIGHT = wp.constant(ProjectorLight.KIND.numbers.index("half_height"))


@functools.cache
def make_projectors(features: Features) -> DeltaLightCode:
    """The code of projectors."""
    lookup = make_textures(features).lookup

    @wp.func
    def projector_intensity(
        lights: wp.ref[Lights], textures: wp.ref[Textures], number: wp.int32, direction: wp.vec3
    ) -> wp.vec3:
        """Intensity in a direction away from the light, unit."""
        deltas = lights.deltas
        cosine = wp.dot(direction, deltas.z[number])
        if not cosine > 0.0:
            return wp.vec3(0.0)
        # +x is the left of the picture, +y its top.
        u = 0.5 - 0.5 * wp.dot(direction, deltas.x[number]) / (cosine * deltas.number[number, _HALF_WIDTH])
        v = 0.5 + 0.5 * wp.dot(direction, deltas.y[number]) / (cosine * deltas.number[number, _HALF_HEIGHT])
        if u < 0.0 or u > 1.0 or v < 0.0 or v > 1.0:
            return wp.vec3(0.0)
        value = deltas.color[number] / (cosine * cosine * cosine)
        if wp.static(features.textured_lights):
            if deltas.texture[number] >= 0:
                value = wp.cw_mul(value, lookup(textures, deltas.texture[number], wp.vec2(u, v), wp.vec3(1.0)))
        return value

    @wp.func
    def direct_projector(
        lights: wp.ref[Lights], textures: wp.ref[Textures], number: wp.int32, position: wp.vec3, probability: wp.float32
    ) -> DirectSample:
        s = towards(position, lights.deltas.position[number], probability)
        way = s.end - position
        s.delta = 1
        if s.pdf > 0.0:
            s.radiance = projector_intensity(lights, textures, number, -s.direction) / wp.dot(way, way)
        return s

    @wp.func
    def emit_projector(
        lights: wp.ref[Lights],
        textures: wp.ref[Textures],
        targets: wp.ref[Targets],
        aimed: wp.int32,
        number: wp.int32,
        u_position: wp.vec2,
        u_direction: wp.vec2,
        u_target: wp.float32,
    ) -> Emission:
        emitted = Emission()
        emitted.origin = lights.deltas.position[number]
        axis = lights.deltas.z[number]
        cutoff = lights.deltas.cutoff[number]
        half_width = lights.deltas.number[number, _HALF_WIDTH]
        half_height = lights.deltas.number[number, _HALF_HEIGHT]
        own = 1.0 - cutoff
        total = own
        if aimed == 1:
            total = sum_of_cones(targets, emitted.origin, axis, cutoff)
        if total < own:
            a = aim(targets, emitted.origin, axis, cutoff, total, u_target, u_direction)
            emitted.direction = a.vector
            if a.pdf > 0.0:
                emitted.flux = projector_intensity(lights, textures, number, emitted.direction) / a.pdf
        else:
            # Evenly over the picture at distance 1: pdf_solid_angle is 1 / (area cos³).
            x = (2.0 * u_direction[0] - 1.0) * half_width
            y = (2.0 * u_direction[1] - 1.0) * half_height
            emitted.direction = wp.normalize(axis + lights.deltas.x[number] * x + lights.deltas.y[number] * y)
            cosine = wp.dot(emitted.direction, axis)
            area = 4.0 * half_width * half_height
            emitted.flux = projector_intensity(lights, textures, number, emitted.direction) * (
                area * cosine * cosine * cosine
            )
        return emitted

    return DeltaLightCode(ProjectorLight.KIND.number, direct_projector, emit_projector)
