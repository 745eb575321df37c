"""A scene as kernels that shade see it."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.camera import CameraView
from wdpm.kernels.camera.caustic_guide import CausticGuide
from wdpm.kernels.lights.lights import Lights
from wdpm.kernels.materials.medium import Media
from wdpm.kernels.materials.resolve import Materials
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.rays.cells import Cells

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Scene:
    """What is in a cell, what surfaces, media and lights there may be, and how it is looked at.

    Attributes:
        surfaces: of the cell; none where what has met no surface is looked at.
        cells: all of them.
        caustics: where paths go on to find them.
    """

    surfaces: Surfaces
    materials: Materials
    textures: Textures
    media: Media
    lights: Lights
    cells: Cells
    camera: CameraView
    caustics: CausticGuide
