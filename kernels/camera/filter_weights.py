"""What samples of a pixel weigh, with a filter that is negative somewhere.

Samples lie in proportion to the filter's magnitude |f|, each with f's sign s: the pixel is c times the mean of s L,
with c the integral of |f| over that of f. The signs do not add up to just n / c, so an even surface would come out
grainy. Mitsuba divides by the sum of weights for that reason; with few samples that may be near zero. Here the mean of
L is a control variate for what is missing:

    pixel = c mean(s L) + (1 - c mean(s)) mean(L) = mean(w L),   w = 1 + c (s - mean(s)).

The weights have the mean 1 whatever the signs, an even surface is even, and one sample weighs 1. With n samples the
pixel is off by c / n times the covariance of s and L at most, less since samples are stratified. The mean of s is over
all samples from number 0 to the last of the view: what a pass shows depends on nothing but its own number.
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.camera import CameraView, film_numbers
from wdpm.kernels.camera.pixel_filter import FILTER_STEPS

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _sign(camera: wp.ref[CameraView], signs: wp.array[wp.float32], pixel: wp.int32, sample: wp.int32) -> wp.float32:
    u = film_numbers(camera, pixel, sample)
    last = FILTER_STEPS - 1
    # the steps that camera_ray looks up
    return signs[wp.min(int(u[0] * float(FILTER_STEPS)), last)] * signs[wp.min(int(u[1] * float(FILTER_STEPS)), last)]


@wp.kernel
def sum_signs(
    camera: CameraView,
    signs: wp.array[wp.float32],
    pixels: wp.array[wp.int32],
    samples: wp.int32,
    offset: wp.int32,
    sum_out: wp.array[wp.float64],
) -> None:
    """The sum of the signs of samples 0 to samples - 1 of each pixel."""
    i = offset + wp.tid()
    total = wp.float64(0.0)
    for sample in range(samples):
        total += wp.float64(_sign(camera, signs, pixels[i], sample))
    sum_out[i] = total


@wp.kernel
def weigh_samples(
    camera: CameraView,
    signs: wp.array[wp.float32],
    pixel: wp.array[wp.int32],
    sample: wp.array[wp.int32],
    mean_sign: wp.array[wp.float64],
    sharpening: wp.float64,
    offset: wp.int32,
    weight_out: wp.array[wp.float32],
) -> None:
    """The weight of each sample.

    Args:
        mean_sign: of the sample's pixel, one a sample.
        sharpening: c above.
    """
    i = offset + wp.tid()
    sign = wp.float64(_sign(camera, signs, pixel[i], sample[i]))
    weight_out[i] = wp.float32(wp.float64(1.0) + sharpening * (sign - mean_sign[i]))
