"""Spot lights: full within one angle about their axis, falling to none at another.

Linearly in the angle (Mitsuba), or as the square of a line in the cosine (KHR_lights_punctual), where steepness is
below 0.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.constants import PI
from wdpm.kernels.features import Features
from wdpm.kernels.lights.elements import Lights
from wdpm.kernels.lights.photon_targets import Targets, aim, sum_of_cones
from wdpm.kernels.lights.samples import DeltaLightCode, DirectSample, Emission, towards
from wdpm.kernels.materials.texture import Textures, make_textures
from wdpm.kernels.maths.directions import around, uniform_cone
from wdpm.kernels.maths.elementary import acos_of
from wdpm.scenes.model.lights import SpotLight

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_BEAM = wp.constant(SpotLight.KIND.numbers.index("beam"))
_ANGLE = wp.constant(SpotLight.KIND.numbers.index("angle"))
_STEEPNESS = wp.constant(SpotLight.KIND.numbers.index("steepness"))
_SPREAD = wp.constant(SpotLight.KIND.numbers.index("spread"))


@functools.cache
def make_spots(features: Features) -> DeltaLightCode:
    """The code of spot lights."""
    lookup = make_textures(features).lookup

    @wp.func
    def spot_intensity(
        lights: wp.ref[Lights], textures: wp.ref[Textures], spot: wp.int32, direction: wp.vec3
    ) -> wp.vec3:
        """Intensity in a direction away from the light, unit."""
        deltas = lights.deltas
        cosine = wp.dot(direction, deltas.z[spot])
        if not cosine > deltas.cutoff[spot]:
            return wp.vec3(0.0)
        value = deltas.color[spot]
        if cosine < deltas.number[spot, _BEAM]:
            steepness = deltas.number[spot, _STEEPNESS]
            if steepness < 0.0:
                line = (cosine - deltas.cutoff[spot]) * steepness
                value = value * (line * line)
            else:
                value = value * ((deltas.number[spot, _ANGLE] - acos_of(cosine)) * steepness)
        if wp.static(features.textured_lights):
            if deltas.texture[spot] >= 0:
                # The image lies across the axis and spans the cone; v grows downwards in Mitsuba's, so here it falls.
                scale = 0.5 / (cosine * deltas.number[spot, _SPREAD])
                u = 0.5 + wp.dot(direction, deltas.x[spot]) * scale
                v = 0.5 - wp.dot(direction, deltas.y[spot]) * scale
                value = wp.cw_mul(value, lookup(textures, deltas.texture[spot], wp.vec2(u, v), wp.vec3(1.0)))
        return value

    @wp.func
    def direct_spot(
        lights: wp.ref[Lights], textures: wp.ref[Textures], number: wp.int32, position: wp.vec3, probability: wp.float32
    ) -> DirectSample:
        s = towards(position, lights.deltas.position[number], probability)
        way = s.end - position
        s.delta = 1
        if s.pdf > 0.0:
            s.radiance = spot_intensity(lights, textures, number, -s.direction) / wp.dot(way, way)
        return s

    @wp.func
    def emit_spot(
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
        own = 1.0 - cutoff
        total = own
        if aimed == 1:
            total = sum_of_cones(targets, emitted.origin, axis, cutoff)
        weight = 2.0 * PI * own
        if total < own:
            a = aim(targets, emitted.origin, axis, cutoff, total, u_target, u_direction)
            emitted.direction = a.vector
            weight = 0.0
            if a.pdf > 0.0:
                weight = 1.0 / a.pdf
        else:
            emitted.direction = around(axis, uniform_cone(u_direction, own))
        emitted.flux = spot_intensity(lights, textures, number, emitted.direction) * weight
        return emitted

    return DeltaLightCode(SpotLight.KIND.number, direct_spot, emit_spot)
