"""What a person chooses in Blender, and the render settings that it stands for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from wdpm.cluster.integrators.registry import Integrator
from wdpm.goal.goal import LEAST_SECONDS, Goal, goal_of

ERROR, TIME, SAMPLES = "ERROR", "TIME", "SAMPLES"
HERE, SLAVES = "HERE", "SLAVES"

_QUALITY = (
    (ERROR, "Error", "Render until the image is as close to the truth as asked for, or its time is up"),
    (TIME, "Time", "Render as well as can be within a time"),
    (SAMPLES, "Samples", "Choose samples and photons yourself"),
)
_WHERE = (
    (HERE, "This computer", "Render in Blender, on the threads that Performance allows"),
    (SLAVES, "Cluster", "Wait for slaves, started with: wdpm slave ADDRESS; they stay for the next render"),
)
_INTEGRATORS = tuple((each.name, each.value.capitalize(), f"Light by {each.value}") for each in Integrator)


class WdpmSettings(bpy.types.PropertyGroup):
    """Settings of a Blender scene, as `scene.wdpm`."""

    # Blender makes properties of annotations.
    __annotations__ = {
        "quality": EnumProperty(name="Render to", items=_QUALITY, default=ERROR),
        "error": FloatProperty(
            name="Error",
            description="Relative mean squared error (relMSE); 0.01 is clean, 0.05 has visible noise",
            default=0.01,
            min=1e-6,
            max=10.0,
            precision=4,
        ),
        "seconds": FloatProperty(
            name="Seconds", description="Time for a frame, once its scene is read", default=60.0, min=1.0, max=1e6
        ),
        "limit": FloatProperty(
            name="At most (s)",
            description="Time after which a frame ends, even if its error is larger; 0 for no limit",
            default=300.0,
            min=0.0,
            max=1e6,
        ),
        "spp": IntProperty(name="Samples", description="Samples a pixel", default=64, min=1, max=1 << 20),
        "photons": IntProperty(name="Photons", description="Of the global map", default=250_000, min=0, max=1 << 30),
        "caustic_photons": IntProperty(
            name="Caustic photons", description="Of the caustic map", default=250_000, min=0, max=1 << 30
        ),
        "passes": IntProperty(
            name="Passes", description="With photons of their own each; their mean is the image", default=1, min=1
        ),
        "integrator": EnumProperty(name="Integrator", items=_INTEGRATORS, default=Integrator.AUTO.name),
        "max_depth": IntProperty(
            name="Path length",
            description="Longest path of light in edges: 1 is emitted, 2 direct light; 0 for no limit",
            default=0,
            min=0,
        ),
        "seed": IntProperty(name="Seed", description="Of all random numbers", default=0, min=0),
        "where": EnumProperty(name="Render on", items=_WHERE, default=HERE),
        "address": StringProperty(
            name="Address",
            description="Where slaves find this render: they are started with `wdpm slave ADDRESS`",
            default="tcp://127.0.0.1:7777",
        ),
        "slaves": IntProperty(name="Slaves", description="How many to wait for", default=1, min=1, max=1000),
        "keys": StringProperty(
            name="Keys",
            description="Folder that `wdpm keys` made; needed where other computers can reach the address",
            subtype="DIR_PATH",
        ),
        "light_layers": BoolProperty(
            name="Kinds of light",
            description="Passes Direct, Indirect and, where there are any, Caustic and Volume",
            default=False,
        ),
    }


def register_settings() -> None:
    """Give Blender's scenes their settings."""
    bpy.utils.register_class(WdpmSettings)
    bpy.types.Scene.wdpm = PointerProperty(type=WdpmSettings)


def unregister_settings() -> None:
    """Take them away again."""
    del bpy.types.Scene.wdpm
    bpy.utils.unregister_class(WdpmSettings)


def goal_from(settings: Any) -> Goal | None:
    """The error or time that is asked for; None where settings are given."""
    if settings.quality == ERROR:
        return goal_of(settings.error, seconds=max(settings.limit, LEAST_SECONDS) if settings.limit else None)
    return goal_of(None, seconds=settings.seconds) if settings.quality == TIME else None


def chosen_from(settings: Any) -> dict[str, Any]:
    """Settings of the render by name, see RenderSettings: those that a goal does not choose, or all."""
    chosen: dict[str, Any] = {"integrator": Integrator[settings.integrator], "seed": settings.seed}
    if settings.max_depth:
        chosen["max_depth"] = settings.max_depth
    if settings.quality == SAMPLES:
        for name in ("spp", "photons", "caustic_photons", "passes"):
            chosen[name] = getattr(settings, name)
    return chosen


def threads_from(render: Any) -> int | None:
    """Blender's threads of a render; None for all there are."""
    return int(render.threads) if render.threads_mode == "FIXED" else None


def keys_from(settings: Any) -> Path | None:
    """The folder of keys, or None."""
    return Path(bpy.path.abspath(settings.keys)) if settings.keys else None
