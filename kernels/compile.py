"""Compiling kernels before anything needs them: a person can be told, and threads and slaves find them ready."""

from __future__ import annotations

import os

import warp as wp

from wdpm.kernels.camera import add_samples, filter_weights, guide_pilot, rays, shadow_rays
from wdpm.kernels.features import Features
from wdpm.kernels.irradiance import at_photons, cache, gather_places, record_clamp, record_rays, records
from wdpm.kernels.photons import departure, gather, gather_at_photons, photon_map, surface_points
from wdpm.kernels.rays import bvh, bvh_build, overlap, standing_areas
from wdpm.kernels.variants import make_variants

COMMON = (
    bvh,
    bvh_build,
    rays,
    gather,
    gather_at_photons,
    gather_places,
    cache,
    at_photons,
    records,
    overlap,
    photon_map,
    departure,
    record_clamp,
    record_rays,
    add_samples,
    filter_weights,
    shadow_rays,
    surface_points,
)
"""Every file with kernels that do not depend on a scene's effects."""

WITH_CHOICE = (guide_pilot,)
"""For scenes with an environment, or with lights to be chosen among."""

WITH_INSTANCES = (standing_areas,)
"""For scenes in which shapes stand in several places."""

MODULES = (*COMMON, *WITH_CHOICE, *WITH_INSTANCES)


def compile_kernels(device: str, features: Features | None = None) -> None:
    """Compile kernels for a device, or load them from Warp's cache. Seconds the first time ever.

    Args:
        features: the effects of the scene that is to be rendered; None where none is.
    """
    called = features or Features()
    some = ((called.environment, WITH_CHOICE), (called.instances, WITH_INSTANCES))
    names = {module.__name__ for on, group in ((True, COMMON), *some) if on for module in group}
    modules = [wp.get_module(name) for name in sorted(names)]
    if features is not None:
        modules += make_variants(features).modules()
    for place in {device, "cpu"}:  # trees are built on the CPU wherever they are used
        wp.force_load(place, modules, max_workers=os.cpu_count())
