"""The render engine: F12, animations, and `blender -b FILE -E WDPM -f 1`."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import bpy

from wdpm.blender.backends import BACKENDS
from wdpm.blender.export.camera import render_region
from wdpm.blender.export.scene import read_scene
from wdpm.blender.layers import COMBINED, Layers, depth_of, passes_of, pixels_of
from wdpm.blender.progress import BlenderDisplay, BlenderProgress, Cancelled
from wdpm.blender.settings import SLAVES, TIME, chosen_from, goal_from, keys_from, threads_from
from wdpm.goal.render import Interrupted, render_until
from wdpm.images.image import Image
from wdpm.rendering.backend import Backend
from wdpm.rendering.passes import render_in_passes
from wdpm.scenes.errors import WdpmError
from wdpm.scenes.model.scene import Scene

ENGINE = "WDPM"
"""What Blender calls the engine, in files and on its command line."""


class WdpmRenderEngine(bpy.types.RenderEngine):
    """wdpm as Blender sees it. Blender makes an object for each render, and calls `render` for each view layer."""

    bl_idname = ENGINE
    bl_label = "wdpm"
    bl_use_preview = False
    bl_use_shading_nodes_custom = False
    bl_use_eevee_viewport = True
    bl_use_postprocess = True

    def update_render_passes(self, scene: Any, view_layer: Any) -> None:
        """Say which passes there will be, for the compositor."""
        for each in (COMBINED, *passes_of(view_layer, scene.wdpm.light_layers)):
            self.register_pass(scene, view_layer, each.name, len(each.channels), each.channels, each.kind)

    def render(self, depsgraph: Any) -> None:
        """Render a view layer; what goes wrong is one line in Blender."""
        self._begin_black(depsgraph)
        try:
            self._render(depsgraph)
        except Cancelled:
            self.update_stats("", "Cancelled")
        except WdpmError as error:
            self.tell("ERROR", str(error))
            self.error_set(f"wdpm: {error}")

    def _begin_black(self, depsgraph: Any) -> None:
        """Have a result whatever happens: Blender 4.5 crashes if it is to save one that nothing was written to."""
        _, _, width, height = render_region(depsgraph.scene.render)
        if width > 0 and height > 0:
            self.end_result(self.begin_result(0, 0, width, height, layer=depsgraph.view_layer.name))

    def tell(self, kind: str, text: str) -> None:
        """A line for the person.

        Args:
            kind: INFO, WARNING or ERROR.
        """
        self.report({kind}, f"wdpm: {text}")

    def _render(self, depsgraph: Any) -> None:
        self.update_stats("", "Reading the scene")
        scene = read_scene(depsgraph)
        for line in scene.warnings:
            self.tell("WARNING", line)
        view_layer = depsgraph.view_layer_eval
        extra = tuple(passes_of(view_layer, depsgraph.scene.wdpm.light_layers))
        show = _writer(self, scene, depsgraph.view_layer.name, (COMBINED, *extra))
        image = self._image(scene, depsgraph.scene, show)
        for line in image.metadata.get("report", {}).get("warnings", ()):
            if line not in scene.warnings:
                self.tell("INFO", line)
        show(image.layers, 0, 0)

    def _image(self, scene: Scene, source: Any, show: Callable[[Layers, int, int], None]) -> Image:
        """Render as Blender's scene asks to.

        Raises:
            Cancelled: before there was anything to show.
        """
        settings = source.wdpm
        goal = goal_from(settings)
        progress = BlenderProgress(self, settings.seconds if settings.quality == TIME else None)
        with _backend(source) as backend:
            backend.display = BlenderDisplay(show)
            if goal is None:
                return render_in_passes(scene, backend, progress=progress, **chosen_from(settings))
            try:
                return render_until(scene, goal, backend, progress=progress, **chosen_from(settings))
            except Interrupted as stopped:
                return stopped.image


def _backend(source: Any) -> AbstractContextManager[Backend]:
    settings = source.wdpm
    if settings.where == SLAVES:
        return BACKENDS.cluster(settings.address, settings.slaves, keys_from(settings))
    return BACKENDS.here(threads_from(source.render))


def _writer(engine: Any, scene: Scene, layer: str, passes: tuple[Any, ...]) -> Callable[[Layers, int, int], None]:
    """What writes pixels into Blender's result, whose lowest row is the first."""
    depth = depth_of(scene.camera)

    def show(layers: Layers, x0: int, y0: int) -> None:
        height, width = layers["beauty"].shape[:2]
        part = depth.part(x0, y0, width, height)
        bottom = scene.camera.height - y0 - height
        result = engine.begin_result(x0, bottom, width, height, layer=layer)
        found = {each.name: each for each in result.layers[0].passes}
        for each in passes:
            if each.name in found:
                found[each.name].rect.foreach_set(pixels_of(each, layers, part))
        engine.end_result(result)

    return show
