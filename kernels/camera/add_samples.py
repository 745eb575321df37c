"""From the slots of a bucket's samples to pixels: sums in sample order, in double."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.columns import FromFields, columns_of
from wdpm.kernels.fields import chosen
from wdpm.kernels.ray_fields import SAMPLE

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@columns_of(chosen(SAMPLE, "emission", "indirect", "depth", "normal", "albedo"))
class Slots(FromFields):
    """What the samples of one wave brought home. A slot that nothing arrived in is zero, its depth negative.

    Attributes:
        direct: direct light at the first surface, by sample and shadow ray, [samples * light_samples].
    """

    direct: wp.array[wp.vec3]


@wp.struct
class Parts:
    """What later vertices of paths, and rays that met no surface, brought home, in the order of their places.

    Attributes:
        begin: number of the first part of each slot, and of all parts at the end, shape [slots + 1].
        layer: which sum each part belongs to: 0 direct, 1 indirect, 2 caustic, 3 volume.
    """

    begin: wp.array[wp.int32]
    layer: wp.array[wp.int32]
    radiance: wp.array[wp.vec3]


@wp.struct
class Sums:
    """Sums over the samples of each pixel so far."""

    direct: wp.array[wp.vec3d]
    indirect: wp.array[wp.vec3d]
    caustic: wp.array[wp.vec3d]
    volume: wp.array[wp.vec3d]
    normal: wp.array[wp.vec3d]
    albedo: wp.array[wp.vec3d]
    depth: wp.array[wp.float64]
    hits: wp.array[wp.int32]


@wp.kernel
def add_samples(
    slots: Slots, parts: Parts, samples: wp.int32, light_samples: wp.int32, offset: wp.int32, sums_out: Sums
) -> None:
    """Add a wave's samples to the pixels' sums, in the order of their numbers.

    Each sample is added up before it is added to its pixel, so that it does not matter where one wave ends and the next
    begins.
    """
    pixel = offset + wp.tid()
    sum_direct = sums_out.direct[pixel]
    sum_indirect = sums_out.indirect[pixel]
    sum_caustic = sums_out.caustic[pixel]
    sum_volume = sums_out.volume[pixel]
    normal = sums_out.normal[pixel]
    albedo = sums_out.albedo[pixel]
    depth = sums_out.depth[pixel]
    hits = sums_out.hits[pixel]
    share = wp.float64(1.0) / wp.float64(light_samples)
    for s in range(samples):
        i = pixel * samples + s
        direct = wp.vec3d()
        indirect = wp.vec3d()
        caustic = wp.vec3d()
        volume = wp.vec3d()
        if slots.depth[i] >= 0.0:
            hits += 1
            depth += wp.float64(slots.depth[i])
            normal += wp.vec3d(slots.normal[i])
            albedo += wp.vec3d(slots.albedo[i])
            indirect = wp.vec3d(slots.indirect[i])
            lit = wp.vec3d()
            for j in range(light_samples):
                lit += wp.vec3d(slots.direct[i * light_samples + j])
            direct = wp.vec3d(slots.emission[i]) + lit * share
        for p in range(parts.begin[i], parts.begin[i + 1]):
            radiance = wp.vec3d(parts.radiance[p])
            layer = parts.layer[p]
            if layer == 0:
                direct += radiance
            elif layer == 1:
                indirect += radiance
            elif layer == 2:
                caustic += radiance
            else:
                volume += radiance
        sum_direct += direct
        sum_indirect += indirect
        sum_caustic += caustic
        sum_volume += volume
    sums_out.direct[pixel] = sum_direct
    sums_out.indirect[pixel] = sum_indirect
    sums_out.caustic[pixel] = sum_caustic
    sums_out.volume[pixel] = sum_volume
    sums_out.normal[pixel] = normal
    sums_out.albedo[pixel] = albedo
    sums_out.depth[pixel] = depth
    sums_out.hits[pixel] = hits
