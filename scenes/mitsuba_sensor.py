"""Mitsuba's sensor, film, sampler and integrator plugins as camera and settings."""

from __future__ import annotations

import math

import numpy as np

from wdpm.scenes.mitsuba_params import Plugin
from wdpm.scenes.model import Camera, FilterKind, PixelFilter

Size = tuple[int, int]
DEFAULT_SIZE: Size = (768, 576)  # Mitsuba's
FILM_DIAGONAL = math.hypot(36.0, 24.0)  # mm, of the 35 mm film that focal lengths refer to
_FOV_AXES = ("x", "y", "diagonal", "smaller", "larger")

# what the written file looks like, which is --output's business here
_FILE_FORMAT_PARAMETERS = (
    "file_format",
    "pixel_format",
    "component_format",
    "banner",
    "attach_log",
    "gamma",
    "exposure",
    "tonemap_method",
    "key",
    "burn",
    "variable",
    "digits",
    "channel_names",
)


def read_sensor(plugin: Plugin, size: Size | None, warnings: list[str]) -> tuple[Camera, int | None]:
    """A perspective sensor as camera, with the number of samples it asks for.

    Args:
        size: width and height that replace the film's.
    """
    film = plugin.take_one("film")
    (width, height), pixel_filter = (
        (size or DEFAULT_SIZE, _gaussian(0.5)) if film is None else _read_film(film, size, warnings)
    )
    sampler = plugin.take_one("sampler")
    fov = _read_fov(plugin, width / height)
    near, far = plugin.take_positive("near_clip", 1e-2), plugin.take_positive("far_clip", 1e4)
    if not near < far:
        raise plugin.error(f"{plugin}: near_clip ({near:g}) must be less than far_clip ({far:g})")
    # Mitsuba adds its offset to the position on the film, which moves the optical centre the other way
    offset = -plugin.take_float("principal_point_offset_x", 0.0), -plugin.take_float("principal_point_offset_y", 0.0)
    ignored = plugin.ignore("shutter_open", "shutter_close", "focus_distance", "srf")
    warnings.extend(f"{plugin}: {name} is ignored: nothing moves, and everything is in focus" for name in ignored)
    camera = Camera(_read_to_world(plugin), fov, width, height, near, far, offset, pixel_filter)
    plugin.finish()
    return camera, None if sampler is None else _read_sampler(sampler)


def _read_to_world(plugin: Plugin) -> np.ndarray:
    error = plugin.value_error("to_world", "must not scale a sensor")
    matrix = plugin.take_transform("to_world")
    if matrix is None:
        return np.eye(4)
    if not np.allclose(matrix[:3, :3].T @ matrix[:3, :3], np.eye(3), atol=1e-3):  # Mitsuba's own tolerance
        raise error
    return matrix


def _read_fov(plugin: Plugin, aspect: float) -> float:
    """The horizontal field of view in degrees."""
    axis = plugin.take_choice("fov_axis", "x", _FOV_AXES)
    if plugin.has("fov") and plugin.has("focal_length"):
        raise plugin.value_error("focal_length", "and fov cannot both be given")
    if plugin.has("fov"):
        error = plugin.value_error("fov", "must lie between 0 and 180 degrees")
        fov = plugin.take_float("fov", 0.0)
        if not 0 < fov < 180:
            raise error
        plugin.known_names.add("focal_length")
        return horizontal_fov(fov, axis, aspect)
    plugin.known_names.add("fov")
    error = plugin.value_error("focal_length", 'must be a length in millimetres such as "50mm"')
    text = plugin.take_string("focal_length", "50mm").removesuffix("mm")
    try:
        length = float(text)
    except ValueError:
        raise error from None
    if not (length > 0 and math.isfinite(length)):
        raise error
    return horizontal_fov(math.degrees(2.0 * math.atan(FILM_DIAGONAL / (2.0 * length))), "diagonal", aspect)


def horizontal_fov(fov: float, axis: str, aspect: float) -> float:
    """Converts a full field of view to the horizontal one; both in degrees.

    Args:
        axis: "x", "y", "diagonal", "smaller" or "larger": what `fov` refers to.
        aspect: width / height.
    """
    if axis == "smaller":
        axis = "y" if aspect > 1 else "x"
    elif axis == "larger":
        axis = "x" if aspect > 1 else "y"
    half = math.tan(math.radians(fov) / 2.0)
    if axis == "y":
        half *= aspect
    elif axis == "diagonal":
        half *= aspect / math.hypot(aspect, 1.0)
    return math.degrees(2.0 * math.atan(half))


def _read_film(plugin: Plugin, size: Size | None, warnings: list[str]) -> tuple[Size, PixelFilter]:
    width, height = _read_extent(plugin, "width", DEFAULT_SIZE[0]), _read_extent(plugin, "height", DEFAULT_SIZE[1])
    for name in ("crop_offset_x", "crop_offset_y", "crop_width", "crop_height", "crop_window"):
        if plugin.has(name):
            raise plugin.value_error(
                name, "is not supported yet: crop windows come later; remove it to render the whole image"
            )
    plugin.ignore(*_FILE_FORMAT_PARAMETERS)
    ignored = plugin.ignore("sample_border", "high_quality_edges", "compensate")
    warnings.extend(f"{plugin}: {name} is ignored" for name in ignored)
    pixel_filter = plugin.take_one("rfilter")
    plugin.finish()
    return size or (width, height), _gaussian(0.5) if pixel_filter is None else _read_filter(pixel_filter)


def _read_extent(plugin: Plugin, name: str, default: int) -> int:
    error = plugin.value_error(name, "must be at least 1")
    value = plugin.take_int(name, default)
    if value < 1:
        raise error
    return value


def _read_filter(plugin: Plugin) -> PixelFilter:
    if plugin.type == "box":
        error = plugin.value_error("radius", "other than 0.5 is not supported for the box filter")
        if plugin.take_float("radius", 0.5) != 0.5:
            raise error
        pixel_filter = PixelFilter()
    else:
        pixel_filter = _gaussian(plugin.take_positive("stddev", 0.5))
    plugin.finish()
    return pixel_filter


def _gaussian(stddev: float) -> PixelFilter:
    return PixelFilter(FilterKind.GAUSSIAN, 4.0 * stddev, stddev)  # cut off at four deviations, as in Mitsuba


def _read_sampler(plugin: Plugin) -> int:
    error = plugin.value_error("sample_count", "must be at least 1")
    samples = plugin.take_int("sample_count", 4)
    if samples < 1:
        raise error
    plugin.ignore("seed", "scramble", "jitter", "dimension", "randomize")
    plugin.finish()
    return samples


_WITH_NESTED = ("aov", "moment", "adaptive", "irrcache", "batch")
_DIRECT_ONLY = ("direct", "direct_projective")


def read_integrator(plugin: Plugin, warnings: list[str]) -> int | None:
    """The longest light path in edges that an integrator asks for; None for no limit."""
    if plugin.type in _WITH_NESTED:
        nested = plugin.take_nested("integrator")
        ignored = plugin.ignore_values()
        plugin.finish()
        warnings.append(f"{plugin} is ignored{_listed(ignored)}; wdpm renders by photon mapping")
        if len(nested) != 1:
            raise plugin.error(f"{plugin}: expected one nested integrator, got {len(nested)}")
        return read_integrator(nested[0], warnings)
    depth = 2 if plugin.type in _DIRECT_ONLY else _read_depth(plugin)
    error = plugin.value_error("hide_emitters", "true is not supported: lights are visible")
    if plugin.take_bool("hide_emitters", False):
        raise error
    plugin.ignore("rr_depth")  # Russian roulette changes no expected value
    if plugin.type != "path":
        ignored = plugin.ignore_values()
        warnings.append(f"{plugin}: only its max_depth is used{_listed(ignored)}; wdpm renders by photon mapping")
    plugin.ignore("strict_normals")
    plugin.finish()
    return depth


def _read_depth(plugin: Plugin) -> int | None:
    error = plugin.value_error("max_depth", "must be -1 (no limit) or at least 1")
    depth = plugin.take_int("max_depth", -1)
    if depth != -1 and depth < 1:
        raise error
    return None if depth == -1 else depth


def _listed(names: list[str]) -> str:
    return f" ({', '.join(names)} ignored)" if names else ""
