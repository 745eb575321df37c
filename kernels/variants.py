"""The kernels that a set of features picks. Each depends on the features that it can tell apart, and on no others."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cache

import warp as wp

from wdpm.kernels.camera.gather_glossy import make_gather
from wdpm.kernels.camera.misses import make_path_misses
from wdpm.kernels.camera.rays import make_camera_rays, make_visit_paths
from wdpm.kernels.camera.shading import make_shading
from wdpm.kernels.camera.shadow_rays import make_pass_surfaces, make_visit_shadow_segments, make_visit_walks
from wdpm.kernels.features import Features, Group
from wdpm.kernels.irradiance.lit_places import make_light_places
from wdpm.kernels.photons.beam import make_add_beams
from wdpm.kernels.photons.emit_photons import make_emit_photons
from wdpm.kernels.photons.paths import make_trace_photons
from wdpm.kernels.photons.walls import make_feel_for_walls
from wdpm.kernels.whole_samples.trace import make_trace_samples


@dataclass(frozen=True, eq=False)
class Variants:
    """Kernels for one set of features. Those that only some effects need are None without them.

    Attributes:
        shade_camera_hits: for paths that end at their first surface; None where some never do.
        shade_vertices: for all others; None where there are none.
        trace_samples: does the work of others in one launch, on the CPU, as far as a cell reaches; or None.
    """

    first_camera_cells: wp.Kernel
    mark_touched_cells: wp.Kernel
    visit_camera_rays: wp.Kernel
    start_paths: wp.Kernel
    visit_paths: wp.Kernel
    visit_shadow_segments: wp.Kernel
    emit_photons: wp.Kernel
    trace_photons: wp.Kernel
    shade_camera_hits: wp.Kernel | None
    shade_vertices: wp.Kernel | None
    path_misses: wp.Kernel | None
    visit_walks: wp.Kernel | None
    pass_surfaces: wp.Kernel | None
    add_beams: wp.Kernel | None
    gather_glossy: wp.Kernel | None
    feel_for_walls: wp.Kernel | None
    light_places: wp.Kernel | None
    trace_samples: wp.Kernel | None

    def kernels(self) -> dict[str, wp.Kernel]:
        """Those that there are, by name."""
        every = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: kernel for name, kernel in every.items() if kernel is not None}

    def modules(self) -> list[wp.Module]:
        """The modules that hold them, each once."""
        return list({id(kernel.module): kernel.module for kernel in self.kernels().values()}.values())


CAN_DO_WITHOUT = frozenset({"trace_samples"})
"""Kernels of the CPU that others do the work of, where they are not there."""


@cache
def make_variants(features: Features) -> Variants:
    """The kernels for a set of features; nothing is compiled yet."""
    rays = make_camera_rays(features.only(Group.CAMERAS, Group.GEOMETRY))
    geometry = features.only(Group.GEOMETRY)
    shading = make_shading(features)
    ending = replace(features, traced=False)  # where the irradiance cache serves, paths end at diffuse surfaces
    at_surfaces = features.only(Group.MATERIALS, Group.TEXTURES, Group.MEDIA, Group.GEOMETRY)
    return Variants(
        first_camera_cells=rays.first_camera_cells,
        mark_touched_cells=rays.mark_touched_cells,
        visit_camera_rays=rays.visit_camera_rays,
        start_paths=rays.start_paths,
        shade_camera_hits=None if ending.goes_on else make_shading(ending).shade_camera_hits,
        visit_paths=make_visit_paths(geometry),
        visit_shadow_segments=make_visit_shadow_segments(geometry),
        emit_photons=make_emit_photons(features.only(Group.LIGHTS, Group.TEXTURES, Group.MEDIA)),
        trace_photons=make_trace_photons(at_surfaces),
        shade_vertices=shading.shade_vertices if features.goes_on else None,
        path_misses=make_path_misses(features) if features.misses else None,
        visit_walks=make_visit_walks(features.only(Group.MEDIA, Group.GEOMETRY)) if features.walks else None,
        pass_surfaces=make_pass_surfaces(at_surfaces) if features.walks else None,
        add_beams=make_add_beams(features.only(Group.MEDIA)) if features.media else None,
        gather_glossy=make_gather(features.only(Group.MATERIALS)) if features.goes_on or features.coated else None,
        feel_for_walls=make_feel_for_walls(geometry) if features.traced else None,
        light_places=make_light_places(at_surfaces) if features.translucent and features.traced else None,
        trace_samples=None if features.media else make_trace_samples(features),
    )


def without_shortcuts(variants: Variants) -> Variants:
    """The same without kernels that others do the work of: what other devices than the CPU have."""
    return replace(variants, **dict.fromkeys(CAN_DO_WITHOUT))
