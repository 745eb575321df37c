"""The value of a socket: a colour, a number, or an image of it.

What nodes do to each pixel for itself (mixing, mathematics, ramps, curves) is done to the pixels of the image here, so
that the renderer looks up the result.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.blender.export.images import Images
from wdpm.blender.export.notes import Notes
from wdpm.blender.export.pixel_nodes import PIXEL_NODES, unsupported_mode
from wdpm.blender.export.placement import read_placement
from wdpm.blender.export.sockets import Output, Socket
from wdpm.scenes.model.textures import RGB, Bitmap, Color, Interpolation, Number, VertexColors, Wrap

Array = NDArray[np.float64]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Of linear Rec. 709: how Blender makes a number of a colour."""

_WRAPS = {"REPEAT": Wrap.REPEAT, "EXTEND": Wrap.CLAMP, "CLIP": Wrap.CLAMP, "MIRROR": Wrap.MIRROR}
_MAGENTA = (1.0, 0.0, 1.0)
_GREY = (0.5, 0.5, 0.5)


@dataclass(frozen=True, eq=False)
class Value:
    """What a socket is fed with.

    Attributes:
        array: shape [3], or of an image [height, width, 3].
        image: where those pixels lie on a surface; None for a constant.
        colors: name of a mesh's colour attribute that stands for the value, times `array`; None for none.
    """

    array: Array
    image: Bitmap | None = None
    colors: str | None = None

    @property
    def mean(self) -> RGB:
        """One colour for all of it."""
        red, green, blue = (float(each) for each in self.array.reshape(-1, 3).mean(axis=0))
        return red, green, blue

    def color(self, most: float | None = None) -> Color:
        """As a colour that is not negative, and at most `most`."""
        if self.colors is not None:
            return VertexColors(self.colors)
        held = np.clip(self.array, 0.0, most)
        if self.image is not None:
            return replace(self.image, pixels=held.astype(np.float32))
        return float(held[0]), float(held[1]), float(held[2])

    def number(self, least: float = 0.0, most: float = 1.0) -> Number:
        """As a number, within limits."""
        held = np.clip(self.array @ LUMINANCE, least, most)
        if self.image is not None:
            return replace(self.image, pixels=np.repeat(held[..., None], 3, axis=2).astype(np.float32))
        return float(held)

    def mapped(self, function: Callable[[Array], Array]) -> Value:
        """The value with a function applied to each of its pixels, an array of shape [..., 3]."""
        return replace(self, array=np.asarray(function(self.array), np.float64))

    def is_constant(self, *values: float) -> bool:
        """Whether it is one number, of some, everywhere."""
        return self.image is None and self.colors is None and any(bool(np.all(self.array == each)) for each in values)


def constant(value: Any) -> Value:
    """A value of a number or a colour."""
    if isinstance(value, int | float):
        return Value(np.full(3, float(value)))
    return Value(np.array([float(each) for each in value][:3], np.float64))


class Values:
    """Reads what sockets of one material are fed with.

    Args:
        owner: the material, for notes, such as 'material "Wood"'.

    Attributes:
        uv_map: name of the UV map that its images lie on, "" for the active one; None without images.
        colors: name of the colour attribute that it reads; None without.
    """

    def __init__(self, owner: str, images: Images, notes: Notes) -> None:
        self.owner = owner
        self.uv_map: str | None = None
        self.colors: str | None = None
        self.images = images
        self._notes = notes

    def note(self, text: str) -> None:
        """Tell the person something about the material."""
        self._notes.add(self.owner, text)

    def read(self, socket: Socket) -> Value:
        """The value of a socket; what is not supported is noted, and grey stands for it."""
        source = socket.source
        if source is None:
            return constant(socket.default if socket.default is not None else 0.0)
        if source.kind == "ShaderNodeTexImage":
            return self._image(source)
        if source.kind in ("ShaderNodeVertexColor", "ShaderNodeAttribute"):
            return self._attribute(source)
        if source.kind == "ShaderNodeLightPath":
            self.note(f'"{source.socket.name}" of Light Path is not supported: it is taken as 0')
            return constant(0.0)
        if source.kind in PIXEL_NODES:
            return self._pixelwise(source)
        self.note(f"{source.label} is not supported: grey stands for it")
        return constant(_GREY)

    def _pixelwise(self, source: Output) -> Value:
        inputs = [self.read(each) for each in source.enabled()]
        for each in inputs:
            if each.colors is not None:
                self.note(f"{source.label} of a colour attribute is not supported: white stands for the attribute")
        mode = unsupported_mode(source.node)
        if mode is not None:
            self.note(f"{source.label} set to {mode.replace('_', ' ').lower()} is not supported: an input goes through")
        placed = [each.image for each in inputs if each.image is not None]
        arrays = _together([each.array for each in inputs], self)
        result = np.asarray(PIXEL_NODES[source.kind](source.node, source.socket.name, arrays), np.float64)
        if len({image.to_uv.tobytes() for image in placed}) > 1:
            self.note(f"{source.label} joins images that lie differently: they are laid upon the first")
        if not placed:
            return Value(np.broadcast_to(result, (3,)))
        shape = (*max((each.shape[:2] for each in arrays if each.ndim == 3), default=(1, 1)), 3)
        return Value(np.broadcast_to(result, shape), placed[0])

    def _image(self, source: Output) -> Value:
        node = source.node
        if node.image is None:
            self.note("an image texture has no image: magenta stands for it")
            return constant(_MAGENTA)
        pixels = self.images.read(node.image)
        if pixels is None:
            return constant(_MAGENTA)
        if node.projection != "FLAT":
            self.note(f"{node.projection.lower()} projection of an image is not supported: its UV map is used")
        if node.extension == "CLIP":
            self.note("an image that ends at its border (Clip) is not supported: its border goes on")
        placement = read_placement(source.input("Vector"), self.owner, self._notes)
        if self.uv_map not in (None, placement.uv_map):
            self.note(f'it uses several UV maps: "{self.uv_map or "the active one"}" is used for all images')
        else:
            self.uv_map = placement.uv_map
        colours, opacity = pixels
        chosen = np.repeat(opacity, 3, axis=2) if source.socket.name == "Alpha" else colours
        interpolation = Interpolation.NEAREST if node.interpolation == "Closest" else Interpolation.BILINEAR
        image = Bitmap(node.image.name, chosen, _WRAPS[node.extension], interpolation, placement.to_uv)
        return Value(chosen.astype(np.float64), image)

    def _attribute(self, source: Output) -> Value:
        name = source.node.layer_name if source.kind == "ShaderNodeVertexColor" else source.node.attribute_name
        wanted = source.kind == "ShaderNodeVertexColor" or source.node.attribute_type == "GEOMETRY"
        if not wanted or source.socket.name != "Color":
            self.note(f'"{source.socket.name}" of {source.label} is not supported: grey stands for it')
            return constant(_GREY)
        if self.colors not in (None, name):
            self.note(f'it reads several colour attributes: "{self.colors}" is used for all')
        else:
            self.colors = name
        return Value(np.ones(3), colors=self.colors)


def _together(arrays: list[Array], values: Values) -> list[Array]:
    """Arrays that can be combined: images of the size of the largest one."""
    sizes = {each.shape[:2] for each in arrays if each.ndim == 3}
    if len(sizes) < 2:
        return arrays
    height, width = max(sizes)
    values.note("images of different sizes are combined: texels of the smaller ones are repeated")
    return [each if each.ndim == 1 else _resized(each, height, width) for each in arrays]


def _resized(array: Array, height: int, width: int) -> Array:
    rows = np.arange(height) * array.shape[0] // height
    columns = np.arange(width) * array.shape[1] // width
    return np.asarray(array[rows][:, columns])
