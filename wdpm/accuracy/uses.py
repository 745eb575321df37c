"""Which knobs change nothing in a render, and why: to turn one would be to render the same image again and again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from wdpm.accuracy.knobs import KNOBS, MAPS, Sweep, photons_of
from wdpm.cluster.plan.effects import calls_for_caustics, features_of
from wdpm.cluster.plan.light_samples import worth_several_rays
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.world import World
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.used_media import calls_for_media

_NAMES = tuple(knob.name for knob in KNOBS)
_OF_MAP = {kind: tuple(knob.name for knob in KNOBS if knob.map == kind) for kind in MAPS}
_OF_ALL_MAPS = ("passes", "band")
_OF_ANY_RENDER = ("spp", "slaves")

_LEFT_OUT_BY = {"global": "indirect", "caustic": "caustics", "volume": "media"}
"""What --without calls the light of each map."""

ONE_SMALL_LIGHT = "the only light has no extent, so that all shadow rays of a place are the same"


def refuse_idle(sweeps: Sequence[Sweep], idle: Mapping[str, str]) -> None:
    """Raise SettingsError for a sweep of a knob that changes nothing.

    Args:
        idle: reasons by name of the knob.
    """
    for sweep in sweeps:
        if sweep.knob.name in idle:
            raise SettingsError(
                f"{sweep.words}: {sweep.knob.option} changes nothing in this render: {idle[sweep.knob.name]}; leave "
                "this sweep out"
            )


def idle_by_settings(settings: RenderSettings) -> dict[str, str]:
    """What the settings of the base tell, whatever the scene.

    Returns:
        reasons, by name of the knob.
    """
    if settings.max_depth == 1:
        return _but_any_render("with --max-depth 1 nothing but lamps is seen")
    algorithm = settings.algorithm
    if not algorithm.shoots_photons:
        unread = [name for name in _NAMES if name in algorithm.ignored]
        # Passes differ by their photons alone.
        return dict.fromkeys((*unread, "passes"), f"--integrator {algorithm.name} {algorithm.why_ignored}")
    idle: dict[str, str] = {}
    for kind in MAPS:
        count, effect = photons_of(kind), _LEFT_OUT_BY[kind]
        if effect in settings.without:
            idle |= dict.fromkeys(_OF_MAP[kind], f"--without {effect} leaves it out")
        elif getattr(settings, count) == 0:
            none = f"the base has --{count.replace('_', '-')} 0"
            idle |= {name: none for name in _OF_MAP[kind] if name != count}
    if settings.max_depth == 2:
        idle |= dict.fromkeys(_OF_MAP["caustic"], "with --max-depth 2 there is no light of caustics")
    if settings.spp == 1:
        idle.setdefault("volume_samples", "the base has 1 sample a pixel, which always looks for light in media")
    return idle


def idle_knobs(flat: FlatScene, world: World, settings: RenderSettings) -> dict[str, str]:
    """What settings and scene tell together.

    Args:
        flat: the scene without what the settings leave out.
        world: what was planned for it.
        settings: of the base.

    Returns:
        reasons, by name of the knob.
    """
    if not flat.lights.power.sum() > 0:
        return _but_any_render("nothing in the scene shines")
    idle = {} if worth_several_rays(flat) else {"light_samples": ONE_SMALL_LIGHT}
    if settings.algorithm.shoots_photons:
        idle |= _idle_by_maps(flat, world, settings)
    return idle | idle_by_settings(settings)


def _idle_by_maps(flat: FlatScene, world: World, settings: RenderSettings) -> dict[str, str]:
    idle: dict[str, str] = {}
    why = {}
    if not _has_caustics(flat, settings):
        why["caustic"] = "the scene has no caustics, which take glossy surfaces and diffuse ones"
    if not calls_for_media(flat):
        why["volume"] = "the scene has no media"
    for kind, plan in zip(MAPS, world.maps, strict=True):
        reason = why.get(kind)
        if reason is None and getattr(settings, photons_of(kind)) > 0 and not plan.paths:
            reason = "no photon path of the pilot stored a photon"
        if reason is not None:
            idle |= dict.fromkeys(_OF_MAP[kind], reason)
    if not any(plan.paths for plan in world.maps):
        idle |= dict.fromkeys(_OF_ALL_MAPS, "there are no photons")
    return idle


def _has_caustics(flat: FlatScene, settings: RenderSettings) -> bool:
    """Whether the scene calls for the caustic map, had it photons."""
    wanted = replace(settings, caustic_photons=max(settings.caustic_photons, 1))
    return calls_for_caustics(flat, features_of(flat, wanted), wanted)


def _but_any_render(reason: str) -> dict[str, str]:
    """For all knobs but those that any render has a use for."""
    return {name: reason for name in _NAMES if name not in _OF_ANY_RENDER}
