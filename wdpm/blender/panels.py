"""Panels of the render properties, and Blender's own panels that make sense for us."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import bpy

from wdpm.blender.engine import ENGINE
from wdpm.blender.settings import ERROR, SLAVES, TIME

_LIKE_OURS = "BLENDER_EEVEE_NEXT"
"""The engine whose panels of materials, lights and worlds are those of nodes."""

_NOT_OURS = re.compile(
    r"eevee_(next_)?(raytracing|sampling|motion|volumes|performance|film|hair|depth|denoise|gi|clamping)|lightprobe"
    r"|light_(distance|shadow|influence)|light_probes|WORLD_PT_(mist|settings|sun|volume)|MATERIAL_PT_(settings|thickness)"
    r"|layer_passes|freestyle|lineset|linestyle|shading_render_pass|grease_?pencil|gpencil|stereoscopy"
    r"|PT_filter|RENDER_PT_eevee",
    re.IGNORECASE,
)
"""Those of its panels that have knobs of its own, or of things that we do not render."""


class _Panel:
    """What our panels share."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {ENGINE}  # noqa: RUF012 - Blender's way

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Whether to show it."""
        return bool(context.engine in cls.COMPAT_ENGINES)


class RENDER_PT_wdpm_quality(_Panel, bpy.types.Panel):
    """How good, or how long; the knobs below."""

    bl_idname = "RENDER_PT_wdpm_quality"
    bl_label = "Quality"

    def draw(self, context: Any) -> None:
        """Draw it."""
        settings = context.scene.wdpm
        self.layout.use_property_split = True
        self.layout.prop(settings, "quality", expand=True)
        if settings.quality == ERROR:
            self.layout.prop(settings, "error")
            self.layout.prop(settings, "limit")
        elif settings.quality == TIME:
            self.layout.prop(settings, "seconds")
        else:
            for name in ("spp", "photons", "caustic_photons", "passes"):
                self.layout.prop(settings, name)


class RENDER_PT_wdpm_light(_Panel, bpy.types.Panel):
    """Knobs that are there whatever is asked for."""

    bl_idname = "RENDER_PT_wdpm_light"
    bl_label = "Advanced"
    bl_parent_id = "RENDER_PT_wdpm_quality"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012

    def draw(self, context: Any) -> None:
        """Draw it."""
        self.layout.use_property_split = True
        for name in ("integrator", "max_depth", "seed"):
            self.layout.prop(context.scene.wdpm, name)
        self.layout.prop(context.scene.render, "filter_size")


class RENDER_PT_wdpm_where(_Panel, bpy.types.Panel):
    """Which computers."""

    bl_idname = "RENDER_PT_wdpm_where"
    bl_label = "Performance"

    def draw(self, context: Any) -> None:
        """Draw it."""
        settings, render = context.scene.wdpm, context.scene.render
        self.layout.use_property_split = True
        self.layout.prop(settings, "where", expand=True)
        if settings.where == SLAVES:
            for name in ("address", "slaves", "keys"):
                self.layout.prop(settings, name)
            self.layout.label(text=f"Start slaves with: wdpm slave {settings.address}")
        else:
            self.layout.prop(render, "threads_mode", expand=True)
            if render.threads_mode == "FIXED":
                self.layout.prop(render, "threads")


class VIEWLAYER_PT_wdpm_passes(_Panel, bpy.types.Panel):
    """Passes of a view layer."""

    bl_idname = "VIEWLAYER_PT_wdpm_passes"
    bl_label = "Passes"
    bl_context = "view_layer"

    def draw(self, context: Any) -> None:
        """Draw it."""
        self.layout.use_property_split = True
        for name in ("use_pass_z", "use_pass_normal", "use_pass_diffuse_color"):
            self.layout.prop(context.view_layer, name)
        self.layout.prop(context.scene.wdpm, "light_layers")


PANELS = (RENDER_PT_wdpm_quality, RENDER_PT_wdpm_light, RENDER_PT_wdpm_where, VIEWLAYER_PT_wdpm_passes)


def blenders_panels() -> Iterator[Any]:
    """Blender's panels that we want shown: those that Eevee shows, but for its own knobs."""
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", ())
        if _LIKE_OURS in engines and not _NOT_OURS.search(panel.__name__):
            yield panel


def register_panels() -> None:
    """Show all panels."""
    for panel in PANELS:
        bpy.utils.register_class(panel)
    for panel in blenders_panels():
        panel.COMPAT_ENGINES.add(ENGINE)


def unregister_panels() -> None:
    """Take them away again."""
    for panel in bpy.types.Panel.__subclasses__():
        if ENGINE in getattr(panel, "COMPAT_ENGINES", ()) and panel not in PANELS:
            panel.COMPAT_ENGINES.discard(ENGINE)
    for panel in reversed(PANELS):
        bpy.utils.unregister_class(panel)
