"""Which cell a hit belongs to: the one that contains its point."""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.cells import Cells, cell_of
from wdpm.kernels.rays.instanced_triangles import make_triangles
from wdpm.kernels.rays.triangle import Hit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@functools.cache
def make_owner_of(instances: bool) -> wp.Function:
    """`owner_of(cells, surfaces, hit) -> int32`, in scenes with or without instances."""
    triangles = make_triangles(instances)
    row_of, position_at = triangles.row_of, triangles.position_at

    @wp.func
    def owner_of(cells: wp.ref[Cells], surfaces: wp.ref[Surfaces], hit: Hit) -> wp.int32:
        """The cell that contains the point of a hit with a triangle of `surfaces`."""
        owner = wp.int32(0)
        if cells.count > 1:  # else the triangle, which no cache has yet, need not be fetched for it
            row = row_of(surfaces, hit.prim)
            owner = cell_of(cells, position_at(surfaces, row, hit.u, hit.v))
        return owner

    return owner_of
