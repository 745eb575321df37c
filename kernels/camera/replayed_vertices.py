"""What vertices of camera paths meet, written out in full: for replays of single samples, not for renders.

Everything is found by the functions and the random numbers of shading.py, so it is what a render finds, too.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.medium_vertices import collision_at, make_flight_of
from wdpm.kernels.camera.paths import Paths, camera_path
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.vertices import BY_PATHS, CHOICE, Orders, number_1d
from wdpm.kernels.features import Features
from wdpm.kernels.lights.lights import make_lights
from wdpm.kernels.made_for import made_for
from wdpm.kernels.materials.medium import DistanceSample
from wdpm.kernels.materials.surface import Surface, make_surface
from wdpm.kernels.maths.random import PURPOSE_LIGHT, sample_2d_fine, stream_of
from wdpm.kernels.maths.sample_numbers import number_of_sample

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@functools.cache
def make_replay_vertices(features: Features) -> wp.Kernel:
    """The kernel `replay_vertices` for a set of features."""
    surface_at = make_surface(features).surface_at
    sample_direct = make_lights(features).sample_direct
    flight_of = make_flight_of(features)

    @made_for(features)
    def replay_vertices(
        scene: Scene,
        paths: Paths,
        orders: Orders,
        offset: wp.int32,
        surface_out: wp.array[Surface],
        flight_out: wp.array[DistanceSample],
        light_out: wp.array[wp.int32],
    ) -> None:
        """What each path meets, and the lights that its shadow rays go to.

        Args:
            flight_out: in BY_PATHS, whether the path collides in a medium before the surface, and where.
            light_out: light of shadow ray j of vertex i at i * orders.shots + j; -1 for none.
        """
        i = offset + wp.tid()
        p = camera_path(scene.camera, paths, i)
        s = Surface()
        if p.prim >= 0:
            u_choice = wp.float32(0.0)
            if wp.static(features.blend or features.passing):
                u_choice = number_1d(scene.camera.seed, p, CHOICE)
            to_viewer = -wp.normalize(p.direction)
            s = surface_at(scene.surfaces, scene.materials, scene.textures, p.prim, p.u, p.v, to_viewer, u_choice)
        position = s.position
        flight = DistanceSample()
        if wp.static(features.media and features.traced):
            if orders.diffuse_light == BY_PATHS:
                flight = flight_of(scene.media, scene.lights, p, scene.camera.seed)
                if flight.scatters == 1:
                    position = collision_at(p, flight)
        surface_out[i] = s
        flight_out[i] = flight
        for j in range(orders.shots):
            light = wp.int32(-1)
            if scene.lights.count > 0:
                index = number_of_sample(p.sample) * wp.uint32(orders.shots) + wp.uint32(j)
                point = sample_2d_fine(index, stream_of(scene.camera.seed, PURPOSE_LIGHT, p.item, p.bounce))
                found = sample_direct(scene.lights, scene.textures, position, point)
                if found.pdf > 0.0:
                    light = found.light
            light_out[i * orders.shots + j] = light

    return replay_vertices
