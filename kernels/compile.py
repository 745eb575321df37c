"""Compiling kernels before anything needs them: a person can be told, and threads and slaves find them ready."""

from __future__ import annotations

import os

import warp as wp

from wdpm.kernels import (
    bvh,
    bvh_build,
    camera_samples,
    gather,
    overlap,
    photon_map,
    photon_paths,
    resolve,
    surface_points,
)

MODULES = (bvh, bvh_build, camera_samples, gather, overlap, photon_map, photon_paths, resolve, surface_points)
"""Every file with kernels of its own; the others hold functions, which are compiled into these."""


def compile_kernels(device: str) -> None:
    """Compile all kernels for a device, or load them from Warp's cache. Seconds the first time ever."""
    names = {module.__name__ for module in MODULES}
    modules = [wp.get_module(name) for name in sorted(names)]
    for place in {device, "cpu"}:  # trees are built on the CPU wherever they are used
        wp.force_load(place, modules, max_workers=os.cpu_count())
