"""What is rendered: the scene's data, its loaders, its checks and the built-in scenes. Knows no Warp."""

from wdpm.scenes.builtin.atrium import atrium
from wdpm.scenes.builtin.cornell_box import cornell_box
from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.load import load
from wdpm.scenes.model import bsdfs, lights
from wdpm.scenes.model.bsdfs import *  # noqa: F403 - all that its __all__ names: a new material is said once
from wdpm.scenes.model.lights import *  # noqa: F403 - likewise
from wdpm.scenes.model.scene import Camera, FilterKind, Material, Medium, Mesh, PixelFilter, Scene, diffuse
from wdpm.scenes.model.textures import RGB, Bitmap, Checkerboard, Interpolation, Texture, VertexColors, Wrap

__all__ = [
    "RGB",
    "Bitmap",
    "Camera",
    "Checkerboard",
    "FilterKind",
    "FlatScene",
    "Interpolation",
    "Material",
    "Medium",
    "Mesh",
    "PixelFilter",
    "Scene",
    "SceneError",
    "Texture",
    "Triangles",
    "VertexColors",
    "Wrap",
    "atrium",
    "cornell_box",
    "diffuse",
    "flatten",
    "load",
]
__all__ += bsdfs.__all__
__all__ += lights.__all__
