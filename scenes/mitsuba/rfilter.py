"""Mitsuba's reconstruction filters: all six, with their parameters and defaults."""

from __future__ import annotations

from wdpm.scenes.mitsuba.plugin import Plugin
from wdpm.scenes.model.scene import LARGEST_FILTER, FilterKind, PixelFilter


def _gaussian(stddev: float) -> PixelFilter:
    return PixelFilter(FilterKind.GAUSSIAN, 4.0 * stddev, stddev)  # cut off at four deviations, as in Mitsuba


DEFAULT_FILTER = _gaussian(0.5)


def read_filter(plugin: Plugin) -> PixelFilter:
    """The filter of an `rfilter` plugin; SceneError for parameters that it does not have, or out of range."""
    too_wide = plugin.error(f"{plugin}: it reaches further than {LARGEST_FILTER:g} pixels; expected a narrower one")
    match plugin.type:
        case "box":
            found = PixelFilter(FilterKind.BOX, plugin.take_positive("radius", 0.5))  # 0.6's parameter
        case "gaussian":
            found = _gaussian(plugin.take_positive("stddev", 0.5))
        case "tent":
            found = PixelFilter(FilterKind.TENT, plugin.take_positive("radius", 1.0))
        case "mitchell":
            found = PixelFilter(FilterKind.MITCHELL, 2.0, b=_share(plugin, "b"), c=_share(plugin, "c"))
        case "catmullrom":
            found = PixelFilter(FilterKind.MITCHELL, 2.0, b=0.0, c=0.5)
        case "lanczos":
            found = PixelFilter(FilterKind.LANCZOS, float(_lobes(plugin)))
        case _:
            raise AssertionError(plugin.type)  # the table of supported plugins and this match disagree
    if found.radius > LARGEST_FILTER:
        raise too_wide
    plugin.finish()
    return found


def _share(plugin: Plugin, name: str) -> float:
    error = plugin.value_error(name, "must lie between 0 and 1")
    value = plugin.take_float(name, 1.0 / 3.0)
    if not 0.0 <= value <= 1.0:
        raise error
    return value


def _lobes(plugin: Plugin) -> int:
    error = plugin.value_error("lobes", "must be at least 1")
    lobes = plugin.take_int("lobes", 3)
    if lobes < 1:
        raise error
    return lobes
