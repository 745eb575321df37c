"""What is rendered: the scene's data, its loaders, its checks and the built-in scenes. Knows no Warp."""

from wdpm.scenes.builtin.atrium import atrium
from wdpm.scenes.builtin.cornell_box import cornell_box
from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.load import load
from wdpm.scenes.model.bsdfs import (
    Blend,
    Bsdf,
    BumpMap,
    Conductor,
    Dielectric,
    Diffuse,
    Distribution,
    Mask,
    NormalMap,
    Null,
    Plastic,
    Principled,
    ThinDielectric,
    TwoSided,
)
from wdpm.scenes.model.lights import DirectionalLight, Environment, Light, PointLight, SpotLight
from wdpm.scenes.model.scene import Camera, FilterKind, Material, Medium, Mesh, PixelFilter, Scene, diffuse
from wdpm.scenes.model.textures import RGB, Bitmap, Checkerboard, Interpolation, Texture, VertexColors, Wrap

__all__ = [
    "RGB",
    "Bitmap",
    "Blend",
    "Bsdf",
    "BumpMap",
    "Camera",
    "Checkerboard",
    "Conductor",
    "Dielectric",
    "Diffuse",
    "DirectionalLight",
    "Distribution",
    "Environment",
    "FilterKind",
    "FlatScene",
    "Interpolation",
    "Light",
    "Mask",
    "Material",
    "Medium",
    "Mesh",
    "NormalMap",
    "Null",
    "PixelFilter",
    "Plastic",
    "PointLight",
    "Principled",
    "Scene",
    "SceneError",
    "SpotLight",
    "Texture",
    "ThinDielectric",
    "Triangles",
    "TwoSided",
    "VertexColors",
    "Wrap",
    "atrium",
    "cornell_box",
    "diffuse",
    "flatten",
    "load",
]
