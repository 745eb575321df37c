"""What is rendered: the scene's data, its loaders, its checks and the built-in scenes. Knows no Warp."""

from wdpm.scenes.atrium import atrium
from wdpm.scenes.cornell_box import cornell_box
from wdpm.scenes.errors import SceneError
from wdpm.scenes.geometry import FlatScene, Triangles, flatten
from wdpm.scenes.load import load
from wdpm.scenes.model import (
    RGB,
    Bitmap,
    Camera,
    FilterKind,
    Interpolation,
    Material,
    Mesh,
    PixelFilter,
    PointLight,
    Scene,
    Wrap,
)

__all__ = [
    "RGB",
    "Bitmap",
    "Camera",
    "FilterKind",
    "FlatScene",
    "Interpolation",
    "Material",
    "Mesh",
    "PixelFilter",
    "PointLight",
    "Scene",
    "SceneError",
    "Triangles",
    "Wrap",
    "atrium",
    "cornell_box",
    "flatten",
    "load",
]
