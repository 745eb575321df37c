"""Renders scenes with wdpm and with Cycles, inside Blender: python render_in_blender.py FOLDER NAME...

Writes FOLDER/NAME.npz with the passes of both, and what wdpm said as FOLDER/NAME.txt. Blender's module has to be left
without its end, or it hangs.
"""

from __future__ import annotations

import os
import sys
import traceback
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
from scenes_in_blender import SCENES

from wdpm.blender import addon, engine

CYCLES_SAMPLES = 128


def render(name: str, to: Path) -> dict[str, np.ndarray]:
    """What an engine makes of the scene that is open: pass -> pixels, top row first; names of several view layers stay
    before those of their passes."""
    render = bpy.context.scene.render
    render.engine = name
    render.filepath = str(to)
    bpy.ops.render.render(write_still=True)
    channels = OpenEXR.File(str(to)).channels()
    several = len(bpy.context.scene.view_layers) > 1
    return {each if several else each.split(".", 1)[1]: np.array(pixel.pixels) for each, pixel in channels.items()}


def prepare() -> None:
    """The same for both: box filter, two threads, linear EXR with all passes."""
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Raw"
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    scene.render.threads_mode, scene.render.threads = "FIXED", 2
    scene.render.filter_size = 0.0
    scene.cycles.pixel_filter_type, scene.cycles.samples = "BOX", CYCLES_SAMPLES
    scene.cycles.blur_glossy = scene.cycles.sample_clamp_indirect = 0.0  # which would take light from caustics
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = 64
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    layer = bpy.context.view_layer
    layer.use_pass_z = layer.use_pass_normal = layer.use_pass_diffuse_color = True
    scene.wdpm.quality, scene.wdpm.spp, scene.wdpm.light_layers = "SAMPLES", 32, True
    scene.wdpm.photons = scene.wdpm.caustic_photons = 30_000


def main(folder: Path, names: list[str]) -> int:
    said: list[str] = []
    engine.WdpmRenderEngine.tell = lambda _, kind, text: said.append(f"{kind}: {text}")
    addon.register()
    for name in names:
        SCENES[name]()
        prepare()
        said.clear()
        passes = {f"wdpm/{key}": pixels for key, pixels in render("WDPM", folder / "wdpm.exr").items()}
        passes |= {f"cycles/{key}": pixels for key, pixels in render("CYCLES", folder / "cycles.exr").items()}
        np.savez(folder / f"{name}.npz", **passes)
        (folder / f"{name}.txt").write_text("\n".join(said))
    return 0


if __name__ == "__main__":
    code = 1
    try:
        code = main(Path(sys.argv[1]), sys.argv[2:])
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
