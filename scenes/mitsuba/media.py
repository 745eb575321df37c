"""Mitsuba's medium and phase plugins as media, and which side of which shape they are on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.mitsuba.document import Element
from wdpm.scenes.mitsuba.plugin import Plugin
from wdpm.scenes.mitsuba.textures import take_plain
from wdpm.scenes.mitsuba.volumes import VolumeReader, mean_density, single_density
from wdpm.scenes.model.scene import Medium
from wdpm.scenes.model.textures import RGB
from wdpm.scenes.model.volumes import Volume

_SAME_PLACE = 1e-6  # of a mesh's size: vertices nearer than about this are one


@dataclass(frozen=True)
class Sides:
    """The media inside and outside of a shape, and whether it bounds any."""

    inside: int | None
    outside: int | None
    bounds: bool


class MediaReader:
    """Collects the media of a scene; each medium element becomes one, however often it is referred to.

    Args:
        old: whether the scene is for a version before Mitsuba 1.
    """

    def __init__(self, warnings: list[str], *, old: bool) -> None:
        self.media: list[Medium] = []
        self._volumes = VolumeReader(old=old)
        self._warnings = warnings
        self._by_element: dict[Element, int] = {}

    def read_around(self, plugin: Plugin) -> int | None:
        """The medium that an emitter or a sensor is in, or None."""
        return self._read(plugin.take_one("medium"))

    def read_sides(self, shape: Plugin) -> Sides:
        """The media on both sides of a shape."""
        inside, outside = shape.take_one("medium", "interior"), shape.take_one("medium", "exterior")
        return Sides(self._read(inside), self._read(outside), inside is not None or outside is not None)

    def warn_if_open(self, shape: Plugin, mesh: MeshData) -> None:
        """A warning for a shape that bounds media but is not closed: light may then enter without a boundary."""
        holes = open_edges(mesh)
        if holes:
            self._warnings.append(
                f"{shape.element.file.name}:{shape.line}: shape {shape.name} has a medium but is not closed "
                f"({holes} edges without a neighbour): what passes through the gaps ends up in the wrong medium"
            )

    def _read(self, plugin: Plugin | None) -> int | None:
        if plugin is None:
            return None
        if plugin.element not in self._by_element:
            self._by_element[plugin.element] = len(self.media)
            in_grid = plugin.has_nested("volume", "albedo", "gridvolume")
            heterogeneous = plugin.type == "heterogeneous" or in_grid
            self.media.append(
                _read_heterogeneous(plugin, self._volumes) if heterogeneous else _read_homogeneous(plugin)
            )
        return self._by_element[plugin.element]


def _read_heterogeneous(plugin: Plugin, volumes: VolumeReader) -> Medium:
    scale = _take_scale(plugin)
    name = "density" if plugin.has("density") or plugin.has_nested("volume", "density") else "sigma_t"
    density, sigma_t = _read_density(plugin, name, volumes)
    albedo_volume, albedo = _read_albedo(plugin, volumes)
    g = _read_phase(plugin)
    plugin.ignore("sample_emitters", "has_spectral_extinction", "method", "step_size")  # how Mitsuba samples
    plugin.finish()
    red, green, blue = (scale * channel for channel in sigma_t)
    return Medium(plugin.name, (red, green, blue), albedo, g, density, albedo_volume)


def _read_density(plugin: Plugin, name: str, volumes: VolumeReader) -> tuple[Volume | None, RGB]:
    """The density of a heterogeneous medium, and its extinction where that is 1."""
    grid = plugin.take_one("volume", name)
    if grid is None or grid.type != "gridvolume":
        return None, _value_of(plugin, name, 1.0, grid)
    error = grid.error(f'{grid}: a "{name}" whose hue differs from voxel to voxel is not supported; give one channel')
    density = volumes.read(grid, np.inf)
    if density.values.shape[3] == 1:
        return density, (1.0, 1.0, 1.0)
    single = single_density(density)
    if single is None:
        what = f'{grid}: a "{name}" whose hue differs from voxel to voxel is not supported'
        plugin.rules.refuse(error, what, "the mean of its channels is taken")
        return mean_density(density)
    return single


def _read_albedo(plugin: Plugin, volumes: VolumeReader) -> tuple[Volume | None, RGB]:
    """The albedo, and the largest of each channel."""
    grid = plugin.take_one("volume", "albedo")
    if grid is None or grid.type != "gridvolume":
        error = plugin.value_error("albedo", "must lie between 0 and 1")
        value = _value_of(plugin, "albedo", 0.75, grid)
        if max(value) > 1.0:
            raise error
        return None, value
    albedo = volumes.read(grid, 1.0)
    peak = albedo.values.max(axis=(0, 1, 2))
    return albedo, _rgb(np.broadcast_to(peak, 3).astype(np.float64))


def _take_scale(plugin: Plugin) -> float:
    error = plugin.value_error("scale", "must not be negative")
    scale = plugin.take_float("scale", 1.0)
    if scale < 0.0:
        raise error
    return scale


def _read_homogeneous(plugin: Plugin) -> Medium:
    if plugin.has("material"):
        raise plugin.value_error("material", "presets are not supported; give sigma_t and albedo")
    scale = _take_scale(plugin)
    sigma_t, albedo = _read_coefficients(plugin)
    # 0.6 let g stand in the medium
    g = _take_g(plugin, 0.0) if plugin.has("g") else _read_phase(plugin)
    plugin.ignore("sample_emitters", "has_spectral_extinction")  # how Mitsuba samples, not what there is
    plugin.finish()
    red, green, blue = (scale * channel for channel in sigma_t)
    return Medium(plugin.name, (red, green, blue), albedo, g)


def _read_coefficients(plugin: Plugin) -> tuple[RGB, RGB]:
    """Extinction and albedo from either pair of parameters: Mitsuba 3's, or 0.6's sigma_s and sigma_a."""
    if plugin.has("sigma_s") or plugin.has("sigma_a"):
        for name in ("sigma_t", "albedo"):
            if plugin.has(name):
                raise plugin.value_error(name, "cannot be given beside sigma_s or sigma_a")
        scattering = _read_value(plugin, "sigma_s", 0.0)
        absorption = _read_value(plugin, "sigma_a", 0.0)
        sigma_t = np.array(scattering) + absorption
        albedo = np.divide(scattering, sigma_t, out=np.zeros(3), where=sigma_t > 0)
        return _rgb(sigma_t), _rgb(albedo)
    error = plugin.value_error("albedo", "must lie between 0 and 1")
    value = _read_value(plugin, "albedo", 0.75)
    if max(value) > 1.0:
        raise error
    return _read_value(plugin, "sigma_t", 1.0), value


def _rgb(values: NDArray[np.float64]) -> RGB:
    return float(values[0]), float(values[1]), float(values[2])


def _read_value(plugin: Plugin, name: str, default: float) -> RGB:
    """A colour that is not negative, given directly or as a constant volume."""
    return _value_of(plugin, name, default, plugin.take_one("volume", name))


def _value_of(plugin: Plugin, name: str, default: float, volume: Plugin | None) -> RGB:
    """As _read_value, where the volume has been taken."""
    if volume is not None and volume.type != "constvolume":
        raise volume.error(f'{volume} as "{name}" of a {plugin.type} medium is not supported; give a constvolume')
    if volume is not None and plugin.has(name):
        raise plugin.value_error(name, "is given twice: as a value and as a volume")
    owner, parameter = (plugin, name) if volume is None else (volume, "value")
    value = take_plain(owner, parameter, (default, default, default), emission=False)
    if volume is not None:
        volume.ignore("to_world")
        volume.finish()
    return value


def _read_phase(plugin: Plugin) -> float:
    """The mean cosine of the phase function."""
    phase = plugin.take_one("phase")
    if phase is None or phase.type == "isotropic":
        g = 0.0
    else:
        g = _take_g(phase, 0.8)
    if phase is not None:
        phase.finish()
    return g


def _take_g(plugin: Plugin, default: float) -> float:
    at = plugin.at("g")
    g = plugin.take_float("g", default)
    if not -1.0 < g < 1.0:
        raise at.error(f'{plugin}: "g" must lie between -1 and 1, got {g:g}')
    return g


def open_edges(mesh: MeshData) -> int:
    """How many edges of a mesh have no neighbour that runs the other way; 0 where it is closed.

    Vertices at the same place count as one, whatever their normals and texture coordinates.
    """
    if len(mesh.faces) == 0:
        return 0
    used = mesh.vertices[mesh.faces.reshape(-1)]
    size = float(np.ptp(used, axis=0).max())
    grid = np.round((mesh.vertices - used.min(axis=0)) / (_SAME_PLACE * size if size > 0 else 1.0))
    _, place = np.unique(grid, axis=0, return_inverse=True)
    faces = place.reshape(-1)[mesh.faces]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    starts, ends = faces.reshape(-1), faces[:, [1, 2, 0]].reshape(-1)
    count = len(mesh.vertices) + 1
    edges, forwards = np.unique(starts * count + ends, return_counts=True)
    back_edges, backwards = np.unique(ends * count + starts, return_counts=True)
    there = np.isin(edges, back_edges)
    matched = forwards[there] - backwards[np.searchsorted(back_edges, edges[there])]
    return int(forwards[~there].sum() + np.maximum(matched, 0).sum())
