"""Mitsuba's emitter plugins as lights.

What Mitsuba takes its emission from by wavelength is taken in linear sRGB. `sampling_weight` is ignored everywhere:
lights are chosen by what they are good for.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from wdpm.scenes.images.read import read_texture
from wdpm.scenes.mitsuba.daylight import DAYLIGHT_PLUGINS, read_daylight
from wdpm.scenes.mitsuba.media import MediaReader
from wdpm.scenes.mitsuba.plugin import Plugin
from wdpm.scenes.mitsuba.sensor import read_fov, read_unscaled
from wdpm.scenes.mitsuba.supported import reads
from wdpm.scenes.mitsuba.textures import UPWARDS, TextureReader, take_plain
from wdpm.scenes.model.lights import DirectionalLight, Environment, Light, PointLight, ProjectorLight, SpotLight
from wdpm.scenes.model.textures import RGB, Bitmap, Color
from wdpm.scenes.model.transforms import Matrix, normalized

WHITE: RGB = (1.0, 1.0, 1.0)


class EmitterReader:
    """Turns emitter plugins into lights.

    Attributes:
        textures: reads nested textures.
        media: reads the media around emitters.
        old_axes: whether the file is older than Mitsuba 1, for plugins whose zenith has moved since.
        warnings: receives what is ignored.
    """

    def __init__(self, textures: TextureReader, media: MediaReader, *, old_axes: bool, warnings: list[str]) -> None:
        self.textures = textures
        self.media = media
        self.old_axes = old_axes
        self.warnings = warnings
        self._environment: Plugin | None = None

    def read_area(self, plugin: Plugin) -> Color:
        """The radiance of the shape that an emitter is nested in."""
        if plugin.type != "area":
            raise plugin.error(f'a shape takes an emitter "area", not "{plugin.type}"')
        # before 0.6 it was called intensity
        name = "intensity" if plugin.has("intensity") else "radiance"
        radiance = self.textures.take_color(plugin, name, WHITE, emission=True)
        plugin.ignore("sampling_weight")
        plugin.finish()
        return radiance

    def read(self, plugin: Plugin) -> Light:
        """A light that belongs to no shape."""
        light = _READERS[plugin.type](self, plugin)
        plugin.ignore("sampling_weight")
        plugin.finish()
        return light

    def check_only(self, plugin: Plugin) -> None:
        """Raise SceneError if there is an environment already."""
        if self._environment is not None:
            raise plugin.error(
                f"{plugin}: a scene takes one environment, and line {self._environment.line} has {self._environment}"
            )
        self._environment = plugin


_Reader = Callable[[EmitterReader, Plugin], Light]
_READERS: Final[dict[str, _Reader]] = {}


def _reads(*plugin_types: str) -> Callable[[_Reader], _Reader]:
    """Registers what reads plugins of some types: with that they are supported."""

    def register(reader: _Reader) -> _Reader:
        for plugin_type in plugin_types:
            _READERS[plugin_type] = reader
            reads("emitter", plugin_type)
        return reader

    return register


@_reads("area")
def _read_stray_area(_reader: EmitterReader, plugin: Plugin) -> Light:
    raise plugin.error('emitter "area" must be nested in a shape')


@_reads("point")
def _read_point(reader: EmitterReader, plugin: Plugin) -> PointLight:
    to_world = plugin.take_transform("to_world")
    if to_world is not None and plugin.has("position"):
        raise plugin.value_error("position", "and to_world cannot both be given")
    position = plugin.take_point("position", (0.0, 0.0, 0.0))
    if to_world is not None:
        position = float(to_world[0, 3]), float(to_world[1, 3]), float(to_world[2, 3])
    return PointLight(plugin.name, position, read_emission(plugin, "intensity"), reader.media.read_around(plugin))


@_reads("spot")
def _read_spot(reader: EmitterReader, plugin: Plugin) -> SpotLight:
    to_world = take_rotation(plugin)
    intensity = read_emission(plugin, "intensity")
    cutoff_error = plugin.value_error("cutoff_angle", "must lie between 0 and 180 degrees")
    cutoff = plugin.take_float("cutoff_angle", 20.0)
    if not 0.0 < cutoff <= 180.0:
        raise cutoff_error
    beam_error = plugin.value_error("beam_width", f"must lie between 0 and cutoff_angle ({cutoff:g} degrees)")
    beam = plugin.take_float("beam_width", cutoff * 3.0 / 4.0)
    if not 0.0 <= beam <= cutoff:
        raise beam_error
    return SpotLight(
        plugin.name,
        to_world,
        intensity,
        cutoff,
        beam,
        _read_pattern(reader, plugin, "texture"),
        reader.media.read_around(plugin),
    )


@_reads("projector")
def _read_projector(reader: EmitterReader, plugin: Plugin) -> ProjectorLight:
    scale_error = plugin.value_error("scale", "must not be negative")
    scale = plugin.take_float("scale", 1.0)
    if scale < 0.0:
        raise scale_error
    picture = None
    if plugin.has_nested("texture", "irradiance"):
        if plugin.has("irradiance"):
            raise plugin.value_error("irradiance", "is given twice: as a value and as a texture")
        picture = _read_pattern(reader, plugin, "irradiance")
    irradiance = WHITE if picture is not None else read_emission(plugin, "irradiance")
    aspect = 1.0 if picture is None else picture.pixels.shape[1] / picture.pixels.shape[0]
    red, green, blue = (math.pi * scale * channel for channel in irradiance)  # its irradiance is that of radiance 1
    return ProjectorLight(
        plugin.name,
        read_unscaled(plugin),
        (red, green, blue),
        read_fov(plugin, aspect),
        aspect,
        picture,
        reader.media.read_around(plugin),
    )


def _read_pattern(reader: EmitterReader, plugin: Plugin, name: str) -> Bitmap | None:
    nested = plugin.take_one("texture", name)
    if nested is None:
        return None
    texture = reader.textures.read(nested)
    if not isinstance(texture, Bitmap):
        raise nested.error(f'{plugin}: "{name}" must be a bitmap, not a {nested.type}')
    return replace(texture, to_uv=texture.to_uv @ UPWARDS)  # lights know v = 1 as the top, their textures Mitsuba's v


@_reads("directional")
def _read_directional(_reader: EmitterReader, plugin: Plugin) -> DirectionalLight:
    if plugin.has("direction") and plugin.has("to_world"):
        raise plugin.value_error("direction", "and to_world cannot both be given")
    error = plugin.value_error("direction", "is zero")
    given = plugin.take_point("direction", (0.0, 0.0, 1.0))
    to_world = plugin.take_transform("to_world")
    along = np.array(given) if to_world is None else to_world[:3, 2]
    if not np.linalg.norm(along) > 0:
        raise error
    x, y, z = (float(axis) for axis in normalized(along[None])[0])
    return DirectionalLight(plugin.name, (x, y, z), read_emission(plugin, "irradiance"))


@_reads("constant")
def _read_constant(reader: EmitterReader, plugin: Plugin) -> Environment:
    reader.check_only(plugin)
    radiance = read_emission(plugin, "radiance")
    plugin.ignore("to_world")  # alike from everywhere
    return Environment(plugin.name, np.array(radiance, np.float32).reshape(1, 1, 3))


@_reads("envmap")
def _read_envmap(reader: EmitterReader, plugin: Plugin) -> Environment:
    reader.check_only(plugin)
    file = plugin.take_file()
    scale_error = plugin.value_error("scale", "must not be negative")
    scale = plugin.take_float("scale", 1.0)
    if scale < 0.0:
        raise scale_error
    to_world = take_rotation(plugin)
    plugin.ignore("mis_compensation", "cache", "gamma")  # change neither the light nor its directions
    pixels = read_texture(file, raw=False)
    below, right = max(3 - pixels.shape[0], 0), max(2 - pixels.shape[1], 0)
    pixels = np.pad(pixels, ((0, below), (0, right), (0, 0)), mode="edge")  # as Mitsuba fills up what is smaller
    if pixels.min() < 0.0:
        reader.warnings.append(f"line {plugin.line}: {plugin}: negative pixels of {file.name} are taken as black")
    return Environment(plugin.name, np.maximum(pixels, 0.0) * np.float32(scale), to_world)


@_reads(*DAYLIGHT_PLUGINS)
def _read_daylight(reader: EmitterReader, plugin: Plugin) -> Environment:
    reader.check_only(plugin)
    return read_daylight(plugin, old_axes=reader.old_axes, warnings=reader.warnings)


def read_emission(plugin: Plugin, name: str) -> RGB:
    """What an emitter emits, as one colour; white by default.

    Raises:
        SceneError: it is negative, or a texture.
    """
    return take_plain(plugin, name, WHITE, emission=True)


def take_rotation(plugin: Plugin) -> Matrix:
    """The parameter to_world of what can be turned and mirrored; the same scale on all axes is dropped.

    Raises:
        SceneError: it shears, or scales axes differently.
    """
    error = plugin.value_error("to_world", "must be a rotation: it may not stretch or shear")
    matrix = plugin.take_transform("to_world")
    if matrix is None:
        return np.eye(4)
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not lengths.min() > 0.0:
        raise error
    turned = matrix.copy()
    turned[:3, :3] /= lengths.mean()
    if not np.allclose(turned[:3, :3].T @ turned[:3, :3], np.eye(3), atol=2e-3):
        raise error
    return turned
