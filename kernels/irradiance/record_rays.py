"""Gather rays of irradiance records, as camera paths that have left a surface by its diffuse part."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.paths import Paths, Vertex, store_path, without_hit
from wdpm.kernels.columns import FromFields, columns_of
from wdpm.kernels.fields import chosen, integer
from wdpm.kernels.materials.surface import leave
from wdpm.kernels.ray_fields import HIT, PATH, RAY, SITE

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@columns_of({**chosen(SITE, "position", "normal"), **chosen(RAY, "pixel")})
class Sites(FromFields):
    """Places where records are made, and the pixels that saw them."""


@columns_of(
    {
        "record": integer("that it is of"),
        "ray": integer("its number among those of its record"),
        **chosen(PATH, "direction"),
        **chosen(HIT, "t", "prim", "u", "v"),
    }
)
class ArrivedRays(FromFields):
    """Gather rays of records and what they met: what a path there does not have in common with its record's others."""


@wp.func
def record_path(
    sites: wp.ref[Sites],
    site: wp.int32,
    sample: wp.int32,
    direction: wp.vec3,
    medium: wp.int32,
    offset_min: wp.float32,
) -> Vertex:
    """A gather ray as a path that has left its record's surface.

    Args:
        sample: its number.
        medium: that all sites are seen through, -1 for none.
    """
    p = Vertex()
    p.pixel = sites.pixel[site]
    p.sample = sample
    p.bounce = 1
    p.edges = 2
    p.diffuse = 1
    p.medium = medium
    p.origin = leave(sites.position[site], sites.normal[site], offset_min)
    p.left = sites.normal[site]
    p.direction = direction
    p.anchor = sites.position[site]
    p.throughput = wp.vec3(1.0)
    return p


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
        medium: as of record_path.
    """
    i = offset + wp.tid()
    p = record_path(sites, record[i], first_sample + ray[i], direction[i], medium, offset_min)
    p.slot = i
    if distance[i] < 0.0:
        p.throughput = wp.vec3(0.0)
    store_path(without_hit(p), i, paths_out)
