"""Camera rays as a function of pixel and sample number: pinhole, thin lens or parallel; whole images and crops.

Pixels are numbered row by row in what is rendered. The random numbers of a pixel are those of its place in the whole
image, so that a crop is a cut-out, bit for bit.
"""

from __future__ import annotations

import functools
import math

import numpy as np
import warp as wp

from wdpm.kernels.camera.pixel_filter import FILTER_STEPS, filter_quantiles, placed_by
from wdpm.kernels.features import Features
from wdpm.kernels.maths.directions import concentric_disk
from wdpm.kernels.maths.random import PURPOSE_PIXEL, sample_2d, stream_of
from wdpm.scenes.model.scene import Camera

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


# Dimensions of a pixel's random numbers.
_FILM = wp.constant(0)
_LENS = wp.constant(1)


@wp.struct
class CameraView:
    """A camera on a device; directions have length 1 along the camera's axis.

    Attributes:
        right, down: half the image plane's width and height, towards the image's right and bottom: at distance 1 of
            a perspective camera.
        shift: the principal point's offset, in shares of the image's size.
        width: of what is rendered, in pixels.
        whole_width, whole_height: of the image that it is part of.
        left, top: of the crop in that image.
        near, far: of t.
        start: from the eye to the near plane of an orthographic camera.
        lens_x, lens_y: radii of the lens to the image's right and bottom; unused where lens_radius is 0.
        focus: distance of the plane in focus along the axis.
        parallel: 1 for an orthographic camera.
        filter: inverse distribution of what places samples about the middle of a pixel, [FILTER_STEPS + 1].
        medium: that the camera is in, -1 for none.
    """

    eye: wp.vec3
    forward: wp.vec3
    right: wp.vec3
    down: wp.vec3
    shift: wp.vec2
    width: wp.int32
    height: wp.int32
    whole_width: wp.int32
    whole_height: wp.int32
    left: wp.int32
    top: wp.int32
    near: wp.float32
    far: wp.float32
    start: wp.vec3
    lens_radius: wp.float32
    lens_x: wp.vec3
    lens_y: wp.vec3
    focus: wp.float32
    parallel: wp.int32
    filter: wp.array[wp.float32]
    medium: wp.int32
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
    axes = m[:3, :3] / np.sqrt(m[0, :3] ** 2 + m[1, :3] ** 2 + m[2, :3] ** 2)
    whole_width, whole_height = camera.full_size or (camera.width, camera.height)
    left, top = (0, 0) if camera.crop is None else camera.crop[:2]
    half_width = 1.0 if camera.orthographic else tangent(camera.fov_x / 2)
    plane = m[:3, :3] if camera.orthographic else axes
    view = CameraView()
    view.eye = wp.vec3(*m[:3, 3])
    view.forward = wp.vec3(*axes[:, 2])
    view.right = wp.vec3(*(-plane[:, 0] * half_width))  # the camera's +x is to the left of the image
    view.down = wp.vec3(*(-plane[:, 1] * (half_width * whole_height / whole_width)))
    view.shift = wp.vec2(*camera.principal_point)
    view.width, view.height = camera.width, camera.height
    view.whole_width, view.whole_height = whole_width, whole_height
    view.left, view.top = left, top
    view.near = camera.near_clip
    view.far = camera.far_clip
    view.start = wp.vec3(*(plane[:, 2] * camera.near_clip))
    view.lens_radius = camera.aperture_radius
    view.lens_x = wp.vec3(*(-axes[:, 0] * camera.aperture_radius))
    view.lens_y = wp.vec3(*(-axes[:, 1] * camera.aperture_radius))
    view.focus = camera.focus_distance
    view.parallel = int(camera.orthographic)
    view.filter = wp.array(filter_quantiles(placed_by(camera.filter)), dtype=wp.float32, device=device)
    view.medium = -1 if camera.medium is None else camera.medium
    view.seed = wp.uint32(seed)
    return view


def tangent(degrees: float) -> float:
    """Tangent of an angle in [0, 90) degrees, with the same bits on every machine, which math.tan has not.

    By the power series of sine and cosine for half the angle, at most pi / 4, and tan(2 a) = 2 tan(a) / (1 - tan²(a)).
    """
    a = degrees * (math.pi / 360.0)
    sine = cosine = 1.0
    for k in range(12, 0, -1):  # Horner's rule: the next terms are below 1e-25
        sine = 1.0 - sine * a * a / (2 * k * (2 * k + 1))
        cosine = 1.0 - cosine * a * a / ((2 * k - 1) * 2 * k)
    t = a * sine / cosine
    return 2.0 * t / ((1.0 - t) * (1.0 + t))


@wp.func
def _quantile(table: wp.array[wp.float32], u: wp.float32) -> wp.float32:
    x = u * float(FILTER_STEPS)
    i = wp.min(int(x), FILTER_STEPS - 1)
    f = x - float(i)
    return table[i] * (1.0 - f) + table[i + 1] * f


@wp.func
def whole_pixel(camera: wp.ref[CameraView], pixel: wp.int32) -> wp.int32:
    """The number that a pixel has in the whole image: the item of its random numbers."""
    row = pixel // camera.width
    return (row + camera.top) * camera.whole_width + (pixel - row * camera.width) + camera.left


@wp.func
def film_numbers(camera: wp.ref[CameraView], pixel: wp.int32, sample: wp.int32) -> wp.vec2:
    """The random numbers of a sample's place in its pixel."""
    item = wp.uint32(whole_pixel(camera, pixel))
    return sample_2d(wp.uint32(sample), stream_of(camera.seed, PURPOSE_PIXEL, item, _FILM))


@functools.cache
def make_camera(features: Features) -> wp.Function:
    """The function `camera_ray` for cameras with a set of features: (camera, pixel, sample) -> Ray."""

    @wp.func
    def camera_ray(camera: wp.ref[CameraView], pixel: wp.int32, sample: wp.int32) -> Ray:
        """The ray of a sample of a pixel; it starts on the near clip plane and ends on the far one."""
        x = float(pixel % camera.width + camera.left)
        y = float(pixel // camera.width + camera.top)
        item = wp.uint32(whole_pixel(camera, pixel))
        u = film_numbers(camera, pixel, sample)
        # In units of half the image, from its centre.
        px = 2.0 * ((x + 0.5 + _quantile(camera.filter, u[0])) / float(camera.whole_width) - 0.5 - camera.shift[0])
        py = 2.0 * ((y + 0.5 + _quantile(camera.filter, u[1])) / float(camera.whole_height) - 0.5 - camera.shift[1])
        ray = Ray()
        ray.t_max = camera.far - camera.near
        if wp.static(features.orthographic):
            if camera.parallel == 1:
                ray.direction = camera.forward
                ray.origin = camera.eye + camera.right * px + camera.down * py + camera.start
                return ray
        ray.direction = camera.forward + camera.right * px + camera.down * py
        ray.origin = camera.eye + ray.direction * camera.near
        if wp.static(features.lens):
            if camera.lens_radius > 0.0:
                d = concentric_disk(sample_2d(wp.uint32(sample), stream_of(camera.seed, PURPOSE_PIXEL, item, _LENS)))
                # All rays of a sample meet where the pinhole's passes the plane in focus.
                aside = camera.lens_x * d[0] + camera.lens_y * d[1]
                ray.direction = ray.direction - aside / camera.focus
                ray.origin = camera.eye + aside + ray.direction * camera.near
        return ray

    return camera_ray
