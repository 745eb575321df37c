"""Spot lights: full within one angle about their axis, falling linearly in the angle to none at another (Mitsuba)."""

from __future__ import annotations

import functools
from types import SimpleNamespace

import numpy as np
import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.texture import Textures, make_textures
from wdpm.kernels.maths.elementary import acos_of
from wdpm.scenes.flat.light_table import LightTable

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Spots:
    """Spot lights on a device; fields as in scenes.flat.light_table, but for these.

    Attributes:
        cutoff, beam: cosines of the half angles of no light and of full light.
        angle: the first of the two [radians]; steepness: 1 / (that minus the second), 0 where the edge is sharp.
    """

    position: wp.array[wp.vec3]
    x: wp.array[wp.vec3]
    y: wp.array[wp.vec3]
    z: wp.array[wp.vec3]
    intensity: wp.array[wp.vec3]
    cutoff: wp.array[wp.float32]
    beam: wp.array[wp.float32]
    angle: wp.array[wp.float32]
    steepness: wp.array[wp.float32]
    texture: wp.array[wp.int32]
    spread: wp.array[wp.float32]


def upload(table: LightTable, device: str) -> Spots:
    """The spot lights on a device."""
    spots = Spots()
    spots.position = wp.array(table.spot_position, dtype=wp.vec3, device=device)
    for number, name in enumerate("xyz"):
        axis = np.ascontiguousarray(table.spot_axes[:, number])
        setattr(spots, name, wp.array(axis, dtype=wp.vec3, device=device))
    spots.intensity = wp.array(table.spot_intensity, dtype=wp.vec3, device=device)
    columns = (table.spot_cosines[:, 0], table.spot_cosines[:, 1], table.spot_falloff[:, 0], table.spot_falloff[:, 1])
    for name, column in zip(("cutoff", "beam", "angle", "steepness"), columns, strict=True):
        setattr(spots, name, wp.array(np.ascontiguousarray(column), dtype=wp.float32, device=device))
    spots.texture = wp.array(table.spot_texture, dtype=wp.int32, device=device)
    spots.spread = wp.array(table.spot_spread, dtype=wp.float32, device=device)
    return spots


@functools.cache
def make_spots(features: Features) -> SimpleNamespace:
    """Functions of spot lights: `spot_intensity`."""
    lookup = make_textures(features).lookup

    @wp.func
    def spot_intensity(spots: Spots, textures: Textures, spot: wp.int32, direction: wp.vec3) -> wp.vec3:
        """Intensity in a direction away from the light, unit."""
        cosine = wp.dot(direction, spots.z[spot])
        if not cosine > spots.cutoff[spot]:
            return wp.vec3(0.0)
        value = spots.intensity[spot]
        if cosine < spots.beam[spot]:
            value = value * ((spots.angle[spot] - acos_of(cosine)) * spots.steepness[spot])
        if wp.static(features.textured_lights):
            if spots.texture[spot] >= 0:
                # The image lies across the axis and spans the cone; v grows downwards in Mitsuba's, so here it falls.
                scale = 0.5 / (cosine * spots.spread[spot])
                u = 0.5 + wp.dot(direction, spots.x[spot]) * scale
                v = 0.5 - wp.dot(direction, spots.y[spot]) * scale
                value = wp.cw_mul(value, lookup(textures, spots.texture[spot], wp.vec2(u, v), wp.vec3(1.0)))
        return value

    return SimpleNamespace(spot_intensity=spot_intensity)
