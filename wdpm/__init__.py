"""wdpm: global illumination by distributed photon mapping.

import wdpm
image = wdpm.render("cornell-box", photons=250_000, spp=16)
image.save("image.exr")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wdpm import scenes
    from wdpm.api import inspect, render, replay
    from wdpm.checkup.run import check
    from wdpm.cluster.render_settings import RenderSettings, Routing
    from wdpm.clusters import Cluster
    from wdpm.images.comparison import compare
    from wdpm.images.image import Image
    from wdpm.inspection.plan import Plan
    from wdpm.scenes.errors import WdpmError
    from wdpm.scenes.load import load
    from wdpm.scenes.model.scene import Scene

__all__ = [
    "Cluster",
    "Image",
    "Plan",
    "RenderSettings",
    "Routing",
    "Scene",
    "WdpmError",
    "check",
    "compare",
    "inspect",
    "load",
    "render",
    "replay",
    "scenes",
]

_HOME = {
    "Cluster": "wdpm.clusters",
    "Image": "wdpm.images.image",
    "Plan": "wdpm.inspection.plan",
    "RenderSettings": "wdpm.cluster.render_settings",
    "Routing": "wdpm.cluster.render_settings",
    "Scene": "wdpm.scenes.model.scene",
    "WdpmError": "wdpm.scenes.errors",
    "check": "wdpm.checkup.run",
    "compare": "wdpm.images.comparison",
    "inspect": "wdpm.api",
    "load": "wdpm.scenes.load",
    "render": "wdpm.api",
    "replay": "wdpm.api",
}


def __getattr__(name: str) -> Any:
    """Public names are imported when they are first used, so that `wdpm --help` need not wait for Warp."""
    import importlib

    if name in _HOME:
        return getattr(importlib.import_module(_HOME[name]), name)
    if name == "scenes":
        return importlib.import_module("wdpm.scenes")
    raise AttributeError(f"module 'wdpm' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
