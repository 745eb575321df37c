"""Flights through media of all kinds: a grid's optical length is to it what length is to a homogeneous medium.

A medium whose density changes from place to place takes the same light on a way as a homogeneous one, of density 1,
takes on the way's optical length (grid_walks). So free paths are sampled as optical lengths (medium.free_path), become
distances by a walk, and every weight of medium.py holds with optical lengths in place of distances.

Where no medium has a grid the functions are the identity, and nothing of them is compiled.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.grid_walks import lattice_ray, passed_up_to, walk
from wdpm.kernels.materials.grids import color_at
from wdpm.kernels.materials.medium import Media, transmittance

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_INF = wp.constant(wp.float32(math.inf))
_ZERO = wp.constant(wp.float64(0.0))
_FAR = wp.constant(wp.float64(math.inf))


@dataclass(frozen=True)
class Flights:
    """Functions for flights through media; `medium` is the number of one, not -1, where nothing else is said.

    Attributes:
        optical_length: (media, medium, origin, unit direction, length) -> of that stretch; the length itself in a
            homogeneous medium, and in empty space (medium -1).
        distance_at: (media, medium, origin, unit direction, optical length) -> distance at which it is passed, inf
            where it never is; medium may be -1.
        transmittance_of: (media, medium, origin, unit direction, length) -> by channel; medium may be -1.
        albedo_at: (media, medium, position) -> by channel.
    """

    optical_length: wp.Function
    distance_at: wp.Function
    transmittance_of: wp.Function
    albedo_at: wp.Function


def make_flights(features: Features) -> Flights:
    """The functions for a set of features."""
    return _make_flights(features.grids)


@functools.cache
def _make_flights(grids: bool) -> Flights:
    @wp.func
    def optical_length(
        media: wp.ref[Media], medium: wp.int32, origin: wp.vec3, direction: wp.vec3, length: wp.float32
    ) -> wp.float32:
        if wp.static(grids):
            if medium >= 0:
                if media.density[medium] >= 0:
                    ray = lattice_ray(media.grids, media.density[medium], origin, direction)
                    return wp.float32(passed_up_to(media.grids, ray, _ZERO, wp.float64(length)))
        return length

    @wp.func
    def distance_at(
        media: wp.ref[Media], medium: wp.int32, origin: wp.vec3, direction: wp.vec3, passed: wp.float32
    ) -> wp.float32:
        if wp.static(grids):
            if medium >= 0 and passed < _INF:
                if media.density[medium] >= 0:
                    ray = lattice_ray(media.grids, media.density[medium], origin, direction)
                    found = walk(media.grids, ray, _ZERO, _FAR, wp.float64(passed))
                    return wp.where(found.arrived == 1, wp.float32(found.t), _INF)
        return passed

    @wp.func
    def transmittance_of(
        media: wp.ref[Media], medium: wp.int32, origin: wp.vec3, direction: wp.vec3, length: wp.float32
    ) -> wp.vec3:
        if wp.static(grids):
            return transmittance(media, medium, optical_length(media, medium, origin, direction, length))
        return transmittance(media, medium, length)

    @wp.func
    def albedo_at(media: wp.ref[Media], medium: wp.int32, position: wp.vec3) -> wp.vec3:
        if wp.static(grids):
            if media.albedo_grid[medium] >= 0:
                return color_at(media.grids, media.albedo_grid[medium], position)
        return media.albedo[medium]

    return Flights(optical_length, distance_at, transmittance_of, albedo_at)
