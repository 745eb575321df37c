"""What is rendered: the scene's data, its loaders, its checks and the built-in scenes. Knows no Warp."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from wdpm.scenes.load import load as load  # at once: its module has the same name

if TYPE_CHECKING:  # "as", since these are for others
    from wdpm.scenes.builtin.atrium import atrium as atrium
    from wdpm.scenes.builtin.cornell_box import cornell_box as cornell_box
    from wdpm.scenes.errors import SceneError as SceneError
    from wdpm.scenes.flat.arrays import Triangles as Triangles
    from wdpm.scenes.flat.flatten import FlatScene as FlatScene
    from wdpm.scenes.flat.flatten import flatten as flatten
    from wdpm.scenes.model.bsdfs import *  # noqa: F403 - all that its __all__ names: a new material is said once
    from wdpm.scenes.model.lights import *  # noqa: F403 - likewise
    from wdpm.scenes.model.scene import Camera as Camera
    from wdpm.scenes.model.scene import FilterKind as FilterKind
    from wdpm.scenes.model.scene import Material as Material
    from wdpm.scenes.model.scene import Medium as Medium
    from wdpm.scenes.model.scene import Mesh as Mesh
    from wdpm.scenes.model.scene import PixelFilter as PixelFilter
    from wdpm.scenes.model.scene import Scene as Scene
    from wdpm.scenes.model.scene import diffuse as diffuse
    from wdpm.scenes.model.textures import RGB as RGB
    from wdpm.scenes.model.textures import Bitmap as Bitmap
    from wdpm.scenes.model.textures import Checkerboard as Checkerboard
    from wdpm.scenes.model.textures import Interpolation as Interpolation
    from wdpm.scenes.model.textures import Texture as Texture
    from wdpm.scenes.model.textures import VertexColors as VertexColors
    from wdpm.scenes.model.textures import Wrap as Wrap

_HOME = {
    "RGB": "model.textures",
    "Bitmap": "model.textures",
    "Camera": "model.scene",
    "Checkerboard": "model.textures",
    "FilterKind": "model.scene",
    "FlatScene": "flat.flatten",
    "Interpolation": "model.textures",
    "Material": "model.scene",
    "Medium": "model.scene",
    "Mesh": "model.scene",
    "PixelFilter": "model.scene",
    "Scene": "model.scene",
    "SceneError": "errors",
    "Texture": "model.textures",
    "Triangles": "flat.arrays",
    "VertexColors": "model.textures",
    "Wrap": "model.textures",
    "atrium": "builtin.atrium",
    "cornell_box": "builtin.cornell_box",
    "diffuse": "model.scene",
    "flatten": "flat.flatten",
}

_WHOLE = ("model.bsdfs", "model.lights")
"""Modules all of whose public names are names of this one: a new material or light is said once."""


def __getattr__(name: str) -> Any:
    """Public names are imported when they are first used: a slave needs no reader of files."""
    import importlib

    if name == "__all__":
        return __dir__()
    if name in _HOME:
        return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    for module in () if name.startswith("_") else _WHOLE:
        home = importlib.import_module(f"{__name__}.{module}")
        if name in home.__all__:
            return getattr(home, name)
    raise AttributeError(f"module '{__name__}' has no attribute {name!r}")


def __dir__() -> list[str]:
    import importlib

    whole = (name for module in _WHOLE for name in importlib.import_module(f"{__name__}.{module}").__all__)
    return sorted({"load", *_HOME, *whole})
