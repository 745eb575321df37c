"""Camera rays as a function of pixel and sample number."""

from __future__ import annotations

import math

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.random import PURPOSE_PIXEL, sample_2d, stream_of
from wdpm.scenes.model import Camera, FilterKind, PixelFilter

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

FILTER_STEPS = 1024
"""Steps of a filter's inverse distribution: linear between them, it misses a gaussian's by less than 1e-5 pixels."""


@wp.struct
class CameraView:
    """A perspective camera on a device; directions have length 1 along the camera's axis."""

    eye: wp.vec3
    forward: wp.vec3
    right: wp.vec3  # half the image plane's width at distance 1, towards the image's right
    down: wp.vec3  # half the image plane's height at distance 1, towards the image's bottom
    shift: wp.vec2  # the principal point's offset, in shares of the image's size
    width: wp.int32
    height: wp.int32
    near: wp.float32
    far: wp.float32
    filter: wp.array[wp.float32]  # inverse distribution of the pixel filter, [FILTER_STEPS + 1]
    seed: wp.uint32


@wp.struct
class Ray:
    """A ray; t counts in units of the direction's length."""

    origin: wp.vec3
    direction: wp.vec3
    t_max: wp.float32


def upload(camera: Camera, seed: int, device: str) -> CameraView:
    """A camera on a device."""
    m = np.asarray(camera.to_world, np.float64)
    axes = m[:3, :3] / np.linalg.norm(m[:3, :3], axis=0)
    half_width = math.tan(math.radians(camera.fov_x) / 2)
    half_height = half_width * camera.height / camera.width
    view = CameraView()
    view.eye = wp.vec3(*m[:3, 3])
    view.forward = wp.vec3(*axes[:, 2])
    view.right = wp.vec3(*(-axes[:, 0] * half_width))  # the camera's +x is to the left of the image
    view.down = wp.vec3(*(-axes[:, 1] * half_height))
    view.shift = wp.vec2(*camera.principal_point)
    view.width = camera.width
    view.height = camera.height
    view.near = camera.near_clip
    view.far = camera.far_clip
    view.filter = wp.array(filter_quantiles(camera.filter), dtype=wp.float32, device=device)
    view.seed = wp.uint32(seed)
    return view


def filter_quantiles(pixel_filter: PixelFilter) -> NDArray[np.float32]:
    """The inverse distribution of a pixel filter along one axis, in pixels, float32, shape [FILTER_STEPS + 1].

    Samples are placed in proportion to the filter, and all weigh the same (filter importance sampling, Ernst et al.
    2006). So a sample counts in its own pixel alone, and the image cannot depend on buckets.
    """
    radius = pixel_filter.radius
    if pixel_filter.kind is FilterKind.BOX:
        return np.linspace(-radius, radius, FILTER_STEPS + 1, dtype=np.float32)
    x = np.linspace(-radius, radius, 64 * FILTER_STEPS + 1)
    variance = pixel_filter.stddev**2
    density = np.maximum(np.exp(-(x**2) / (2 * variance)) - math.exp(-(radius**2) / (2 * variance)), 0.0)
    distribution = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2)])
    distribution /= distribution[-1]
    return np.interp(np.linspace(0, 1, FILTER_STEPS + 1), distribution, x).astype(np.float32)


@wp.func
def _quantile(table: wp.array[wp.float32], u: wp.float32) -> wp.float32:
    x = u * float(FILTER_STEPS)
    i = wp.min(int(x), FILTER_STEPS - 1)
    f = x - float(i)
    return table[i] * (1.0 - f) + table[i + 1] * f


@wp.func
def camera_ray(camera: CameraView, pixel: wp.int32, sample: wp.int32) -> Ray:
    """The ray of a sample of a pixel (counted row by row); it starts on the near clip plane and ends on the far one."""
    x = float(pixel % camera.width)
    y = float(pixel // camera.width)
    u = sample_2d(wp.uint32(sample), stream_of(camera.seed, PURPOSE_PIXEL, wp.uint32(pixel), 0))
    # In units of half the image, from its centre.
    px = 2.0 * ((x + 0.5 + _quantile(camera.filter, u[0])) / float(camera.width) - 0.5 - camera.shift[0])
    py = 2.0 * ((y + 0.5 + _quantile(camera.filter, u[1])) / float(camera.height) - 0.5 - camera.shift[1])
    ray = Ray()
    ray.direction = camera.forward + camera.right * px + camera.down * py
    ray.origin = camera.eye + ray.direction * camera.near
    ray.t_max = camera.far - camera.near
    return ray
