"""Mitsuba's sensor, film, sampler and integrator plugins as camera and settings."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wdpm.scenes.mitsuba.plugin import Plugin
from wdpm.scenes.mitsuba.rfilter import DEFAULT_FILTER, read_filter
from wdpm.scenes.model.scene import Camera, PixelFilter, horizontal_fov

Size = tuple[int, int]
DEFAULT_SIZE: Size = (768, 576)  # Mitsuba's
FILM_DIAGONAL = math.hypot(36.0, 24.0)  # mm, of the 35 mm film that focal lengths refer to
MOST_STOPS = 64.0
_FOV_AXES = ("x", "y", "diagonal", "smaller", "larger")

# what the written file looks like, which is --output's business here
_FILE_FORMAT_PARAMETERS = (
    "file_format",
    "pixel_format",
    "component_format",
    "banner",
    "attach_log",
    "gamma",
    "key",
    "burn",
    "variable",
    "digits",
    "channel_names",
)


@dataclass(frozen=True)
class _Film:
    """What a film says.

    Attributes:
        size: of the whole image.
        crop: x, y, width and height of the part that is rendered, or None.
        exposure: stops that pictures are to be shown with; None where it is to be found from the picture.
    """

    size: Size = DEFAULT_SIZE
    crop: tuple[int, int, int, int] | None = None
    filter: PixelFilter = DEFAULT_FILTER
    exposure: float | None = 0.0


def read_sensor(
    plugin: Plugin, size: Size | None, read_medium: Callable[[Plugin], int | None], warnings: list[str]
) -> tuple[Camera, int | None, float | None]:
    """A perspective, thin lens or orthographic sensor: camera, samples that it asks for, exposure of its pictures.

    Args:
        size: width and height that replace the film's; a crop window keeps its share of the image, in whole pixels.
        read_medium: reads the medium around a sensor.
    """
    nested = plugin.take_one("film")
    film = _Film(size or DEFAULT_SIZE) if nested is None else _read_film(nested, size, warnings)
    sampler = plugin.take_one("sampler")
    near, far = plugin.take_positive("near_clip", 1e-2), plugin.take_positive("far_clip", 1e4)
    if not near < far:
        raise plugin.error(f"{plugin}: near_clip ({near:g}) must be less than far_clip ({far:g})")
    orthographic = plugin.type == "orthographic"
    aperture, focus = _read_lens(plugin, far, warnings)
    width, height = film.size if film.crop is None else film.crop[2:]
    camera = Camera(
        _read_stretched(plugin) if orthographic else read_unscaled(plugin),
        90.0 if orthographic else read_fov(plugin, film.size[0] / film.size[1]),
        width,
        height,
        near,
        far,
        (0.0, 0.0) if plugin.type != "perspective" else _read_principal_point(plugin),
        film.filter,
        orthographic,
        aperture,
        focus,
        film.crop,
        None if film.crop is None else film.size,
        read_medium(plugin),
    )
    ignored = plugin.ignore("shutter_open", "shutter_close", "srf")
    warnings.extend(f"{plugin}: {name} is ignored: nothing moves, and all wavelengths count alike" for name in ignored)
    plugin.finish()
    return camera, None if sampler is None else _read_sampler(sampler), film.exposure


def _read_principal_point(plugin: Plugin) -> tuple[float, float]:
    # Mitsuba adds its offset to the position on the film, which moves the optical centre the other way
    return -plugin.take_float("principal_point_offset_x", 0.0), -plugin.take_float("principal_point_offset_y", 0.0)


def _read_lens(plugin: Plugin, far: float, warnings: list[str]) -> tuple[float, float]:
    """Radius of the aperture and distance of the plane in focus."""
    if plugin.type != "thinlens":
        ignored = plugin.ignore("focus_distance")
        warnings.extend(f"{plugin}: {name} is ignored: everything is in focus" for name in ignored)
        return 0.0, 1.0
    if not plugin.has("aperture_radius"):
        raise plugin.error(f'{plugin}: the parameter "aperture_radius" is missing')
    error = plugin.value_error("aperture_radius", "must not be negative")
    aperture = plugin.take_float("aperture_radius", 0.0)
    if aperture < 0.0:
        raise error
    return aperture, plugin.take_positive("focus_distance", far)


def _read_stretched(plugin: Plugin) -> np.ndarray:
    """The transform of an orthographic sensor, whose scale is the size of what it sees."""
    error = plugin.value_error("to_world", "must not shear or flatten a sensor")
    matrix = plugin.take_transform("to_world")
    if matrix is None:
        return np.eye(4)
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not lengths.min() > 0.0:
        raise error
    axes = matrix[:3, :3] / lengths
    if not np.allclose(axes.T @ axes, np.eye(3), atol=1e-3):
        raise error
    return matrix


def read_unscaled(plugin: Plugin) -> np.ndarray:
    error = plugin.value_error(
        "to_world", "must not scale " + ("an emitter" if plugin.category == "emitter" else "a sensor")
    )
    matrix = plugin.take_transform("to_world")
    if matrix is None:
        return np.eye(4)
    if not np.allclose(matrix[:3, :3].T @ matrix[:3, :3], np.eye(3), atol=1e-3):  # Mitsuba's own tolerance
        raise error
    return matrix


def read_fov(plugin: Plugin, aspect: float) -> float:
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


def _read_film(plugin: Plugin, size: Size | None, warnings: list[str]) -> _Film:
    # 0.6's film for tests has defaults of its own
    size_unless_said, default = ((1, 1), PixelFilter()) if plugin.type == "mfilm" else (DEFAULT_SIZE, DEFAULT_FILTER)
    own = _read_extent(plugin, "width", size_unless_said[0]), _read_extent(plugin, "height", size_unless_said[1])
    crop = _read_crop(plugin, own)
    if size is not None and crop is not None:
        crop = _scaled_crop(crop, own, size)
    plugin.ignore(*_FILE_FORMAT_PARAMETERS)
    ignored = plugin.ignore("sample_border", "high_quality_edges", "compensate")
    warnings.extend(f"{plugin}: {name} is ignored" for name in ignored)
    exposure = _read_exposure(plugin)
    nested = plugin.take_one("rfilter")
    plugin.finish()
    return _Film(size or own, crop, default if nested is None else read_filter(nested), exposure)


def _read_exposure(plugin: Plugin) -> float | None:
    """Of 0.6's `ldrfilm`; its other way, Reinhard's, finds an exposure from the picture."""
    error = plugin.value_error("exposure", f"must be stops between -{MOST_STOPS:g} and {MOST_STOPS:g}")
    stops = plugin.take_float("exposure", 0.0)
    if not abs(stops) <= MOST_STOPS:
        raise error
    method = plugin.take_choice("tonemap_method", "gamma", ("gamma", "reinhard"))
    return stops if method == "gamma" else None


def _read_crop(plugin: Plugin, size: Size) -> tuple[int, int, int, int] | None:
    """The crop window in pixels: x, y, width, height; None where it is the whole image."""
    if plugin.has("crop_window"):
        raise plugin.value_error("crop_window", "is not supported; give crop_offset_x, crop_width, ...")
    names = ("crop_offset_x", "crop_offset_y", "crop_width", "crop_height")
    first = next((name for name in names if plugin.has(name)), names[0])
    error = plugin.value_error(first, f"and the rest of the crop window must lie inside of {size[0]}x{size[1]} pixels")
    x, y = plugin.take_int("crop_offset_x", 0), plugin.take_int("crop_offset_y", 0)
    width, height = plugin.take_int("crop_width", size[0]), plugin.take_int("crop_height", size[1])
    if min(x, y) < 0 or min(width, height) < 1 or x + width > size[0] or y + height > size[1]:
        raise error
    return None if (x, y, width, height) == (0, 0, *size) else (x, y, width, height)


def _scaled_crop(crop: tuple[int, int, int, int], old: Size, new: Size) -> tuple[int, int, int, int]:
    """The same share of an image of another size, at least one pixel."""
    left, top = round(crop[0] * new[0] / old[0]), round(crop[1] * new[1] / old[1])
    right, bottom = round((crop[0] + crop[2]) * new[0] / old[0]), round((crop[1] + crop[3]) * new[1] / old[1])
    left, top = min(left, new[0] - 1), min(top, new[1] - 1)
    return left, top, max(right - left, 1), max(bottom - top, 1)


def _read_extent(plugin: Plugin, name: str, default: int) -> int:
    error = plugin.value_error(name, "must be at least 1")
    value = plugin.take_int(name, default)
    if value < 1:
        raise error
    return value


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
    if plugin.type in _WITH_NESTED or (plugin.replaced and plugin.nests("integrator")):
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
        plugin.rules.refuse(error, f"{plugin}: hide_emitters is not supported", "lights stay visible")
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
