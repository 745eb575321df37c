"""Point lights: alike in all directions."""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.constants import PI
from wdpm.kernels.features import Features
from wdpm.kernels.lights.elements import Lights
from wdpm.kernels.lights.photon_targets import Targets, aim, sum_of_cones
from wdpm.kernels.lights.samples import DeltaLightCode, DirectSample, Emission, towards
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.maths.directions import uniform_sphere
from wdpm.scenes.model.lights import PointLight

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_SPHERE = wp.constant(wp.float32(2.0))  # 1 - cos of the half angle


@wp.func
def direct_point(
    lights: wp.ref[Lights], textures: wp.ref[Textures], number: wp.int32, position: wp.vec3, probability: wp.float32
) -> DirectSample:
    """The way from a place to a point light."""
    s = towards(position, lights.deltas.position[number], probability)
    way = s.end - position
    s.delta = 1
    if s.pdf > 0.0:
        s.radiance = lights.deltas.color[number] / wp.dot(way, way)
    return s


@wp.func
def emit_point(
    lights: wp.ref[Lights],
    textures: wp.ref[Textures],
    targets: wp.ref[Targets],
    aimed: wp.int32,
    number: wp.int32,
    u_position: wp.vec2,
    u_direction: wp.vec2,
    u_target: wp.float32,
) -> Emission:
    """A photon of a point light: even over the sphere, or aimed."""
    emitted = Emission()
    emitted.origin = lights.deltas.position[number]
    intensity = lights.deltas.color[number]
    total = _SPHERE
    axis = wp.vec3(0.0, 0.0, 1.0)
    if aimed == 1:
        total = sum_of_cones(targets, emitted.origin, axis, -1.0)
    if total < _SPHERE:
        a = aim(targets, emitted.origin, axis, -1.0, total, u_target, u_direction)
        emitted.direction = a.vector
        if a.pdf > 0.0:
            emitted.flux = intensity / a.pdf
    else:
        emitted.direction = uniform_sphere(u_direction)
        emitted.flux = intensity * (4.0 * PI)
    return emitted


@functools.cache
def make_points(features: Features) -> DeltaLightCode:
    """The code of point lights."""
    return DeltaLightCode(PointLight.KIND.number, direct_point, emit_point)
