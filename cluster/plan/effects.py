"""Which effects a scene calls for, and because of what: kernels, maps and rays that nothing needs are left out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.features import ALL, Features
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.light_table import LIGHT_KINDS
from wdpm.scenes.flat.material_facts import MaterialFacts, facts, features_of_texture
from wdpm.scenes.flat.used_media import calls_for_grids, calls_for_media

if TYPE_CHECKING:
    from wdpm.cluster.render_settings import RenderSettings


def used_materials(flat: FlatScene) -> list[tuple[str, MaterialFacts]]:
    """Names and facts of the materials that triangles have."""
    used = flat.triangles.materials
    every = facts(flat.materials, flat.textures)
    return [(flat.material_names[row], every[row]) for row in used]


def features_of(flat: FlatScene, settings: RenderSettings) -> Features:
    """What kernels are compiled for."""
    if settings.all_effects:
        return ALL
    lights, found = flat.lights, [fact for _, fact in used_materials(flat)]
    glow = [flat.textures[number] for number in (*lights.emitter_texture, *lights.delta_texture) if number >= 0]
    called = set[str]().union(*map(features_of_texture, glow), *(fact.features for fact in found))
    called |= {LIGHT_KINDS[number].feature for number in lights.delta_kind.tolist()}
    return Features(
        **dict.fromkeys(called, True),
        environment=lights.environment_pixels.size > 0,
        textured_lights=len(glow) > 0,
        media=calls_for_media(flat),
        grids=calls_for_grids(flat),
        instances=len(flat.triangles.instances) > 0,
        traced=settings.algorithm.diffuse_light(settings) is not DiffuseLight.PHOTON_MAP,
    )


def calls_for_caustics(flat: FlatScene, features: Features, settings: RenderSettings) -> bool:
    """Whether light may reach a diffuse surface by way of glossy ones alone."""
    return settings.algorithm.maps(settings).caustic and has_caustics(flat, features)


def has_caustics(flat: FlatScene, features: Features) -> bool:
    """Whether a scene has what makes a caustic, and what shows one."""
    if not features.glossy:
        return False
    found = [fact for _, fact in used_materials(flat)]
    return any(fact.glossy for fact in found) and any(fact.diffuse for fact in found)
