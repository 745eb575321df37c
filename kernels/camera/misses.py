"""Rays of camera paths that meet no surface: what comes from beyond the scene, and from the medium on the way there."""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.medium_vertices import collision_at, length_to, make_flight_of
from wdpm.kernels.camera.paths import Paths, Vertex, camera_path
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.vertices import BY_FINAL_GATHER, BY_PATHS, Orders, Stretches, stretch
from wdpm.kernels.features import Features
from wdpm.kernels.lights.lights import make_lights
from wdpm.kernels.made_for import made_for
from wdpm.kernels.materials.flights import make_flights
from wdpm.kernels.rays.cells import cell_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@functools.cache
def make_escaped(features: Features) -> wp.Function:
    """The function `escaped` for a set of features: (scene, p, orders, stretches_out) -> radiance."""
    light = make_lights(features)
    environment_from = light.environment_from
    environment_radiance = light.environment_radiance
    transmittance_of = make_flights(features).transmittance_of

    @wp.func
    def escaped(scene: wp.ref[Scene], p: Vertex, orders: Orders, stretches_out: wp.ref[Stretches]) -> wp.vec3:
        """What its environment and, without end, its medium send back to a ray that leaves the scene."""
        radiance = wp.vec3(0.0)
        if wp.static(features.environment):
            unit = wp.normalize(p.direction)
            weighted = wp.bool(False)
            if wp.static(features.glossy or features.traced):
                if p.pdf > 0.0:
                    seen = environment_from(scene.lights, p.anchor, unit)
                    radiance = seen.radiance * (p.pdf / (p.pdf + seen.pdf))
                    weighted = wp.bool(True)
            if not weighted:
                radiance = environment_radiance(scene.lights, unit)
            if wp.static(features.traced):
                if orders.diffuse_light == BY_FINAL_GATHER and p.diffuse > 0:
                    radiance = wp.vec3(0.0)
            radiance = wp.cw_mul(p.throughput, radiance)
        if wp.static(features.media):
            length = length_to(scene.lights, p)
            stretch(p, length, orders.light_samples, stretches_out)
            if orders.diffuse_light != BY_PATHS:
                if p.medium >= 0:
                    along = wp.normalize(p.direction)
                    through = transmittance_of(scene.media, p.medium, p.origin, along, length)
                    radiance = wp.cw_mul(radiance, through)
        return radiance

    return escaped


@functools.cache
def make_path_misses(features: Features) -> wp.Kernel:
    """The kernel `path_misses` for a set of features."""
    escaped = make_escaped(features)
    flight_of = make_flight_of(features)

    @made_for(features)
    def path_misses(
        scene: Scene,
        paths: Paths,
        orders: Orders,
        offset: wp.int32,
        radiance_out: wp.array[wp.vec3],
        collision_out: wp.array[wp.int32],
        stretches_out: Stretches,
    ) -> None:
        """Rays of camera paths that meet no surface.

        Args:
            collision_out: in BY_PATHS, the cell in which each path collides in its medium, -1 where it does not.
        """
        i = offset + wp.tid()
        p = camera_path(scene.camera, paths, i)
        radiance = escaped(scene, p, orders, stretches_out)
        collision = wp.int32(-1)
        if wp.static(features.media and features.traced):
            if orders.diffuse_light == BY_PATHS:
                flight = flight_of(scene.media, scene.lights, p, scene.camera.seed)
                radiance = wp.cw_mul(radiance, flight.weight)
                if flight.scatters == 1:
                    radiance = wp.vec3(0.0)
                    collision = cell_of(scene.cells, collision_at(p, flight))
        radiance_out[i] = radiance
        collision_out[i] = collision

    return path_misses
