"""What Blender calls when the add-on is switched on and off."""

from __future__ import annotations

import bpy

from wdpm.blender.backends import BACKENDS
from wdpm.blender.engine import WdpmRenderEngine
from wdpm.blender.panels import register_panels, unregister_panels
from wdpm.blender.settings import register_settings, unregister_settings
from wdpm.quiet import quiet_warp


def register() -> None:
    """Add the engine, its settings and its panels."""
    quiet_warp()
    register_settings()
    bpy.utils.register_class(WdpmRenderEngine)
    register_panels()


def unregister() -> None:
    """Take all of it away again, and let slaves go."""
    BACKENDS.close()
    unregister_panels()
    bpy.utils.unregister_class(WdpmRenderEngine)
    unregister_settings()
