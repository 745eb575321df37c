"""Radiance of glowing triangles."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.lights.elements import Lights
from wdpm.kernels.materials.texture import Textures, make_textures

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@dataclass(frozen=True, eq=False)
class RadianceCode:
    """Radiance of glowing triangles.

    Attributes:
        emitted_radiance: `(lights, textures, emitter, uv, color) -> vec3`, at a place of a mesh.
        radiance_of: `(lights, textures, element, w) -> vec3`, at a point of an element.
    """

    emitted_radiance: wp.Function
    radiance_of: wp.Function


@functools.cache
def make_radiance(features: Features) -> RadianceCode:
    """Radiance of glowing triangles, textured where features say so."""
    lookup = make_textures(features).lookup

    @wp.func
    def emitted_radiance(
        lights: wp.ref[Lights], textures: wp.ref[Textures], emitter: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> wp.vec3:
        """Radiance of a glowing mesh's lit side.

        Args:
            color: vertex colour there.
        """
        radiance = lights.emitter_radiance[emitter]
        if wp.static(features.textured_lights):
            texture = lights.emitter_texture[emitter]
            if texture >= 0:
                radiance = wp.cw_mul(radiance, lookup(textures, texture, uv, color))
        return radiance

    @wp.func
    def radiance_of(lights: wp.ref[Lights], textures: wp.ref[Textures], element: wp.int32, w: wp.vec2) -> wp.vec3:
        """Radiance of a glowing triangle at the weights of corners 1 and 2."""
        emitter = lights.emitter[element]
        radiance = lights.emitter_radiance[emitter]
        if wp.static(features.textured_lights):
            if lights.emitter_texture[emitter] >= 0:
                a = 1.0 - w[0] - w[1]
                uv = lights.uvs[element, 0] * a + lights.uvs[element, 1] * w[0] + lights.uvs[element, 2] * w[1]
                color = wp.vec3(1.0)
                if lights.colored == 1:
                    c0 = lights.colors[element, 0]
                    color = c0 * a + lights.colors[element, 1] * w[0] + lights.colors[element, 2] * w[1]
                radiance = wp.cw_mul(radiance, lookup(textures, lights.emitter_texture[emitter], uv, color))
        return radiance

    return RadianceCode(emitted_radiance, radiance_of)
