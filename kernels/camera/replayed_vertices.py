"""What vertices of camera paths meet, told in full: for replays of single samples, not for renders.

Everything is found by the functions and the random numbers of shading.py, so it is what a render finds, too.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.camera import CameraView
from wdpm.kernels.camera.medium_vertices import collision_at, flight_of
from wdpm.kernels.camera.rays import Paths
from wdpm.kernels.camera.vertices import BY_PATHS, CHOICE, camera_path, number_1d
from wdpm.kernels.features import Features
from wdpm.kernels.lights.lights import Lights, make_lights
from wdpm.kernels.materials.medium import DistanceSample, Media
from wdpm.kernels.materials.resolve import Materials
from wdpm.kernels.materials.surface import Surface, Surfaces, make_surface
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.maths.random import PURPOSE_LIGHT, sample_2d_fine, stream_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@functools.cache
def make_look(features: Features) -> wp.Kernel:
    """The kernel `look_at_vertices` for a set of features."""
    surface_at = make_surface(features).surface_at
    sample_direct = make_lights(features).sample_direct

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def look_at_vertices(
        surfaces: Surfaces,
        materials: Materials,
        textures: Textures,
        media: Media,
        lights: Lights,
        camera: CameraView,
        paths: Paths,
        shots: wp.int32,
        diffuse_light: wp.int32,
        offset: wp.int32,
        surface_out: wp.array[Surface],
        flight_out: wp.array[DistanceSample],
        light_out: wp.array[wp.int32],
    ) -> None:
        """What each path meets, and the lights that its shadow rays go to.

        Args:
            shots: shadow rays of each vertex.
            diffuse_light: BY_MAP, BY_PATHS or BY_FINAL_GATHER.
            flight_out: in BY_PATHS, whether the path collides in a medium before the surface, and where.
            light_out: light of shadow ray j of vertex i at i * shots + j; -1 for none.
        """
        i = offset + wp.tid()
        p = camera_path(camera, paths, i)
        s = Surface()
        if p.prim >= 0:
            u_choice = wp.float32(0.0)
            if wp.static(features.blend or features.passing):
                u_choice = number_1d(camera.seed, p, CHOICE)
            to_viewer = -wp.normalize(p.direction)
            s = surface_at(surfaces, materials, textures, p.prim, p.u, p.v, to_viewer, u_choice)
        position = s.position
        flight = DistanceSample()
        if wp.static(features.media and features.traced):
            if diffuse_light == BY_PATHS:
                flight = flight_of(media, lights, p, camera.seed)
                if flight.scatters == 1:
                    position = collision_at(p, flight)
        surface_out[i] = s
        flight_out[i] = flight
        for j in range(shots):
            light = wp.int32(-1)
            if lights.count > 0:
                index = wp.uint32(p.sample) * wp.uint32(shots) + wp.uint32(j)
                point = sample_2d_fine(index, stream_of(camera.seed, PURPOSE_LIGHT, p.item, p.bounce))
                found = sample_direct(lights, textures, position, point)
                if found.pdf > 0.0:
                    light = found.light
            light_out[i * shots + j] = light

    return look_at_vertices
