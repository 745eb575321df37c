"""From samples to all pixels that the filter reaches: weighted sums in fixed orders, in double.

A sample lies anywhere in its own pixel and counts in every pixel whose filter reaches it, so each pixel is the weighted
mean of the samples around it, as in Mitsuba and pbrt. For a tent that leaves 0.44 of the variance of samples that count
in one pixel alone, for a gaussian 0.32.

Sums must not depend on where a bucket, a wave or a thread ends. So each pixel's samples are first added up once for
every pixel that they reach, in the order of their numbers (splat_samples); then each pixel adds up what those around it
hold for it, row by row (gather_splats). Pixels count alike, however many samples each has taken.
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.add_samples import Sums
from wdpm.kernels.camera.camera import CameraView, film_numbers

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Splats:
    """What the samples of some pixels so far add up to, once for each pixel that they reach.

    Attributes:
        direct to albedo: weighted sums, shape [pixels * (2 reach + 1)²], the pixels reached row by row.
        weight: of all samples.
        caustic_weight, volume_weight: of those that look for that light, times how many each stands for.
        depth, hits: sums over the pixel's own samples, not weighted, shape [pixels].
    """

    direct: wp.array[wp.vec3d]
    indirect: wp.array[wp.vec3d]
    caustic: wp.array[wp.vec3d]
    volume: wp.array[wp.vec3d]
    normal: wp.array[wp.vec3d]
    albedo: wp.array[wp.vec3d]
    weight: wp.array[wp.float64]
    caustic_weight: wp.array[wp.float64]
    volume_weight: wp.array[wp.float64]
    depth: wp.array[wp.float64]
    hits: wp.array[wp.int32]


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
class Window:
    """The pixels of a bucket among all whose samples reach one of them; both are rectangles.

    Attributes:
        left, top: of the bucket in the whole [pixels].
        width: of the bucket.
        whole_width, whole_height: of all.
    """

    left: wp.int32
    top: wp.int32
    width: wp.int32
    whole_width: wp.int32
    whole_height: wp.int32


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
def weigh_samples(
    camera: CameraView, splatted: Splatted, table: FilterTable, offset: wp.int32, weight_out: wp.array[wp.vec2]
) -> None:
    """What each sample weighs along x and y in the pixels around its own, shape [samples * (2 reach + 1)].

    It lies where camera_ray has it with a box of one pixel.
    """
    i = offset + wp.tid()
    place = film_numbers(camera, splatted.pixel[i], splatted.sample[i]) - wp.vec2(0.5, 0.5)
    side = 2 * table.reach + 1
    for step in range(side):
        beside = float(step - table.reach)
        x, y = _filter_at(table, place[0] - beside), _filter_at(table, place[1] - beside)
        weight_out[i * side + step] = wp.vec2(x, y)


@wp.kernel
def splat_samples(
    sums: Sums,
    splatted: Splatted,
    along: wp.array[wp.vec2],
    samples: wp.int32,
    reach: wp.int32,
    offset: wp.int32,
    splats_out: Splats,
) -> None:
    """Add samples to what their pixels hold for the pixels around them, in the order of their numbers.

    Args:
        sums: of each sample by itself.
        along: of weigh_samples.
        samples: of each pixel.
    """
    pixel = offset + wp.tid()
    side = 2 * reach + 1
    for j in range(side * side):
        right = j % side
        below = j // side
        k = pixel * side * side + j
        direct = splats_out.direct[k]
        indirect = splats_out.indirect[k]
        caustic = splats_out.caustic[k]
        volume = splats_out.volume[k]
        normal = splats_out.normal[k]
        albedo = splats_out.albedo[k]
        total = splats_out.weight[k]
        caustic_total = splats_out.caustic_weight[k]
        volume_total = splats_out.volume_weight[k]
        for s in range(samples):
            i = pixel * samples + s
            weight = wp.float64(along[i * side + right][0] * along[i * side + below][1])
            if weight != wp.float64(0.0):
                direct += weight * sums.direct[i]
                indirect += weight * sums.indirect[i]
                caustic += weight * sums.caustic[i]
                volume += weight * sums.volume[i]
                normal += weight * sums.normal[i]
                albedo += weight * sums.albedo[i]
                total += weight
                caustic_total += weight * wp.float64(splatted.caustic_for[i])
                volume_total += weight * wp.float64(splatted.volume_for[i])
        splats_out.direct[k] = direct
        splats_out.indirect[k] = indirect
        splats_out.caustic[k] = caustic
        splats_out.volume[k] = volume
        splats_out.normal[k] = normal
        splats_out.albedo[k] = albedo
        splats_out.weight[k] = total
        splats_out.caustic_weight[k] = caustic_total
        splats_out.volume_weight[k] = volume_total
    depth = splats_out.depth[pixel]
    hits = splats_out.hits[pixel]
    for s in range(samples):
        depth += sums.depth[pixel * samples + s]
        hits += sums.hits[pixel * samples + s]
    splats_out.depth[pixel] = depth
    splats_out.hits[pixel] = hits


@wp.func
def _over(sum: wp.vec3d, weight: wp.float64) -> wp.vec3d:
    """The mean; black where nothing weighs."""
    if weight == wp.float64(0.0):
        return wp.vec3d()
    return sum / weight


@wp.kernel
def gather_splats(
    splats: Splats,
    samples: wp.array[wp.int32],
    reach: wp.int32,
    window: Window,
    offset: wp.int32,
    pixels_out: Sums,
) -> None:
    """The pixels of a bucket, as means: what those around each hold for it, over what that weighs.

    Args:
        splats: of all pixels of the window.
        samples: that each of them has taken.
    """
    i = offset + wp.tid()
    x = window.left + i % window.width
    y = window.top + i // window.width
    side = 2 * reach + 1
    direct = wp.vec3d()
    indirect = wp.vec3d()
    caustic = wp.vec3d()
    volume = wp.vec3d()
    normal = wp.vec3d()
    albedo = wp.vec3d()
    total = wp.float64(0.0)
    caustic_total = wp.float64(0.0)
    volume_total = wp.float64(0.0)
    for row in range(wp.max(y - reach, 0), wp.min(y + reach + 1, window.whole_height)):
        for column in range(wp.max(x - reach, 0), wp.min(x + reach + 1, window.whole_width)):
            source = row * window.whole_width + column
            if samples[source] > 0:
                k = (source * side + (y - row + reach)) * side + (x - column + reach)
                share = wp.float64(1.0) / wp.float64(samples[source])
                direct += share * splats.direct[k]
                indirect += share * splats.indirect[k]
                caustic += share * splats.caustic[k]
                volume += share * splats.volume[k]
                normal += share * splats.normal[k]
                albedo += share * splats.albedo[k]
                total += share * splats.weight[k]
                caustic_total += share * splats.caustic_weight[k]
                volume_total += share * splats.volume_weight[k]
    own = y * window.whole_width + x
    pixels_out.direct[i] = _over(direct, total)
    pixels_out.indirect[i] = _over(indirect, total)
    pixels_out.caustic[i] = _over(caustic, caustic_total)
    pixels_out.volume[i] = _over(volume, volume_total)
    pixels_out.normal[i] = _over(normal, total)
    pixels_out.albedo[i] = _over(albedo, total)
    pixels_out.depth[i] = splats.depth[own]
    pixels_out.hits[i] = splats.hits[own]
