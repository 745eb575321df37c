"""Gather rays of irradiance records, as camera paths that have left a surface by its diffuse part."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.paths import Paths, Vertex, store_path, without_hit
from wdpm.kernels.columns import FromFields, columns_of
from wdpm.kernels.fields import chosen
from wdpm.kernels.materials.surface import leave
from wdpm.kernels.ray_fields import RAY, SITE

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@columns_of({**chosen(SITE, "position", "normal"), **chosen(RAY, "pixel")})
class Sites(FromFields):
    """Places where records are made, and the pixels that saw them."""


@wp.kernel
def start_record_rays(
    sites: Sites,
    direction: wp.array[wp.vec3],
    distance: wp.array[wp.float32],
    record: wp.array[wp.int32],
    ray: wp.array[wp.int32],
    first_sample: wp.int32,
    medium: wp.int32,
    offset_min: wp.float32,
    offset: wp.int32,
    paths_out: Paths,
) -> None:
    """Start rays of records, one an item, which is its slot too.

    Args:
        direction, distance: records.record_directions; a ray that is not shot carries nothing.
        record: that each ray is of.
        ray: its number among those of its record.
        first_sample: sample number of each record's first ray.
        medium: that all sites are seen through, -1 for none.
    """
    i = offset + wp.tid()
    site = record[i]
    p = Vertex()
    p.slot = i
    p.pixel = sites.pixel[site]
    p.sample = first_sample + ray[i]
    p.bounce = 1
    p.edges = 2
    p.diffuse = 1
    p.medium = medium
    p.origin = leave(sites.position[site], sites.normal[site], offset_min)
    p.direction = direction[i]
    p.anchor = sites.position[site]
    if distance[i] >= 0.0:
        p.throughput = wp.vec3(1.0)
    store_path(without_hit(p), i, paths_out)
