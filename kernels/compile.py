"""Compiling kernels before anything needs them: a person can be told, and threads and slaves find them ready."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace

import warp as wp

from wdpm.kernels.cached import cache_errors_in_words, check_room, is_compiled, is_loaded, load_from_cache
from wdpm.kernels.camera import add_samples, caustic_guide, filter_weights, guide_pilot, rays, shadow_rays, splats
from wdpm.kernels.features import Features
from wdpm.kernels.irradiance import (
    arrivals,
    at_camera_hits,
    at_photons,
    cache,
    gather_places,
    ray_shares,
    record_agreement,
    record_clamp,
    record_rays,
    record_smoothing,
    records,
    unoccluded_light,
)
from wdpm.kernels.lights import pieces
from wdpm.kernels.module_hashes import hashes
from wdpm.kernels.photons import (
    emit_photons,
    gather,
    gather_at_photons,
    in_sight,
    kd_order,
    lobes,
    neighbours,
    photon_map,
    surface_points,
)
from wdpm.kernels.rays import bvh, bvh_build, cell_triangles, instance_areas, overlap
from wdpm.kernels.stand_ins import Chosen, compiled_kernels, own_kernels, stand_ins
from wdpm.kernels.variants import make_variants, without_shortcuts

COMMON = (
    bvh,
    bvh_build,
    cell_triangles,
    rays,
    gather,
    gather_at_photons,
    in_sight,
    neighbours,
    gather_places,
    unoccluded_light,
    cache,
    at_photons,
    arrivals,
    at_camera_hits,
    records,
    ray_shares,
    overlap,
    kd_order,
    photon_map,
    emit_photons,
    record_agreement,
    record_clamp,
    record_rays,
    record_smoothing,
    add_samples,
    filter_weights,
    splats,
    shadow_rays,
    surface_points,
    guide_pilot,
)
"""Every file with kernels that do not depend on a scene's effects."""

WITH_INSTANCES = (instance_areas,)
"""For scenes in which shapes stand in several places."""

WITH_GLOSS = (pieces, lobes, caustic_guide)
"""For scenes with something to aim photons at, and what may make caustics."""

MODULES = (*COMMON, *WITH_INSTANCES, *WITH_GLOSS)


OnCompile = Callable[[int], Callable[[], None]]
"""Called before a wait with how many modules are to be compiled; returns what is called when one of them is."""

SECONDS_A_MODULE = 1.0
"""Of one core, to compile a module: 19 s for the 22 that all scenes share, 11 s for 11 of a diffuse room, whose
twelfth, for whole samples, takes twice as long as the one that shades vertices; with all effects 36 s for 15, whose
largest two take 15 s."""

ALL_AT_ONCE = Features(traced=True)
"""Of a diffuse room, which has its own kernels from the start as well: the first picture of many people."""


def compile_kernels(device: str, features: Features | None = None) -> None:
    """Compile kernels for a device, or load them from Warp's cache. Seconds the first time ever.

    Args:
        features: the effects of the scene that is to be rendered; None where none is.
    """
    modules = _shared_modules(features or Features())
    if features is not None:
        modules += make_variants(features).modules()
    _load(device, modules, None)


def load_compiled() -> None:
    """Load those of the kernels of all scenes, for the CPU, that need no compiler."""
    _load("cpu", [module for module in _shared_modules(Features()) if is_compiled(module)], None)


def ready_kernels(device: str, features: Features, *, wait: bool = True, on_compile: OnCompile | None = None) -> Chosen:
    """The kernels of a scene, ready to be launched.

    Args:
        wait: whether the scene's own are waited for, where a kernel with all effects could stand in (on the CPU).
        on_compile: hears of what has to be compiled first.
    """
    chosen = own_kernels(features) if wait or device != "cpu" else compiled_kernels(features)
    if device != "cpu":
        chosen = replace(chosen, variants=without_shortcuts(chosen.variants))
    _load(device, [*_shared_modules(features), *chosen.variants.modules()], on_compile)
    return chosen


def kernels_for_all_scenes() -> list[wp.Module]:
    """With these compiled no scene has to wait for any, on the CPU."""
    shared = [wp.get_module(module.__name__) for module in MODULES]
    of_features = [*make_variants(ALL_AT_ONCE).modules(), *stand_ins().modules()]
    return list({id(module): module for module in [*shared, *of_features]}.values())


def compile_for_cpu(
    modules: Sequence[wp.Module], on_compile: OnCompile | None = None, threads: int | None = None
) -> int:
    """Compile and load modules for the CPU; returns how many were not compiled.

    Args:
        threads: compilers at a time; None for one a core.
    """
    missing = [module for module in modules if not is_compiled(module)]
    done = on_compile(len(missing)) if on_compile is not None and missing else None
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as compilers:
        for made in as_completed([compilers.submit(_load_one, module) for module in missing]):
            made.result()
            if done is not None:
                done()
    for module in missing:
        hashes().add(module)
    hashes().write()
    return len(missing)


def _load_one(module: wp.Module) -> None:
    with cache_errors_in_words():
        check_room()
        wp.force_load("cpu", [module])


def _shared_modules(features: Features) -> list[wp.Module]:
    """Of the kernels that do not depend on features, those that a scene with these needs."""
    some = ((True, COMMON), (features.instances, WITH_INSTANCES), (features.glossy, WITH_GLOSS))
    return [wp.get_module(name) for name in sorted({each.__name__ for on, group in some if on for each in group})]


def _load(device: str, modules: Sequence[wp.Module], on_compile: OnCompile | None) -> None:
    """Trees are built on the CPU wherever they are used, so all modules are loaded there, too."""
    with cache_errors_in_words():
        load_from_cache([module for module in modules if not is_loaded(module) and is_compiled(module)])
    compile_for_cpu(modules, on_compile)
    if device != "cpu":
        with cache_errors_in_words():
            wp.force_load(device, list(modules), max_workers=os.cpu_count())
