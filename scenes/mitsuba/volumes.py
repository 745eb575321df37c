"""Mitsuba's grid volumes, and what media may be given by them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.mitsuba.plugin import Plugin
from wdpm.scenes.model.textures import RGB, Wrap
from wdpm.scenes.model.transforms import Matrix
from wdpm.scenes.model.volumes import Volume
from wdpm.scenes.volume_files.read import read_voxels
from wdpm.scenes.volume_files.vol import Voxels

_TRACE = 1e-4
"""Largest share of the largest voxel that one may be below 0 by: what a simulation's roundings leave."""

_LEAST = 1e-30
"""What is less than this is 0 whatever else there is: channels of nothing but roundings."""

_SAME_COLOR = 1e-5
"""Largest difference between voxels of one hue, as a share of the largest: a few roundings of float32."""


class VolumeReader:
    """Reads grid volumes; a file is read once.

    Args:
        old: whether the scene is for a version before Mitsuba 1, which had other boxes and lattices.
    """

    def __init__(self, *, old: bool) -> None:
        self._old = old
        self._voxels: dict[Path, Voxels] = {}

    def read(self, plugin: Plugin, most: float) -> Volume:
        """The volume that a plugin describes.

        Args:
            most: the largest value that a voxel may have; none may be negative.

        Raises:
            SceneError: with file and line.
        """
        at = plugin.at("filename")
        file = plugin.take_file().resolve()
        to_world = plugin.take_transform("to_world")
        nearest = plugin.take_choice("filter_type", "trilinear", ["trilinear", "nearest"]) == "nearest"
        wrap = Wrap(plugin.take_choice("wrap_mode", "clamp", [mode.value for mode in Wrap]))
        by_file = plugin.take_bool("use_grid_bbox", False) or self._old
        box = _take_box(plugin)
        plugin.ignore("raw", "accel", "send_data")  # spectra, speed, and how 0.6 tells its slaves
        plugin.finish()
        try:
            if file not in self._voxels:
                self._voxels[file] = read_voxels(file)
            voxels = self._voxels[file]
            values = _without_negatives(voxels.values, plugin, file)
            _check(values, most)
        except ValueError as error:
            raise at.error(f"{plugin}: {file.name}: {error}") from error
        placed = np.eye(4) if to_world is None else to_world
        if box is not None or by_file:
            low, high = box or (voxels.low, voxels.high)
            placed = placed @ _box_matrix(low, high)
        if not abs(np.linalg.det(placed)) > 0.0:
            raise at.error(f"{plugin}: {file.name}: its box has no volume; look at to_world and its bounding box")
        corners = self._old and min(values.shape[:3]) > 1
        return Volume(file.name, values, placed, nearest, corners, wrap)


def single_density(volume: Volume) -> tuple[Volume, RGB] | None:
    """A volume of colours as one of numbers, at most 1, times a colour; None where hues differ from voxel to voxel."""
    values = volume.values
    peak = values.max(axis=(0, 1, 2))
    strongest = int(np.argmax(peak))
    density = values[..., strongest : strongest + 1] / peak[strongest] if peak[strongest] > 0 else values[..., :1]
    if not bool(np.all(np.abs(density * peak - values) <= _SAME_COLOR * peak[strongest])):
        return None
    color = tuple(float(peak[channel % len(peak)]) for channel in range(3))
    single = Volume(volume.name, density, volume.to_world, volume.nearest, volume.at_corners, volume.wrap)
    return single, (color[0], color[1], color[2])


def mean_density(volume: Volume) -> tuple[Volume, RGB]:
    """A volume of colours as one of numbers, at most 1, times a grey: the mean of its channels."""
    mean = volume.values.mean(axis=3, keepdims=True)
    peak = float(mean.max()) or 1.0
    single = Volume(volume.name, mean / peak, volume.to_world, volume.nearest, volume.at_corners, volume.wrap)
    return single, (peak, peak, peak)


def _take_box(plugin: Plugin) -> tuple[tuple[float, float, float], tuple[float, float, float]] | None:
    """The box that 0.6's `min` and `max` give in place of the file's."""
    if not (plugin.has("min") and plugin.has("max")):
        return None
    return plugin.take_point("min", (0.0, 0.0, 0.0)), plugin.take_point("max", (1.0, 1.0, 1.0))


def _box_matrix(low: tuple[float, float, float], high: tuple[float, float, float]) -> Matrix:
    """Takes the unit cube to a box."""
    matrix = np.diag([*np.subtract(high, low), 1.0])
    matrix[:3, 3] = low
    return matrix


def _without_negatives(values: NDArray[np.float32], plugin: Plugin, file: Path) -> NDArray[np.float32]:
    """Voxels that are negative by a trace as 0, with a warning; for a lenient reader all that are negative."""
    negative = values < 0.0
    if not negative.any():
        return values
    count = f"{int(negative.any(axis=3).sum()):,} negative voxels"
    if values.min() >= -max(_TRACE * float(values.max(initial=0.0)), _LEAST):
        plugin.rules.tell(plugin.line, f"{plugin}: {file.name}: {count}, all but 0: they are taken as 0")
    elif plugin.rules.lenient:
        error = plugin.error(count)
        plugin.rules.refuse(error, f"{plugin}: {file.name}: {count}, down to {values.min():g}", "they are taken as 0")
    else:
        return values
    return np.where(negative, np.float32(0.0), values)


def _check(values: NDArray[np.float32], most: float) -> None:
    """Raise ValueError, which names the first voxel that is none."""
    wrong = ~(np.isfinite(values) & (values >= 0.0) & (values <= most)).all(axis=3)
    if wrong.any():
        z, y, x = (int(each) for each in np.unravel_index(int(np.argmax(wrong)), wrong.shape))
        shown = " ".join(f"{value:g}" for value in values[z, y, x])
        allowed = f"from 0 to {most:g}" if np.isfinite(most) else "finite, and not negative"
        raise ValueError(f"voxel x={x} y={y} z={z} is {shown}; expected {allowed} ({int(wrong.sum()):,} such voxels)")
