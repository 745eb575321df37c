"""How many shadow rays go from what the camera sees, when nobody says.

Where lights are worth more than one, the integrator says how many are worth their time (Algorithm.shadow_rays).
"""

from __future__ import annotations

from wdpm.cluster.render_settings import RenderSettings
from wdpm.scenes.flat.flatten import FlatScene


def light_samples_of(flat: FlatScene, settings: RenderSettings) -> int:
    """Shadow rays of a camera sample: those asked for, or as many as are worth their time."""
    if settings.light_samples is not None:
        return settings.light_samples
    return settings.algorithm.shadow_rays if worth_several_rays(flat) else 1


def worth_several_rays(flat: FlatScene) -> bool:
    """Whether shadow rays of one place may differ: to lights that have an extent, or to several."""
    lights = flat.lights
    extended = len(lights.prim) > 0 or lights.environment_pixels.size > 0
    return bool(extended or len(lights.power) > 1)
