"""Directional lights: parallel light from infinitely far away."""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.lights.elements import Lights
from wdpm.kernels.lights.parallel import parallel_emission
from wdpm.kernels.lights.photon_targets import Targets
from wdpm.kernels.lights.samples import DeltaLightCode, DirectSample, Emission
from wdpm.kernels.materials.texture import Textures
from wdpm.scenes.model.lights import DirectionalLight

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def direct_directional(
    lights: wp.ref[Lights], textures: wp.ref[Textures], number: wp.int32, position: wp.vec3, probability: wp.float32
) -> DirectSample:
    """The way from a place against the light's direction, out of the scene."""
    s = DirectSample()
    s.direction = -lights.deltas.z[number]
    s.end = position + s.direction * lights.far_away
    s.radiance = lights.deltas.color[number]
    s.pdf = probability
    s.delta = 1
    return s


@wp.func
def emit_directional(
    lights: wp.ref[Lights],
    textures: wp.ref[Textures],
    targets: wp.ref[Targets],
    aimed: wp.int32,
    number: wp.int32,
    u_position: wp.vec2,
    u_direction: wp.vec2,
    u_target: wp.float32,
) -> Emission:
    """A photon of parallel light."""
    direction = lights.deltas.z[number]
    return parallel_emission(lights, targets, aimed, direction, lights.deltas.color[number], u_target, u_position)


@functools.cache
def make_directionals(features: Features) -> DeltaLightCode:
    """The code of directional lights."""
    return DeltaLightCode(DirectionalLight.KIND.number, direct_directional, emit_directional)
