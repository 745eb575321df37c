"""Mitsuba's sun and sky emitters as environment maps."""

from __future__ import annotations

from typing import Final

import numpy as np

from wdpm.scenes.mitsuba import sky
from wdpm.scenes.mitsuba.plugin import Plugin
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.textures import RGB
from wdpm.scenes.model.transforms import normalized, rotation

DAYLIGHT_PLUGINS: Final = ("sunsky", "sky", "sun")  # the latter two are Mitsuba 0.6's

_PLACE = {"latitude": 35.6894, "longitude": 139.6917, "timezone": 9.0}  # Tokyo, Mitsuba's default
_DATE = {"year": 2010, "month": 7, "day": 10}
_TIME = {"hour": 15.0, "minute": 0.0, "second": 0.0}


def read_daylight(plugin: Plugin, *, old_axes: bool, warnings: list[str]) -> Environment:
    """Reads `sunsky`, `sky` (no sun) or `sun` (no sky); `sampling_weight` is left to the caller.

    Args:
        old_axes: whether the zenith is +y as in Mitsuba 0.6, not +z as in Mitsuba 3.
    """
    to_world = plugin.take_transform("to_world")
    # what the plugin's own axes are in the model's, whose zenith is +z
    upright = rotation((1.0, 0.0, 0.0), 90.0) if old_axes else np.eye(4)
    to_plugin = np.linalg.inv(upright)
    matrix = (np.eye(4) if to_world is None else to_world) @ to_plugin
    if not np.allclose(matrix[:3, :3].T @ matrix[:3, :3], np.eye(3), atol=2e-3):
        raise plugin.value_error("to_world", "must be a rotation: it may not stretch or shear")
    scale = _not_negative(plugin, "scale", 1.0) if old_axes else 1.0
    light = sky.Daylight(
        _take_direction(plugin, matrix),
        _take_turbidity(plugin),
        _take_albedo(plugin),
        0.0 if plugin.type == "sun" else scale * _not_negative(plugin, "sky_scale", 1.0),
        0.0 if plugin.type == "sky" else scale * _not_negative(plugin, "sun_scale", 1.0),
        _take_aperture(plugin, old_axes=old_axes),
    )
    plugin.ignore("complex_sun", "resolution")  # limb darkening, and the size of 0.6's map
    stretch = plugin.value_error("stretch", "other than 1 is not supported")
    if old_axes and plugin.take_float("stretch", 1.0) != 1.0:
        plugin.rules.refuse(stretch, f"{plugin}: stretch is not supported", "the sky is not stretched")
    if light.elevation < 0.0:
        up = "+y" if old_axes else "+z"
        black = f"the sun is below the horizon: the sky is black (its up is {up}, unless to_world turns it)"
        warnings.append(f"line {plugin.line}: {plugin}: {black}")
    pixels = sky.sky_map(light)
    size = f"{pixels.shape[1]}x{pixels.shape[0]}"
    warnings.append(f"line {plugin.line}: {plugin}: the model of {sky.MODEL} as an environment map of {size} pixels")
    return Environment(plugin.name, pixels, matrix @ sky.MAP_TO_MODEL)


def _take_direction(plugin: Plugin, to_world: np.ndarray) -> tuple[float, float, float]:
    """Towards the sun in the model's axes, from a direction in world space or from place and time."""
    given = [name for name in (*_PLACE, *_DATE, *_TIME) if plugin.has(name)]
    if plugin.has("sun_direction"):
        if given:
            raise plugin.value_error(given[0], "and sun_direction cannot both be given")
        error = plugin.value_error("sun_direction", "is zero")
        direction = np.array(plugin.take_point("sun_direction", (0.0, 0.0, 1.0)))
        if not np.linalg.norm(direction) > 0:
            raise error
        x, y, z = (float(axis) for axis in normalized((direction @ to_world[:3, :3])[None])[0])
        plugin.known_names.update((*_PLACE, *_DATE, *_TIME))
        return x, y, z
    plugin.known_names.add("sun_direction")
    latitude, longitude, timezone = (plugin.take_float(name, default) for name, default in _PLACE.items())
    year, month, day = (plugin.take_int(name, default) for name, default in _DATE.items())
    hour, minute, second = (plugin.take_float(name, default) for name, default in _TIME.items())
    return sky.sun_direction(latitude, longitude, timezone, (year, month, day), hour + minute / 60.0 + second / 3600.0)


def _take_turbidity(plugin: Plugin) -> float:
    error = plugin.value_error("turbidity", "must lie between 1 and 10")
    turbidity = plugin.take_float("turbidity", 3.0)
    if not 1.0 <= turbidity <= 10.0:
        raise error
    return turbidity


def _take_albedo(plugin: Plugin) -> RGB:
    error = plugin.value_error("albedo", "must lie between 0 and 1")
    albedo = plugin.take_colour("albedo", (0.3, 0.3, 0.3), emission=False)
    if not all(0.0 <= channel <= 1.0 for channel in albedo):
        raise error
    return albedo


def _take_aperture(plugin: Plugin, *, old_axes: bool) -> float:
    error = plugin.value_error("sun_aperture", "must lie between 0 and 90 degrees")
    aperture = plugin.take_float("sun_aperture", sky.SUN_APERTURE)
    if old_axes:
        aperture *= plugin.take_positive("sun_radius_scale", 1.0)
    if not 0.0 < aperture < 90.0:
        raise error
    return aperture


def _not_negative(plugin: Plugin, name: str, default: float) -> float:
    error = plugin.value_error(name, "must not be negative")
    value = plugin.take_float(name, default)
    if value < 0.0:
        raise error
    return value
