"""Checks of the engine inside Blender: python checks_in_blender.py NAME FOLDER. Its last line of output is JSON."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import traceback
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from render_in_blender import prepare, render
from scenes_in_blender import SCENES
from stage_in_blender import ball, camera, empty, grey, lamp, material, plane, stage, world

from wdpm.blender import addon, engine, progress
from wdpm.blender.export.scene import read_scene
from wdpm.scenes.errors import WdpmError

TELL = engine.WdpmRenderEngine.tell


def notes() -> list[str]:
    """What the export says of the scene that is open."""
    return list(read_scene(bpy.context.evaluated_depsgraph_get()).warnings)


def refused() -> str:
    """How the export refuses the scene that is open."""
    try:
        read_scene(bpy.context.evaluated_depsgraph_get())
    except WdpmError as error:
        return str(error)
    return "it was not refused"


def bad_scenes(_: Path) -> Any:
    """What cannot be rendered."""
    found = {}
    empty()
    plane(1)
    lamp("SUN")
    found["no camera"] = refused()
    camera((0, 0, 5), (0, 0, 0), type="PANO")
    found["panorama"] = refused()
    empty()
    camera((0, 0, 5), (0, 0, 0))
    found["nothing"] = refused()
    plane(1, grey())
    found["no light"] = refused()
    lamp("SUN")
    render_settings = bpy.context.scene.render
    render_settings.use_border = True
    render_settings.border_min_x = render_settings.border_max_x = 0.5
    found["no region"] = refused()
    return found


def failed(folder: Path) -> Any:
    """F12 on a scene without light, with the word that Blender's operator has about it."""
    engine.WdpmRenderEngine.tell = TELL
    empty()
    camera((0, 0, 5), (0, 0, 0))
    plane(1, grey())
    prepare()
    try:
        render("WDPM", folder / "dark.exr")
    except RuntimeError as error:
        return str(error)
    return "it was not refused"


def unsupported(_: Path) -> Any:
    """Nodes and things that are named, and replaced."""
    empty()
    stage()
    lamp("SUN", energy=1)
    paint = material("ShaderNodeBsdfDiffuse", name="Marble")
    tree = paint.node_tree
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs[0], tree.nodes[0].inputs["Color"])
    plane(1, paint, (0, 0, 0.1))
    plane(1, material("ShaderNodeBsdfHair", name="Fur"), (0, 0, 0.2))
    odd = material("ShaderNodeBsdfPrincipled", name="Skin", Subsurface_Weight=0.5, Thin_Film_Thickness=300.0)
    plane(1, odd, (0, 0, 0.3)).visible_camera = False
    bpy.ops.object.volume_add()
    bpy.context.scene.render.film_transparent = True
    sky = world().nodes
    tree = bpy.context.scene.world.node_tree
    tree.links.new(sky.new("ShaderNodeTexSky").outputs[0], sky["Background"].inputs[0])
    return notes()


def goals(folder: Path) -> Any:
    """To an error, and to a time."""
    SCENES["light_ball"]()
    prepare()
    found = {}
    for quality in ("ERROR", "TIME"):
        settings = bpy.context.scene.wdpm
        settings.quality, settings.error, settings.limit, settings.seconds = quality, 0.1, 30.0, 3.0
        found[quality] = float(render("WDPM", folder / "goal.exr")["Combined"][..., :3].mean())
    return found


def cancelled(folder: Path) -> Any:
    """A person who presses Esc at the second word about progress."""
    SCENES["light_ball"]()
    prepare()
    asked = []
    progress.BlenderProgress._check = _cancel_after(asked, 4)
    render("WDPM", folder / "cancelled.exr")
    return len(asked)


def _cancel_after(asked: list[int], count: int) -> Any:
    def check(_: Any) -> None:
        asked.append(1)
        if len(asked) >= count:
            raise progress.Cancelled

    return check


def cancelled_while_waiting(folder: Path) -> Any:
    """Esc while slaves are waited for that nobody starts; and the next render has nothing left of them."""
    SCENES["light_point"]()
    prepare()
    settings = bpy.context.scene.wdpm
    settings.where, settings.slaves, settings.address = "SLAVES", 1, "tcp://127.0.0.1:47232"
    check = progress.BlenderProgress._check
    asked: list[int] = []
    progress.BlenderProgress._check = _cancel_after(asked, 8)
    black = render("WDPM", folder / "waiting.exr")["Combined"][..., :3].max()
    progress.BlenderProgress._check = check
    settings.where = "HERE"
    return {"black": float(black), "then": float(render("WDPM", folder / "here.exr")["Combined"][..., :3].max())}


def view_layers(folder: Path) -> Any:
    """A view layer with an object less, and one with another material everywhere."""
    SCENES["light_point"]()
    thing = ball((0, 0, 0.5), grey(), 0.5)
    scene = bpy.context.scene
    other = bpy.data.collections.new("Other")
    scene.collection.children.link(other)
    scene.collection.objects.unlink(thing)
    other.objects.link(thing)
    scene.view_layers[0].name = "All"
    scene.view_layers.new("Less").layer_collection.children["Other"].exclude = True
    scene.view_layers.new("Black").material_override = material(Color=(0, 0, 0, 1))
    prepare()
    passes = render("WDPM", folder / "layers.exr")
    return {name: float(pixels[..., :3].mean()) for name, pixels in passes.items() if "Combined" in name}


def on_slaves(folder: Path) -> Any:
    """The same bits from slaves, which stay for a second render."""
    SCENES["light_ball"]()
    prepare()
    alone = render("WDPM", folder / "alone.exr")["Combined"]
    settings = bpy.context.scene.wdpm
    settings.where, settings.slaves, settings.address = "SLAVES", 2, "tcp://127.0.0.1:47231"
    command = [sys.executable, "-m", "wdpm", "slave", settings.address, "--threads", "1"]
    slaves = [subprocess.Popen(command) for _ in range(2)]
    pictures = [render("WDPM", folder / "slaves.exr")["Combined"] for _ in range(2)]
    addon.unregister()
    return {
        "same": [bool(np.array_equal(alone, each)) for each in pictures],
        "codes": [slave.wait(60) for slave in slaves],
        "again": _registers_again(),
    }


def _registers_again() -> bool:
    addon.register()
    return hasattr(bpy.context.scene, "wdpm")


def installed(folder: Path) -> Any:
    """The extension, through Blender's own installer."""
    addon.unregister()
    done = bpy.ops.extensions.package_install_files(
        filepath=str(folder / "wdpm.zip"), repo="user_default", enable_on_install=True
    )
    scene = bpy.context.scene
    scene.render.engine = "WDPM"
    panels = [
        panel.__name__ for panel in bpy.types.Panel.__subclasses__() if "WDPM" in getattr(panel, "COMPAT_ENGINES", ())
    ]
    here = {"done": sorted(done), "engine": scene.render.engine, "quality": scene.wdpm.quality, "panels": panels}
    bpy.ops.preferences.addon_disable(module="bl_ext.user_default.wdpm")
    return here | {"left": hasattr(scene, "wdpm")}


EVERY = (bad_scenes, failed, unsupported, goals, cancelled, cancelled_while_waiting, view_layers, on_slaves, installed)
CHECKS = {each.__name__: each for each in EVERY}


def main(name: str, folder: Path) -> int:
    said: list[str] = []
    engine.WdpmRenderEngine.tell = lambda _, kind, text: said.append(f"{kind}: {text}")
    addon.register()
    found = CHECKS[name](folder)
    print("\n" + json.dumps({"found": found, "said": said}))
    return 0


if __name__ == "__main__":
    code = 1
    try:
        code = main(sys.argv[1], Path(sys.argv[2]))
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
