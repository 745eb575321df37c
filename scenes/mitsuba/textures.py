"""Mitsuba's texture plugins, and the parameters that take either a value or a texture."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.images.ahead import Ahead
from wdpm.scenes.images.read import read_texture
from wdpm.scenes.mitsuba.colours import read_spectrum_file, within_gamut
from wdpm.scenes.mitsuba.document import Document, Element
from wdpm.scenes.mitsuba.plugin import Plugin
from wdpm.scenes.model import transforms
from wdpm.scenes.model.textures import (
    RGB,
    Bitmap,
    Checkerboard,
    Color,
    Interpolation,
    Number,
    Texture,
    VertexColors,
    Wrap,
)
from wdpm.scenes.spectra.cie import LONGEST, SHORTEST
from wdpm.scenes.spectra.spectrum import (
    Spectrum,
    blackbody,
    color_of_light,
    color_of_surface,
    parse_even,
    parse_lists,
    parse_pairs,
)

CONSTANTS: Final = ("uniform", "srgb", "d65", "regular", "irregular", "blackbody", "rawconstant")
"""Texture plugins that are the same everywhere: Mitsuba 3's spectra."""

_VERTEX, _FACE = "vertex_", "face_"

UPWARDS: Final = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])
"""Texture coordinates whose v grows the other way."""


Picture = tuple[Path, bool]
"""A file, and whether its numbers are raw."""

Pictures = Ahead[Picture, NDArray[np.float32]]


def read_picture(picture: Picture) -> NDArray[np.float32]:
    """As `read_texture`."""
    file, raw = picture
    return read_texture(file, raw=raw)


def pictures_of(document: Document) -> Iterator[Picture]:
    """Those of bitmaps that shapes and emitters use, in the order of the document.

    What is wrong with a name is told when the plugin is read.
    """
    waiting = [element for element in reversed(document.root.children) if element.tag in ("shape", "emitter")]
    seen: set[int] = set()
    while waiting:
        element = waiting.pop()
        if element.tag == "ref":
            element = document.ids.get(element.attributes.get("id", ""), element)
        if id(element) in seen:
            continue
        seen.add(id(element))
        if element.tag == "texture" and element.attributes.get("type") == "bitmap":
            given = {each.attributes.get("name"): each.attributes.get("value", "") for each in element.children}
            with suppress(SceneError):
                yield document.resolve_file(given.get("filename", ""), element).resolve(), given.get("raw") == "true"
        waiting += reversed(element.children)


class TextureReader:
    """Reads textures; plugins that say the same share one texture, and files are read once.

    Args:
        pictures: reads their files.
    """

    def __init__(self, warnings: list[str], pictures: Pictures) -> None:
        self._warnings = warnings
        self._pictures = pictures
        self._by_element: dict[Element, Texture] = {}
        self._bitmaps: dict[tuple[object, ...], Bitmap] = {}
        self._exchanged: dict[Checkerboard, Checkerboard] = {}
        self._pixels: dict[tuple[Path, bool], NDArray[np.float32]] = {}

    def read(self, plugin: Plugin) -> Texture:
        """The texture that a plugin describes.

        Raises:
            SceneError: with file and line.
        """
        if plugin.element not in self._by_element:
            self._by_element[plugin.element] = self._read_new(plugin)
        return self._by_element[plugin.element]

    def _read_new(self, plugin: Plugin) -> Texture:
        match plugin.type:
            case "bitmap":
                return self._bitmap(plugin)
            case "checkerboard":
                return _checkerboard(plugin)
            case "scale":
                return self._scaled(plugin)
            case plugin_type if plugin_type in CONSTANTS:
                pixels = np.array(constant(plugin), np.float32).reshape(1, 1, 3)
                return Bitmap(plugin.name, pixels, Wrap.REPEAT, Interpolation.NEAREST)
        return _vertex_colors(plugin)

    def _scaled(self, plugin: Plugin) -> Texture:
        """0.6's: a texture, all of it times a number."""
        at = plugin.at("scale")
        scale = plugin.take_float("scale", 1.0)
        nested = plugin.take_one("texture")
        plugin.finish()
        if nested is None or scale < 0.0:
            raise at.error(f"{plugin}: expected one nested texture, and a scale that is not negative")
        return _times(self.read(nested), scale)

    def take_color(
        self, plugin: Plugin, name: str, default: RGB, *, most: float = np.inf, emission: bool = False
    ) -> Color:
        """A parameter that is a colour or a texture.

        Args:
            most: the largest value that a channel may have; none may be negative.
            emission: whether it is a light's (see `read_colour`).
        """
        nested = self._take_nested(plugin, name)
        if nested is not None and nested.type not in CONSTANTS:
            return self.read(nested)
        if nested is None:
            at = plugin.at(name)
            colour = plugin.take_colour(name, default, emission=emission, most=most)
        else:
            at = nested.element
            colour = constant(nested, emission=emission, most=most)
        if not all(0.0 <= channel <= most for channel in colour):
            shown = " ".join(f"{channel:g}" for channel in colour)
            allowed = f"lie between 0 and {most:g}" if most < np.inf else "not be negative"
            raise at.error(f'{plugin}: "{name}" must {allowed}, got {shown}')
        return colour

    def take_number(self, plugin: Plugin, name: str, default: float, *, most: float = np.inf) -> Number:
        """A parameter that is a number or a texture; of a colour its mean, of an image its luminance, as in Mitsuba."""
        value = self.take_color(plugin, name, (default, default, default), most=most)
        if isinstance(value, Checkerboard):
            # Mitsuba 3.9 reads a checkerboard's numbers from the other squares than its colours (eval_1 and eval)
            return self._exchanged.setdefault(
                value, replace(value, color0=_grey(value.color1), color1=_grey(value.color0))
            )
        if isinstance(value, Texture):
            return value
        return _grey(value)[0]

    def take_texture(self, plugin: Plugin, name: str | None = None) -> Texture | None:
        """The nested texture of this parameter name, or under any name, if there is one."""
        found = self._take_nested(plugin, name)
        return None if found is None else self.read(found)

    def _take_nested(self, plugin: Plugin, name: str | None) -> Plugin | None:
        found = plugin.take_one("texture", name)
        if found is not None and name is not None and plugin.has(name):
            raise plugin.value_error(name, "is given twice: as a value and as a texture")
        return found

    def _bitmap(self, plugin: Plugin) -> Bitmap:
        file = plugin.take_file().resolve()
        raw = plugin.take_bool("raw", False)
        wrap = Wrap(plugin.take_choice("wrap_mode", "repeat", [mode.value for mode in Wrap]))
        interpolation = self._filter(plugin)
        to_uv = UPWARDS @ _planar(plugin)  # Mitsuba's images begin at the top with v = 0
        _check_gamma(plugin)
        plugin.ignore("cache", "max_anisotropy", "accel", "format")  # change speed and memory only
        plugin.finish()
        key = file, raw, wrap, interpolation, to_uv.tobytes()
        if key not in self._bitmaps:
            if (file, raw) not in self._pixels:
                self._pixels[file, raw] = self._pictures.get((file, raw))
            self._bitmaps[key] = Bitmap(file.name, self._pixels[file, raw], wrap, interpolation, to_uv)
        return self._bitmaps[key]

    def _filter(self, plugin: Plugin) -> Interpolation:
        name = plugin.take_choice("filter_type", "bilinear", ["bilinear", "nearest", "trilinear", "ewa"])
        if name in ("trilinear", "ewa"):  # 0.6
            self._warnings.append(f'texture {plugin.name}: filter "{name}" is replaced by "bilinear"')
            return Interpolation.BILINEAR
        return Interpolation(name)


def halved(value: Number) -> Number:
    """Half of a number or a texture."""
    return _times(value, 0.5) if isinstance(value, Texture) else 0.5 * value


def _times(texture: Texture, scale: float) -> Texture:
    """A texture, all of it times a number."""
    match texture:
        case Bitmap():
            return replace(texture, pixels=texture.pixels * np.float32(scale))
        case Checkerboard():
            first, second = (np.multiply(scale, color) for color in (texture.color0, texture.color1))
            return replace(texture, color0=_rgb(first), color1=_rgb(second))
    return replace(texture, scale=texture.scale * scale)


def _grey(colour: RGB) -> RGB:
    """The number that Mitsuba makes of one colour: the mean, also where an image's would be its luminance."""
    if len(set(colour)) == 1:
        return colour  # just this value, whatever rounding does
    mean = sum(colour) / 3.0
    return mean, mean, mean


def _check_gamma(plugin: Plugin) -> None:
    error = plugin.value_error("gamma", "other than -1 (by the file's type) is not supported; use raw for linear data")
    if plugin.take_float("gamma", -1.0) != -1.0:
        plugin.rules.refuse(error, f"{plugin}: gamma is not supported", "it goes by the file's type")


def _checkerboard(plugin: Plugin) -> Checkerboard:
    colors = [_plain_color(plugin, "color0", 0.4), _plain_color(plugin, "color1", 0.2)]
    to_uv = _planar(plugin)
    plugin.finish()
    return Checkerboard(plugin.name, colors[0], colors[1], to_uv)


def _plain_color(plugin: Plugin, name: str, default: float) -> RGB:
    return take_plain(plugin, name, (default, default, default), emission=False)


def take_plain(plugin: Plugin, name: str, default: RGB, *, emission: bool) -> RGB:
    """A parameter that is one colour, given as a value or by a texture that is the same everywhere.

    Raises:
        SceneError: it is negative, or another texture.
    """
    at = plugin.at(name)
    nested = plugin.take_one("texture", name)
    if nested is None:
        colour = plugin.take_colour(name, default, emission=emission)
    elif nested.type in CONSTANTS:
        at = nested.element
        colour = constant(nested, emission=emission)
    else:
        raise nested.error(f'{plugin}: "{name}" cannot be a texture; give an <rgb>')
    if min(colour) < 0.0:
        raise at.error(f'{plugin}: "{name}" must not be negative')
    return colour


def constant(plugin: Plugin, *, emission: bool = False, most: float = np.inf) -> RGB:
    """The colour of a texture plugin of CONSTANTS; arguments as for `read_colour`.

    Spectra that Mitsuba 3 has in its spectral modes alone are seen as a <spectrum> of the same values is.
    """
    match plugin.type:
        case "uniform":
            plugin.ignore("wavelength_min", "wavelength_max")
            value = plugin.take_float("value", 1.0)
            colour: RGB = (value, value, value)
        case "rawconstant":
            colour = plugin.take_numbers("value")
        case "srgb":
            plugin.ignore("unbounded")
            colour = plugin.take_colour("color", (1.0, 1.0, 1.0), emission=emission)
        case "d65":
            colour = _d65(plugin, emission=emission)
        case _:
            spectrum = _by_wavelength(plugin)
            seen = color_of_light(spectrum) if emission else color_of_surface(spectrum)
            colour = within_gamut(seen, most, plugin.element, plugin.document)
    plugin.finish()
    return colour


def _d65(plugin: Plugin, *, emission: bool) -> RGB:
    """A colour under D65, which is sRGB's white: itself."""
    nested = plugin.take_one("texture")
    scale = plugin.take_float("scale", 1.0)
    if nested is not None:
        if nested.type not in CONSTANTS:
            raise nested.error(f"{plugin}: {nested} in it is not supported; use it in place of the d65")
        return constant(nested, emission=emission)
    return _rgb(scale * np.array(plugin.take_colour("color", (1.0, 1.0, 1.0), emission=False)))


def _by_wavelength(plugin: Plugin) -> Spectrum:
    try:
        if plugin.type == "blackbody":
            temperature = plugin.take_float("temperature", 0.0)
            ends = plugin.take_float("wavelength_min", SHORTEST), plugin.take_float("wavelength_max", LONGEST)
            return blackbody(temperature, *ends)
        if plugin.has("value"):
            at = plugin.at("value")
            if "filename" in at.attributes:
                plugin.ignore("value")
                return read_spectrum_file(plugin.document.resolve_file(at.attributes["filename"], at), at)
            plugin.ignore("value")
            return parse_pairs(at.attribute("value"))
        if plugin.type == "irregular":
            return parse_lists(plugin.take_string("wavelengths"), plugin.take_string("values"))
        ends = plugin.take_float("wavelength_min", SHORTEST), plugin.take_float("wavelength_max", LONGEST)
        return parse_even(plugin.take_string("values"), *ends)
    except ValueError as error:
        raise plugin.error(f"{plugin}: {error}") from error


def _rgb(values: NDArray[np.float64]) -> RGB:
    return float(values[0]), float(values[1]), float(values[2])


def _vertex_colors(plugin: Plugin) -> VertexColors:
    if plugin.type == "vertexcolors":  # 0.6
        plugin.finish()
        return VertexColors("vertex_color")
    at = plugin.at("name")
    name = plugin.take_string("name")
    if not name.startswith((_VERTEX, _FACE)):
        raise at.error(f'{plugin}: "name" must begin with "{_VERTEX}" or "{_FACE}", got "{name}"')
    at = plugin.at("scale")
    scale = plugin.take_float("scale", 1.0)
    if scale < 0:
        raise at.error(f'{plugin}: "scale" must not be negative, got {scale:g}')
    plugin.finish()
    return VertexColors(name, scale)


def _planar(plugin: Plugin) -> NDArray[np.float64]:
    """The plugin's map of texture coordinates, shape [3, 3]."""
    given = plugin.take_transform("to_uv")
    matrix = np.eye(4) if given is None else given
    scale = [plugin.take_float("uscale", 1.0), plugin.take_float("vscale", 1.0), 1.0]  # 0.6
    offset = [plugin.take_float("uoffset", 0.0), plugin.take_float("voffset", 0.0), 0.0]
    matrix = transforms.translation(offset) @ transforms.scaling(scale) @ matrix
    planar = np.eye(3)
    planar[:2, :2] = matrix[:2, :2]
    planar[:2, 2] = matrix[:2, 3]
    return planar
