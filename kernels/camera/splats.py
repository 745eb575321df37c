"""From samples to all pixels that the filter reaches: weighted sums in fixed orders, in double.

A sample lies anywhere in its own pixel and counts in every pixel whose filter reaches it, so each pixel is the weighted
mean of the samples around it, as in Mitsuba and pbrt. For a tent that leaves 0.44 of the variance of samples that count
in one pixel alone, for a gaussian 0.32.

Sums must not depend on where a bucket, a wave or a thread ends. So each pixel's samples are first added up once for
every pixel that they reach, in the order of their numbers (splat_samples); what pixels hold for others is then added to
these, one pixel after another (scatter_splats). What is added up is a row of numbers, all weighted alike.
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.add_samples import Sums
from wdpm.kernels.camera.camera import CameraView, film_numbers

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

row8 = wp.types.vector(length=8, dtype=wp.float64)
"""Eight columns, which are added up by one instruction where a processor has it."""

COLORS = ("direct", "indirect", "caustic", "volume", "normal", "albedo")
"""Sums of three columns each, the first of a row."""

WEIGHT = 3 * len(COLORS)
"""Column of the sum of weights. The next two are of those that look for caustics and for light in media, times how many
samples each of them stands for."""

CAUSTIC_WEIGHT, VOLUME_WEIGHT = WEIGHT + 1, WEIGHT + 2

PARTS = 3
"""Of a row, of eight columns each; the last few of all are empty."""

_PARTS = wp.constant(PARTS)


@wp.struct
class Splatted:
    """Samples on their way, pixel by pixel.

    Attributes:
        pixel, sample: their numbers.
        caustic_for, volume_for: how many samples of its pixel each looks for that light for; 0 where it does not.
    """

    pixel: wp.array[wp.int32]
    sample: wp.array[wp.int32]
    caustic_for: wp.array[wp.float32]
    volume_for: wp.array[wp.float32]


@wp.struct
class FilterTable:
    """A pixel filter along one axis.

    Attributes:
        values: at distances from 0 to the radius, evenly spaced.
        radius: beyond which it is 0 [pixels].
        reach: how many pixels to each side have samples within the radius.
    """

    values: wp.array[wp.float32]
    radius: wp.float32
    reach: wp.int32


@wp.struct
class Bucket:
    """The pixels that samples are to count in: a rectangle.

    Attributes:
        x, y: of its first pixel in what is rendered.
        width, height: of it.
        image_width: of what is rendered.
    """

    x: wp.int32
    y: wp.int32
    width: wp.int32
    height: wp.int32
    image_width: wp.int32


@wp.func
def _filter_at(table: wp.ref[FilterTable], x: wp.float32) -> wp.float32:
    """The filter at a distance, linear between the table's entries."""
    distance = wp.abs(x)
    if distance > table.radius:
        return wp.float32(0.0)
    steps = table.values.shape[0] - 1
    at = distance / table.radius * float(steps)
    i = wp.min(int(at), steps - 1)
    f = at - float(i)
    return table.values[i] * (1.0 - f) + table.values[i + 1] * f


@wp.kernel
def rows_of_samples(
    camera: CameraView,
    sums: Sums,
    splatted: Splatted,
    table: FilterTable,
    offset: wp.int32,
    rows_out: wp.array[row8],
    weight_out: wp.array[wp.vec2d],
) -> None:
    """The row of each sample by itself, and what it weighs in the pixels around its own.

    It lies where camera_ray has it with a box of one pixel.

    Args:
        sums: of each sample.
        rows_out: shape [samples * PARTS].
        weight_out: along x and y, shape [samples * (2 reach + 1)].
    """
    i = offset + wp.tid()
    direct, indirect, caustic = sums.direct[i], sums.indirect[i], sums.caustic[i]
    volume, normal, albedo = sums.volume[i], sums.normal[i], sums.albedo[i]
    k = i * _PARTS
    rows_out[k] = row8(direct[0], direct[1], direct[2], indirect[0], indirect[1], indirect[2], caustic[0], caustic[1])
    rows_out[k + 1] = row8(caustic[2], volume[0], volume[1], volume[2], normal[0], normal[1], normal[2], albedo[0])
    one, none = wp.float64(1.0), wp.float64(0.0)
    caustic_for, volume_for = wp.float64(splatted.caustic_for[i]), wp.float64(splatted.volume_for[i])
    rows_out[k + 2] = row8(albedo[1], albedo[2], one, caustic_for, volume_for, none, none, none)
    place = film_numbers(camera, splatted.pixel[i], splatted.sample[i]) - wp.vec2(0.5, 0.5)
    side = 2 * table.reach + 1
    for step in range(side):
        beside = float(step - table.reach)
        x, y = _filter_at(table, place[0] - beside), _filter_at(table, place[1] - beside)
        weight_out[i * side + step] = wp.vec2d(wp.float64(x), wp.float64(y))


@wp.kernel
def splat_samples(
    rows: wp.array[row8],
    weight: wp.array[wp.vec2d],
    samples: wp.int32,
    reach: wp.int32,
    offset: wp.int32,
    splats_out: wp.array[row8],
) -> None:
    """Add samples to what their pixels hold for the pixels around them, in the order of their numbers.

    Args:
        rows, weight: of rows_of_samples.
        samples: of each pixel.
        splats_out: a row for each pixel that is reached, row by row, shape [pixels * (2 reach + 1)² * PARTS].
    """
    pixel = offset + wp.tid()
    side = 2 * reach + 1
    for j in range(side * side):
        right = j % side
        below = j // side
        k = (pixel * side * side + j) * _PARTS
        first = splats_out[k]
        second = splats_out[k + 1]
        third = splats_out[k + 2]
        for s in range(samples):
            i = pixel * samples + s
            along_x = weight[i * side + right][0]
            along_y = weight[i * side + below][1]
            if along_x != wp.float64(0.0) and along_y != wp.float64(0.0):
                first += (along_x * along_y) * rows[i * _PARTS]
                second += (along_x * along_y) * rows[i * _PARTS + 1]
                third += (along_x * along_y) * rows[i * _PARTS + 2]
        splats_out[k] = first
        splats_out[k + 1] = second
        splats_out[k + 2] = third


@wp.kernel
def scatter_splats(
    splats: wp.array[row8],
    pixels: wp.array[wp.int32],
    samples: wp.int32,
    reach: wp.int32,
    bucket: Bucket,
    shares: wp.int32,
    offset: wp.int32,
    pixels_out: wp.array[row8],
) -> None:
    """Add what pixels hold for those around them to these, one pixel after another, as far as they are the bucket's.

    Args:
        splats: of splat_samples.
        pixels: whose.
        samples: that each of them has taken: they count alike, however many these are.
        shares: of the parts of rows, each added up by one thread.
        pixels_out: the row of each pixel of the bucket.
    """
    begin = offset + wp.tid()
    side = 2 * reach + 1
    share = wp.float64(1.0) / wp.float64(samples)
    for n in range(pixels.shape[0]):
        left = pixels[n] % bucket.image_width - bucket.x - reach
        top = pixels[n] // bucket.image_width - bucket.y - reach
        for row in range(wp.max(top, 0), wp.min(top + side, bucket.height)):
            for column in range(wp.max(left, 0), wp.min(left + side, bucket.width)):
                k = (n * side * side + (row - top) * side + column - left) * _PARTS
                target = (row * bucket.width + column) * _PARTS
                for part in range(begin, _PARTS, shares):
                    pixels_out[target + part] = pixels_out[target + part] + share * splats[k + part]
