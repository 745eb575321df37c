"""What vertices of camera paths meet, told in full: for replays of single samples, not for renders.

Everything is found by the functions and the random numbers of shading.py, so it is what a render finds, too.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera import CameraView, whole_pixel
from wdpm.kernels.camera_rays import Paths
from wdpm.kernels.features import Features
from wdpm.kernels.lights import Lights, make_lights
from wdpm.kernels.materials import Materials
from wdpm.kernels.random import PURPOSE_BOUNCE, PURPOSE_LIGHT, sample_1d, sample_2d, stream_of
from wdpm.kernels.shading import _CHOICE, _DIMENSIONS
from wdpm.kernels.surface import Surface, Surfaces, make_surface
from wdpm.kernels.texture import Textures

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
        lights: Lights,
        camera: CameraView,
        paths: Paths,
        light_samples: wp.int32,
        offset: wp.int32,
        surface_out: wp.array[Surface],
        light_out: wp.array[wp.int32],
    ) -> None:
        """The surface that each path meets, and the lights that its shadow rays go to.

        Args:
            light_samples: shadow rays a vertex.
            light_out: light of shadow ray j of vertex i at i * light_samples + j; -1 for none.
        """
        i = offset + wp.tid()
        item = wp.uint32(whole_pixel(camera, paths.pixel[i]))
        bounce = paths.bounce[i]
        sample = wp.uint32(paths.sample[i])
        u_choice = wp.float32(0.0)
        if wp.static(features.blend or features.passing):
            stream = stream_of(camera.seed, PURPOSE_BOUNCE, item, _DIMENSIONS * bounce + _CHOICE)
            u_choice = wp.float32(sample_1d(sample, stream))
        to_viewer = -wp.normalize(paths.direction[i])
        s = surface_at(surfaces, materials, textures, paths.prim[i], paths.u[i], paths.v[i], to_viewer, u_choice)
        surface_out[i] = s
        for j in range(light_samples):
            light = wp.int32(-1)
            if lights.count > 0:
                index = sample * wp.uint32(light_samples) + wp.uint32(j)
                u_element = sample_1d(index, stream_of(camera.seed, PURPOSE_LIGHT, item, 2 * bounce))
                u = sample_2d(index, stream_of(camera.seed, PURPOSE_LIGHT, item, 2 * bounce + 1))
                found = sample_direct(lights, textures, s.position, u_element, u)
                if found.pdf > 0.0:
                    light = found.light
            light_out[i * light_samples + j] = light

    return look_at_vertices
