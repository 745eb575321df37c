"""Which settings a render gets: what a person chose, else what the scene's file asks for, else the defaults."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from wdpm.cluster.render_settings import RenderSettings
from wdpm.scenes.errors import SettingsError, did_you_mean
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene


def settings_given(scene: Scene, settings: RenderSettings | None, chosen: Mapping[str, Any]) -> RenderSettings:
    """All settings as somebody gives them, or those of a scene with single ones by name.

    Raises:
        SettingsError: they are no settings, both are given, or as of settings_for.
    """
    if settings is None:
        return settings_for(scene, **chosen)
    if not isinstance(settings, RenderSettings):
        raise SettingsError(
            f"settings is {settings!r}; expected wdpm.RenderSettings(spp=16), or single settings by name: spp=16"
        )
    for name in chosen:
        raise SettingsError(f"{name} is given beside settings, which say all; use dataclasses.replace(settings, ...)")
    return settings


def settings_for(scene: Scene, **chosen: Any) -> RenderSettings:
    """Settings by name of the field of RenderSettings.

    Raises:
        SettingsError: a value is out of range, or there is no setting of a name.
    """
    known = [field.name for field in fields(RenderSettings)]
    for name in [name for name in chosen if name not in known]:
        if name in _OF_LOADING:
            raise SettingsError(f"{name} is no setting of a render but of its scene: give it to wdpm.load")
        raise SettingsError(f"there is no setting '{name}'{did_you_mean(name, known)}; see wdpm.RenderSettings")
    from_scene = {"spp": scene.samples, "max_depth": scene.max_depth}
    return RenderSettings(**{name: value for name, value in from_scene.items() if value is not None} | chosen)


_OF_LOADING = tuple(inspect.signature(load).parameters)[1:]
"""What people look for among the settings."""
