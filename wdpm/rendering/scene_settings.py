"""Which settings a render gets: what a person chose, else what the scene's file asks for, else the defaults."""

from __future__ import annotations

from typing import Any

from wdpm.cluster.render_settings import RenderSettings
from wdpm.scenes.model.scene import Scene


def settings_for(scene: Scene, **chosen: Any) -> RenderSettings:
    """Settings by name of the field of RenderSettings. Raises SettingsError for a value out of range."""
    from_scene = {"spp": scene.samples, "max_depth": scene.max_depth}
    return RenderSettings(**{name: value for name, value in from_scene.items() if value is not None} | chosen)
