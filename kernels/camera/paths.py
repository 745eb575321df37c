"""Camera paths: what travels from vertex to vertex, and what is known of a path where it arrives."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.camera import CameraView, whole_pixel
from wdpm.kernels.columns import FromFields, columns_of, item_of, loader, storer
from wdpm.kernels.maths.sample_numbers import item_of_sample
from wdpm.kernels.ray_fields import PATH
from wdpm.kernels.rays.triangle import NO_HIT, Hit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@columns_of(PATH)
class Paths(FromFields):
    """Camera paths beyond their first surface, one an item, with their best hits so far."""


@item_of(PATH)
class Vertex(FromFields):
    """A camera path as it arrives at a surface, or (prim < 0) in a medium.

    Attributes:
        item: of the pixel's random numbers.
        row: number of the vertex in its launch, and of what is written of it.
        action: where the diffuse parts of surfaces are told apart (vertices.BY_FINAL_GATHER), what this one does.
    """

    item: wp.uint32
    row: wp.int32
    action: wp.int32


load_path = loader(Paths, Vertex)
store_path = storer(Paths, Vertex)
load_hit = loader(Paths, Hit)
store_hit = storer(Paths, Hit)


@wp.func
def camera_path(camera: wp.ref[CameraView], paths: wp.ref[Paths], i: wp.int32) -> Vertex:
    """Where a camera path arrives."""
    p = load_path(paths, i)
    p.item = item_of_sample(whole_pixel(camera, p.pixel), p.sample)
    p.row = i
    return p


@wp.func
def without_hit(p: Vertex) -> Vertex:
    """A path whose ray has met nothing yet."""
    p.t = NO_HIT
    p.prim = -1
    p.u = 0.0
    p.v = 0.0
    p.owner = -1
    return p
