"""What is rendered: the scene's data, its loaders, its checks and the built-in scenes. Knows no Warp."""

from wdpm.scenes.atrium import atrium
from wdpm.scenes.bsdfs import (
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
from wdpm.scenes.cornell_box import cornell_box
from wdpm.scenes.errors import SceneError
from wdpm.scenes.geometry import FlatScene, Triangles, flatten
from wdpm.scenes.light_sources import DirectionalLight, Environment, Light, PointLight, SpotLight
from wdpm.scenes.load import load
from wdpm.scenes.model import Camera, FilterKind, Material, Medium, Mesh, PixelFilter, Scene, diffuse
from wdpm.scenes.textures import RGB, Bitmap, Checkerboard, Interpolation, Texture, VertexColors, Wrap

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
