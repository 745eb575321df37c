"""Optical lengths along a beam through a medium with a grid, for photons anywhere along it.

A beam passes hundreds of photons, and each asks how much the medium takes between it and the beam's origin. So the
length is computed once at marks along the beam, and from the mark before a photon on for each. Both are functions of
the beam alone: whatever cell counts a photon, it counts the same.
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.materials.grid_walks import LatticeRay, lattice_ray, passed_up_to
from wdpm.kernels.materials.grids import Grids

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MARKS = wp.constant(64)
"""Stretches between marks: of a grid of 256 voxels a side, a handful of voxels each."""

_STRETCHES = wp.constant(wp.float64(64.0))
"""MARKS as a double."""
_ZERO = wp.constant(wp.float64(0.0))


@wp.func
def _last(ray: LatticeRay, length: wp.float32) -> wp.float64:
    """Where the beam leaves the grid, or ends in it."""
    return wp.min(ray.leave, wp.float64(length))


@wp.func
def mark_beam(
    grids: wp.ref[Grids],
    grid: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    length: wp.float32,
    marks: wp.array[wp.float64],
) -> None:
    """Write the optical lengths up to the marks of a beam, MARKS + 1 of them.

    Args:
        direction: unit.
        length: of the beam; may be infinite.
    """
    ray = lattice_ray(grids, grid, origin, direction)
    step = (_last(ray, length) - ray.enter) / _STRETCHES
    passed = wp.float64(0.0)
    marks[0] = passed
    mark = wp.int32(0)
    while mark < MARKS:
        start = ray.enter + wp.float64(mark) * step
        passed += passed_up_to(grids, ray, start, ray.enter + wp.float64(mark + 1) * step)
        mark += 1
        marks[mark] = passed


@wp.func
def length_at(
    grids: wp.ref[Grids],
    grid: wp.int32,
    origin: wp.vec3,
    direction: wp.vec3,
    length: wp.float32,
    marks: wp.array[wp.float64],
    t: wp.float64,
) -> wp.float64:
    """Optical length of a beam up to a distance on it."""
    ray = lattice_ray(grids, grid, origin, direction)
    last = _last(ray, length)
    end = wp.min(t, last)
    if end <= ray.enter:
        return _ZERO
    step = (last - ray.enter) / _STRETCHES
    mark = wp.clamp(wp.int32((end - ray.enter) / step), 0, MARKS - 1)
    return marks[mark] + passed_up_to(grids, ray, ray.enter + wp.float64(mark) * step, end)
