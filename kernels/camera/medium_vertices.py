"""Vertices of camera paths in participating media, for path tracing: Kajiya & Von Herzen 1984, Raab et al. 2008.

A path in a medium flies freely (medium.py). Where it collides before it meets a surface, or where it meets none, the
medium scatters: direct light by shadow rays, over the phase function, and one ray that goes on by it, weighted against
each other like those of a surface. Free paths are those of one channel, chosen by what the path carries of each (the
history of a path counts: Kutz et al. 2017): the sum of its channels then never grows, however often it is weighted.

The collision is a function of the path and of the surface that it would have met: so whoever holds the path finds the
same, and no ray is cut short on its way through the cells.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.paths import Vertex
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.vertices import (
    Orders,
    Shaded,
    carry_on,
    numbers_2d,
    path_from,
    scattered_again,
    shoot,
    shot_of,
)
from wdpm.kernels.constants import COLLISION_MARGIN, ROULETTE_FROM_OF_PATHS, SURVIVAL_MOST_IN_MEDIUM
from wdpm.kernels.features import Features
from wdpm.kernels.lights.choice import light_starts
from wdpm.kernels.lights.lights import Lights, make_lights
from wdpm.kernels.lights.tree import Starts
from wdpm.kernels.materials.flights import make_flights
from wdpm.kernels.materials.medium import (
    DistanceSample,
    Media,
    channel_of,
    free_path_of,
    pass_weight_by,
    phase_sample,
    phase_value,
    scatter_weight_by,
    transmittance,
)
from wdpm.kernels.maths.random import PURPOSE_LIGHT, PURPOSE_MEDIUM, sample_1d, sample_2d_fine, stream_of
from wdpm.kernels.maths.sample_numbers import number_of_sample

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Dimensions of a vertex's random numbers, of a purpose of their own.
_CHANNEL = wp.constant(0)
_DISTANCE = wp.constant(1)
_DIMENSIONS = wp.constant(2)


@wp.func
def length_to(lights: wp.ref[Lights], p: Vertex) -> wp.float32:
    """Distance from a path's last vertex to the surface that it meets; beyond the scene if it meets none."""
    if p.prim < 0:
        return lights.far_away
    return p.t * wp.length(p.direction)


@wp.func
def _number(seed: wp.uint32, p: Vertex, dimension: wp.int32) -> wp.float32:
    stream = stream_of(seed, PURPOSE_MEDIUM, p.item, _DIMENSIONS * p.bounce + dimension)
    return wp.float32(sample_1d(number_of_sample(p.sample), stream))


@functools.cache
def make_flight_of(features: Features) -> wp.Function:
    """The function `flight_of` for a set of features."""
    flights = make_flights(features)
    optical_length = flights.optical_length
    distance_at = flights.distance_at

    @wp.func
    def flight_of(media: wp.ref[Media], lights: wp.ref[Lights], p: Vertex, seed: wp.uint32) -> DistanceSample:
        """Whether a path collides in the medium that it is in before it meets a surface, and where.

        A medium that scatters nothing takes its share without a choice: there is nothing to be found at a collision.
        One nearer to the surface than COLLISION_MARGIN is left out, as for photons: its vertex might be rounded through
        it.
        """
        length = length_to(lights, p)
        s = DistanceSample()
        s.t = length
        s.weight = wp.vec3(1.0)
        if p.medium >= 0:
            along = wp.normalize(p.direction)
            if wp.max(media.albedo[p.medium]) <= 0.0:
                s.weight = transmittance(media, p.medium, optical_length(media, p.medium, p.origin, along, length))
            else:
                share = p.throughput / (p.throughput[0] + p.throughput[1] + p.throughput[2])
                channel = channel_of(share, _number(seed, p, _CHANNEL))
                passed = free_path_of(media.sigma_t[p.medium][channel], _number(seed, p, _DISTANCE))
                free = distance_at(media, p.medium, p.origin, along, passed)
                if free + COLLISION_MARGIN * lights.offset_min < length:
                    s.t = free
                    s.scatters = 1
                    s.weight = scatter_weight_by(media, p.medium, passed, share)
                else:
                    whole = optical_length(media, p.medium, p.origin, along, length)
                    if wp.static(features.grids):
                        if media.density[p.medium] >= 0:
                            # It has not collided; where densities are huge, a rounding of t may say that it had.
                            whole = wp.min(whole, passed)
                    s.weight = pass_weight_by(media, p.medium, whole, share)
        return s

    return flight_of


@wp.func
def collision_at(p: Vertex, flight: DistanceSample) -> wp.vec3:
    """Where a path collides."""
    return p.origin + wp.normalize(p.direction) * flight.t


@functools.cache
def make_shade_medium(features: Features) -> wp.Function:
    """The function `shade_medium` for a set of features."""
    sample_direct_from = make_lights(features).sample_direct_from
    albedo_at = make_flights(features).albedo_at

    @wp.func
    def shade_medium(
        scene: wp.ref[Scene], p: Vertex, flight: DistanceSample, orders: Orders, shaded_out: wp.ref[Shaded]
    ) -> None:
        """Shadow rays and the ray that goes on from a collision.

        Args:
            flight: that led there.
        """
        max_depth = orders.max_depth
        seed = scene.camera.seed
        position = collision_at(p, flight)
        arrives = wp.normalize(p.direction)
        g = scene.media.g[p.medium]
        scattered = wp.cw_mul(wp.cw_mul(p.throughput, flight.weight), albedo_at(scene.media, p.medium, position))
        diffuse = wp.where(p.diffuse == 0, -1, scattered_again(p.diffuse))
        lit = scene.lights.count > 0 and (max_depth == 0 or p.edges + 1 <= max_depth)
        starts = Starts()
        if lit:
            starts = light_starts(scene.lights, position)
        for j in range(orders.shots):
            shot = shot_of(p, diffuse, orders, j)
            if lit:
                index = number_of_sample(p.sample) * wp.uint32(orders.shots) + wp.uint32(j)
                point = sample_2d_fine(index, stream_of(seed, PURPOSE_LIGHT, p.item, p.bounce))
                found = sample_direct_from(scene.lights, scene.textures, position, starts, point)
                if found.pdf > 0.0:
                    phase = phase_value(g, wp.dot(arrives, found.direction))
                    weight = phase / (found.pdf * wp.float32(orders.shots))
                    if found.delta == 0:
                        weight = weight * (found.pdf / (found.pdf + phase))
                    shot.radiance = wp.cw_mul(scattered, found.radiance) * weight
                shot.origin = position
                shot.direction = found.end - position
            shoot(p, orders, j, shot, shaded_out.shots)

        onward = path_from(p)
        onward.origin = position
        onward.direction = phase_sample(g, arrives, numbers_2d(seed, p))
        onward.anchor = position
        onward.pdf = phase_value(g, wp.dot(arrives, onward.direction))
        onward.edges = p.edges + 1
        onward.diffuse = diffuse
        if max_depth == 0 or p.edges + 1 <= max_depth:
            onward.throughput = scattered
        carry_on(p, onward, ROULETTE_FROM_OF_PATHS, SURVIVAL_MOST_IN_MEDIUM, 1.0, 0.0, seed, shaded_out.paths)

    return shade_medium
