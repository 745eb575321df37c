"""Gather rays of irradiance records, as camera paths that have left a surface by its diffuse part."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.rays import Paths
from wdpm.kernels.materials.surface import leave
from wdpm.kernels.rays.triangle import NO_HIT

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Sites:
    """Places where records are made, seen by camera rays.

    Attributes:
        position: of each.
        normal: unit geometric normal on the seen side.
        pixel: that saw it, counted row by row.
    """

    position: wp.array[wp.vec3]
    normal: wp.array[wp.vec3]
    pixel: wp.array[wp.int32]


@wp.kernel
def start_record_rays(
    sites: Sites,
    direction: wp.array[wp.vec3],
    distance: wp.array[wp.float32],
    rays: wp.int32,
    first_sample: wp.int32,
    medium: wp.int32,
    offset_min: wp.float32,
    offset: wp.int32,
    paths_out: Paths,
) -> None:
    """Start the rays of all records, one an item: ray j of record i is item i * rays + j, which is its slot too.

    Args:
        direction, distance: records.record_directions; a ray that is not shot carries nothing.
        rays: of each record.
        first_sample: sample number of each record's first ray.
        medium: that all sites are seen through, -1 for none.
    """
    i = offset + wp.tid()
    record = i // rays
    throughput = wp.vec3(0.0)
    if distance[i] >= 0.0:
        throughput = wp.vec3(1.0)
    paths_out.slot[i] = i
    paths_out.pixel[i] = sites.pixel[record]
    paths_out.sample[i] = first_sample + i - record * rays
    paths_out.bounce[i] = 1
    paths_out.edges[i] = 2
    paths_out.diffuse[i] = 1
    paths_out.medium[i] = medium
    paths_out.origin[i] = leave(sites.position[record], sites.normal[record], offset_min)
    paths_out.direction[i] = direction[i]
    paths_out.anchor[i] = sites.position[record]
    paths_out.throughput[i] = throughput
    paths_out.pdf[i] = 0.0
    paths_out.t[i] = NO_HIT
    paths_out.prim[i] = -1
    paths_out.u[i] = 0.0
    paths_out.v[i] = 0.0
    paths_out.owner[i] = -1
