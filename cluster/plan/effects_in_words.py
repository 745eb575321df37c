"""The effects of a render in words: each, whether the scene calls for it, because of what, and what it switches on.

For people who want to know what a scene pays for. Nothing is decided here: that is done in effects.py and
photon_pilot.py.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.plan.effects import used_materials
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.world import World
from wdpm.kernels.features import WORDS, Features, Group, names_of
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.light_table import LIGHT_KINDS, LightTable
from wdpm.scenes.flat.material_facts import MaterialFacts
from wdpm.scenes.flat.used_media import used_media
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Texture, VertexColors

CAMERA = "the camera"

NAMES_SHOWN = 3
"""Of what calls for an effect; the others are counted."""

WITHOUT = {
    "indirect": "global photon map",
    "caustics": "caustic photon map",
    "media": "media",
    "lens": "lens",
    "bump": "bent",
}
"""The effect that each name of --without leaves out."""


@dataclass(frozen=True)
class Effect:
    """One effect, for people.

    Attributes:
        name: the field of Features, or what else it is.
        words: the same for people.
        called: whether the scene calls for it.
        on: whether it is on: compiled in, made or traced.
        because: names of what calls for it: materials, lights, media, the camera.
        switches_on: maps, kernels and rays.
        spared: it is off since it would show nothing: the plan says so, not a person.
    """

    name: str
    words: str
    called: bool
    on: bool
    because: tuple[str, ...]
    switches_on: str
    spared: bool = False

    @property
    def left_out(self) -> bool:
        """The scene calls for it, and a person did not want it."""
        return self.called and not self.on and not self.spared

    @property
    def reason(self) -> str:
        """Some names, and how many more."""
        names = ", ".join(self.because[:NAMES_SHOWN])
        more = len(self.because) - NAMES_SHOWN
        return f"{names} and {more:,} more" if more > 0 else names


@dataclass(frozen=True)
class LightUse:
    """One light, and which share of the photons it gets.

    Attributes:
        power: mean of RGB [W].
        by_power: share of all power.
        photons: share of the paths of the global pass: mostly by measured use.
        caustic_photons: share of the paths of the caustic pass; None where there is none.
        why_none: why it gets no photons; empty for a light that gets some.
    """

    name: str
    power: float
    by_power: float
    photons: float
    caustic_photons: float | None
    why_none: str


def effects_of(
    flat: FlatScene, asked: FlatScene, media: Sequence[str], world: World, features: Features, settings: RenderSettings
) -> tuple[Effect, ...]:
    """Every effect of a render.

    Args:
        flat: the scene as it is.
        asked: the scene without what is left out knowingly; the same as `flat` if nothing is.
        media: names of the scene's media.
        world: what was decided for `asked`.
        features: what the kernels are compiled for, the camera's included.
    """
    causes = {**causes_of(flat, media), "traced": settings.algorithm.traced_by(settings)}
    without = {WITHOUT[name] for name in settings.without}  # they may be compiled in all the same
    of_features = [
        Effect(name, words, bool(causes[name]), getattr(features, name) and name not in without, causes[name], switches)
        for name, (words, switches) in WORDS.items()
    ]
    return (*of_features, *_maps(flat, causes, world, settings), *_rays(asked, causes, features, settings))


def causes_of(flat: FlatScene, media: Sequence[str] = ()) -> dict[str, tuple[str, ...]]:
    """What calls for each feature, by the fields of Features, and for "diffuse" and "glossy" materials."""
    found = used_materials(flat)
    lights = flat.lights
    causes = {
        name: _materials(found, name) for name in (*names_of(Group.MATERIALS, Group.TEXTURES), "diffuse", "glossy")
    }
    for kind, name in ((Bitmap, "bitmaps"), (Checkerboard, "checkerboards"), (VertexColors, "vertex_colors")):
        causes[name] += _textured_lights(flat, kind)
    first = len(lights.emitter_radiance)
    last = first + len(lights.delta_kind)
    for light in LIGHT_KINDS.values():
        rows = np.flatnonzero(lights.delta_kind == light.number)
        causes[light.feature] = tuple(lights.names[first + row] for row in rows)
    causes["environment"] = lights.names[last:]
    causes["textured_lights"] = _textured_lights(flat, (Bitmap, Checkerboard, VertexColors))
    used = used_media(flat)
    causes["media"] = _media(used, media)
    causes["grids"] = _media(used[flat.media.heterogeneous[used]], media)
    causes["lens"] = (CAMERA,) if flat.camera.aperture_radius > 0 else ()
    causes["orthographic"] = (CAMERA,) if flat.camera.orthographic else ()
    standing = flat.triangles.instances
    causes["instances"] = (f"{len(standing):,} instances of {len(standing.shapes):,} meshes",) if len(standing) else ()
    causes["traced"] = ()  # never by a scene
    return causes


def _maps(flat: FlatScene, causes: dict[str, tuple[str, ...]], world: World, settings: RenderSettings) -> list[Effect]:
    """The photon maps, and how their photons are sent out."""
    by_photons = settings.algorithm.shoots_photons
    shines = by_photons and bool(flat.lights.power.sum() > 0)
    diffuse, glossy = causes["diffuse"], causes["glossy"]
    indirect, caustics = shines and bool(diffuse), shines and bool(diffuse) and bool(glossy)
    targets = len(world.emission.target_radius)
    aimed = bool(world.caustic_map.paths) and targets > 0
    wanted = settings.algorithm.maps(settings)
    no_caustic = wanted.caustic and not world.caustic_map.paths  # the pilot found none
    number = len(flat.lights.names)
    return [
        Effect(
            "global photon map",
            "light off diffuse surfaces",
            indirect,
            world.global_map.paths > 0 and "indirect" not in settings.without and settings.photons > 0,
            diffuse if indirect else (),
            f"a map of {settings.photons:,} photons, gathers of {settings.k}",
        ),
        Effect(
            "caustic photon map",
            "caustics",
            caustics,
            world.caustic_map.paths > 0,
            glossy if caustics else (),
            f"a map of {settings.caustic_photons:,} photons, gathers of {settings.caustic_k}",
            spared=no_caustic,
        ),
        Effect(
            "aimed photons",
            "aimed photons",
            caustics,
            aimed,
            glossy if caustics else (),
            f"caustic paths aimed at {targets:,} spheres" if aimed else "caustic paths aimed at spheres",
            spared=no_caustic,
        ),
        Effect(
            "volume photon map",
            "light scattered in media",
            shines and bool(causes["media"]),
            world.volume_map.paths > 0,
            causes["media"] if shines else (),
            f"a map of {settings.volume_photons:,} photons, beams along rays",
            spared=wanted.volume and not world.volume_map.paths,
        ),
        Effect(
            "light shares",
            "photons by light",
            by_photons and number > 1,
            by_photons and number > 1,
            flat.lights.names if by_photons and number > 1 else (),
            "shares by measured use",
        ),
    ]


def _rays(
    flat: FlatScene,
    causes: dict[str, tuple[str, ...]],
    features: Features,
    settings: RenderSettings,
) -> list[Effect]:
    """Rays that only some scenes need."""
    elements = len(flat.lights.power)
    going_on = _joined(causes["glossy"], causes["passing"], causes["traced"])
    by_photons = settings.algorithm.shoots_photons
    asking = _joined(causes["plastic"], causes["principled"], causes["bent"], going_on if settings.max_depth else ())
    asking = asking if by_photons else ()
    walking = _joined(causes["passing"], causes["media"])
    missing = _joined(causes["environment"], causes["media"])
    asks = by_photons and (features.coated or (features.goes_on and bool(settings.max_depth)))
    return [
        Effect(
            "light selection",
            "a choice among lights",
            elements > 1,
            elements > 1,
            flat.lights.names if elements > 1 else (),
            f"a search among {elements:,} elements (lights, triangles of lamps)",
        ),
        Effect(
            "camera paths",
            "longer camera paths",
            bool(going_on),
            features.goes_on,
            going_on,
            "a ray that goes on from each vertex",
        ),
        Effect(
            "gathers that ask",
            "gathers by material",
            bool(asking),
            asks,
            asking,
            "the material's value for each photon",
        ),
        Effect(
            "shadow walks",
            "shadow rays that walk",
            bool(walking),
            features.walks,
            walking,
            "transmittance in place of yes or no",
        ),
        Effect(
            "misses",
            "light from beyond",
            bool(missing),
            features.misses,
            missing,
            "a kernel for rays that meet nothing",
        ),
    ]


def uses_of_lights(world: World, dark: Sequence[str] = ()) -> tuple[LightUse, ...]:
    """How photons are shared out among lights.

    Args:
        dark: names of lights that are not in the table, since they do not shine at all.
    """
    lights, emission = world.lights, world.emission
    power = _by_light(lights, lights.power) * world.unit**2
    total = max(float(power.sum()), np.finfo(np.float64).tiny)
    share = _by_light(lights, emission.share)
    caustic = _by_light(lights, emission.caustic_share) if world.caustic_map.paths else None
    uses = [
        LightUse(
            name,
            float(power[i]),
            float(power[i]) / total,
            float(share[i]) if world.global_map.paths else 0.0,
            None if caustic is None else float(caustic[i]),
            "" if power[i] > 0 else "it has no power",
        )
        for i, name in enumerate(lights.names)
    ]
    none = None if caustic is None else 0.0
    return (*uses, *(LightUse(name, 0.0, 0.0, 0.0, none, "it has no power") for name in dark))


def missing_effects(effects: Sequence[Effect], settings: RenderSettings) -> tuple[str, ...]:
    """What an image lacks that its scene calls for, one line each; empty for a whole image."""
    left = {effect.name: effect for effect in effects if effect.left_out}
    return tuple(
        f"left out by --without {name}: {left[effect].words} ({left[effect].reason})"
        for name, effect in WITHOUT.items()
        if name in settings.without and effect in left
    ) + tuple(
        f"left out by --{option} 0: {left[effect].words} ({left[effect].reason})"
        for option, effect, count, name in (
            ("photons", "global photon map", settings.photons, "indirect"),
            ("caustic-photons", "caustic photon map", settings.caustic_photons, "caustics"),
            ("volume-photons", "volume photon map", settings.volume_photons, "media"),
        )
        if count == 0 and name not in settings.without and effect in left
    )


def _by_light(lights: LightTable, weight: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.bincount(lights.light, weight, len(lights.names)).astype(np.float64)


def _materials(found: Sequence[tuple[str, MaterialFacts]], name: str) -> tuple[str, ...]:
    return _joined([material for material, fact in found if fact.calls_for(name)])


def _textured_lights(flat: FlatScene, kind: type[Texture] | tuple[type[Texture], ...]) -> tuple[str, ...]:
    """Names of lights with such a texture."""
    lights = flat.lights
    numbered = enumerate((*lights.emitter_texture, *lights.delta_texture))
    return tuple(
        lights.names[i] for i, texture in numbered if texture >= 0 and isinstance(flat.textures[texture], kind)
    )


def _media(numbers: Iterable[int], names: Sequence[str]) -> tuple[str, ...]:
    """Names of some media."""
    return tuple(names[number] if number < len(names) else f"medium {number}" for number in numbers)


def _joined(*names: Sequence[str]) -> tuple[str, ...]:
    """Each name once, in order."""
    return tuple(dict.fromkeys(name for some in names for name in some))
