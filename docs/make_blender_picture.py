"""Renders the picture of docs/blender.md, the same room by wdpm and by Cycles: python docs/make_blender_picture.py

Needs Blender's module: make test-blender installs it into .venv-blender.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
import traceback
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
from PIL import Image

from wdpm.blender import addon
from wdpm.images.channels import encode_srgb8

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE.parent / "tests" / "blender"))

from stage_in_blender import add, ball, camera, empty, grey, lamp, material, plane  # noqa: E402

WIDTH, HEIGHT = 400, 300
EXPOSURE = 1.3


def room() -> None:
    """Two walls of colour, a lamp near the ceiling, a ball of glass and one of metal."""
    empty(WIDTH, HEIGHT)
    camera((0, -5.4, 1.6), (math.radians(88), 0, 0), lens=32)
    wide = math.radians(90)
    white, red, green = grey(0.75), material(Color=(0.63, 0.07, 0.05, 1)), material(Color=(0.14, 0.45, 0.09, 1))
    for location, turned, paint in (
        ((0, 0, 0), (0, 0, 0), white),
        ((0, 0, 4), (math.pi, 0, 0), white),
        ((0, 2, 2), (wide, 0, 0), white),
        ((-2, 0, 2), (0, wide, 0), red),
        ((2, 0, 2), (0, -wide, 0), green),
    ):
        plane(4, paint, location, turned)
    ball((0.75, -0.6, 0.7), material("ShaderNodeBsdfGlass", IOR=1.5), 0.7)
    ball((-0.8, 0.6, 0.8), material("ShaderNodeBsdfPrincipled", Base_Color=(0.9, 0.6, 0.3, 1), Metallic=1.0), 0.8)
    lamp("AREA", (0.4, 0, 3.9), energy=70, size=0.7)
    add("Place", None)


def main() -> None:
    room()
    addon.register()
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.wdpm.quality, scene.wdpm.spp, scene.wdpm.caustic_photons = "SAMPLES", 64, 1_000_000
    scene.cycles.samples, scene.cycles.use_denoising = 1024, False
    pictures = []
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "room.exr")
        for engine in ("WDPM", "CYCLES"):
            scene.render.engine = engine
            bpy.ops.render.render(write_still=True)
            channels = OpenEXR.File(scene.render.filepath).channels()
            pictures.append(np.array(next(iter(channels.values())).pixels)[:, :, :3])
    both = encode_srgb8(np.concatenate(pictures, axis=1) * EXPOSURE)
    Image.fromarray(both).save(HERE / "pictures" / "blender-room.jpg", quality=88)


if __name__ == "__main__":
    try:
        main()
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
