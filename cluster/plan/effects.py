"""Which effects a scene calls for, and because of what: kernels, maps and rays that nothing needs are left out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.features import ALL, Features
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.material_facts import MaterialFacts, facts
from wdpm.scenes.model.textures import Bitmap, Checkerboard, VertexColors

if TYPE_CHECKING:
    from wdpm.cluster.settings import RenderSettings

_FROM_MATERIALS = (
    "conductor",
    "dielectric",
    "thin_dielectric",
    "plastic",
    "principled",
    "rough",
    "blend",
    "passing",
    "bent",
)


def used_materials(flat: FlatScene) -> list[tuple[str, MaterialFacts]]:
    """Names and facts of the materials that triangles have."""
    used = np.unique(flat.triangles.material)
    every = facts(flat.materials, flat.textures)
    return [(flat.material_names[row], every[row]) for row in used]


def features_of(flat: FlatScene, settings: RenderSettings) -> Features:
    """What kernels are compiled for."""
    if settings.all_effects:
        return ALL
    lights, found = flat.lights, [fact for _, fact in used_materials(flat)]
    glow = [flat.textures[number] for number in (*lights.emitter_texture, *lights.spot_texture) if number >= 0]
    return Features(
        **{name: any(getattr(fact, name) for fact in found) for name in _FROM_MATERIALS},
        bitmaps=any(fact.bitmaps for fact in found) or any(isinstance(texture, Bitmap) for texture in glow),
        checkerboards=any(fact.checkerboards for fact in found) or any(isinstance(t, Checkerboard) for t in glow),
        vertex_colors=any(fact.vertex_colors for fact in found) or any(isinstance(t, VertexColors) for t in glow),
        points=len(lights.point_position) > 0,
        spots=len(lights.spot_position) > 0,
        directionals=len(lights.directional_direction) > 0,
        environment=lights.environment_pixels.size > 0,
        textured_lights=len(glow) > 0,
        media=calls_for_media(flat),
        traced=settings.algorithm.diffuse_light(settings) is not DiffuseLight.PHOTON_MAP,
    )


def calls_for_media(flat: FlatScene) -> bool:
    """Whether some light may travel in a medium."""
    bounded = flat.materials.medium[np.unique(flat.triangles.material)]
    around = [flat.camera.medium is not None, bool((flat.lights.medium >= 0).any())]
    return bool((bounded >= 0).any()) or any(around)


def calls_for_caustics(flat: FlatScene, features: Features, settings: RenderSettings) -> bool:
    """Whether light may reach a diffuse surface by way of glossy ones alone."""
    if not settings.algorithm.maps(settings).caustic or not features.glossy:
        return False
    found = [fact for _, fact in used_materials(flat)]
    return any(fact.glossy for fact in found) and any(fact.diffuse for fact in found)
