"""What a sample comes to, vertex by vertex, and its pixel, sample by sample."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.add_samples import Sums
from wdpm.kernels.camera.paths import Vertex
from wdpm.kernels.camera.vertices import Orders
from wdpm.kernels.columns import FromFields, item_of, loader, storer
from wdpm.kernels.ray_fields import PIXEL
from wdpm.kernels.whole_samples.indirect_light import PIXELS_DONE, SEEN, TOLD, Notes, count
from wdpm.kernels.whole_samples.leaving import FirstVertices, Found, PixelSums, Within

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Sample:
    """What one sample comes to.

    Attributes:
        depth: negative where a camera ray met nothing.
        reach: how far the first ray went [scene units]; inf if it met nothing.
    """

    direct: wp.vec3d
    indirect: wp.vec3d
    caustic: wp.vec3d
    normal: wp.vec3
    albedo: wp.vec3
    depth: wp.float32
    reach: wp.float32


@item_of(PIXEL)
class Pixel(FromFields):
    """Samples of one pixel, added up."""


load_pixel = loader(Sums, Pixel)
store_pixel = storer(Sums, Pixel)
_store_sums = storer(PixelSums, Pixel)


@wp.func
def with_vertex(sample: Sample, p: Vertex, found: Found, lit: wp.vec3d, weight: wp.float32, orders: Orders) -> Sample:
    """A sample with what one more vertex of its path shows.

    Args:
        lit: light of all of the vertex's shadow rays, weighted.
        orders: of first vertices.
    """
    emission = wp.vec3d(found.emission * weight)
    caustic = wp.vec3d(found.caustic * weight)
    if p.bounce == 0:
        sample.direct = emission + lit * (wp.float64(1.0) / wp.float64(orders.light_samples))
    else:
        if p.diffuse > 0:
            sample.indirect += lit
        else:
            sample.direct += lit
        if p.diffuse > 1:
            sample.indirect += emission
        else:
            sample.direct += emission
    sample.indirect += wp.vec3d(found.indirect * weight)
    if p.diffuse > 0:
        sample.indirect += caustic
    else:
        sample.caustic += caustic
    return sample


@wp.func
def with_sample(pixel: Pixel, found: Sample) -> Pixel:
    """A pixel with one more sample."""
    if found.depth >= 0.0:
        pixel.hits += 1
        pixel.depth += wp.float64(found.depth)
        pixel.normal += wp.vec3d(found.normal)
        pixel.albedo += wp.vec3d(found.albedo)
    pixel.direct += found.direct
    pixel.indirect += found.indirect
    pixel.caustic += found.caustic
    return pixel


@wp.func
def tell_of_first(
    slot: wp.int32, found: Sample, within: Within, first_out: wp.ref[FirstVertices], notes: wp.ref[Notes]
) -> None:
    """Bring home what a camera ray meets first, if it is here that this is known."""
    if found.depth >= 0.0:
        n = notes.counts[SEEN]
        first_out.slot[n] = slot
        first_out.depth[n] = found.depth
        first_out.normal[n] = found.normal
        first_out.albedo[n] = found.albedo
        first_out.whose[n] = within.whose
        count(notes, SEEN, 1)


@wp.func
def tell_of_pixel(
    pixel: Pixel,
    told: wp.int32,
    seen: wp.int32,
    within: Within,
    pixels_out: wp.ref[PixelSums],
    notes: wp.ref[Notes],
) -> None:
    """Bring home samples of which nothing has left the cell, in place of what was told of them.

    Args:
        told, seen: how many parts and first vertices there were before them.
    """
    notes.counts[TOLD] = told
    notes.counts[SEEN] = seen
    n = notes.counts[PIXELS_DONE]
    _store_sums(pixel, n, pixels_out)
    pixels_out.whose[n] = within.whose
    count(notes, PIXELS_DONE, 1)
