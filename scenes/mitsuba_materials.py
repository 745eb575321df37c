"""Mitsuba's bsdf and texture plugins as materials."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes import transforms
from wdpm.scenes.images import read_texture
from wdpm.scenes.mitsuba_params import Plugin
from wdpm.scenes.model import RGB, Bitmap, Interpolation, Material, Wrap
from wdpm.scenes.xml_document import Element

GREY: RGB = (0.5, 0.5, 0.5)  # Mitsuba's default reflectance
BLACK: RGB = (0.0, 0.0, 0.0)


class MaterialReader:
    """Collects the materials of a scene; each bsdf element becomes one, however many shapes refer to it."""

    def __init__(self, warnings: list[str]) -> None:
        self.materials: list[Material] = []
        self._warnings = warnings
        self._by_element: dict[Element, int] = {}
        self._defaults: dict[bool, int] = {}
        self._bitmaps: dict[tuple[object, ...], Bitmap] = {}
        self._pixels: dict[tuple[Path, bool], NDArray[np.float32]] = {}

    def read(self, plugin: Plugin | None, *, emits: bool) -> int:
        """The number of the material of a bsdf; of Mitsuba's default if there is none (black on lights)."""
        if plugin is None:
            if emits not in self._defaults:
                self._defaults[emits] = self._add(Material("default", BLACK if emits else GREY))
            return self._defaults[emits]
        if plugin.element not in self._by_element:
            self._by_element[plugin.element] = self._add(self._read_bsdf(plugin))
        return self._by_element[plugin.element]

    def _add(self, material: Material) -> int:
        self.materials.append(material)
        return len(self.materials) - 1

    def _read_bsdf(self, plugin: Plugin) -> Material:
        if plugin.type == "diffuse":
            return self._read_diffuse(plugin, plugin.name, twosided=False)
        nested = plugin.take_nested("bsdf")
        if len(nested) != 1:
            raise plugin.error(f"{plugin}: expected one nested bsdf for both sides, got {len(nested)}")
        plugin.finish()
        inner = nested[0]
        if inner.type != "diffuse":
            raise inner.error(f'{plugin}: the nested bsdf must be "diffuse", got "{inner.type}"')
        return self._read_diffuse(inner, plugin.name, twosided=True)

    def _read_diffuse(self, plugin: Plugin, name: str, *, twosided: bool) -> Material:
        parameter = "reflectance"
        texture = plugin.take_one("texture", parameter)
        if plugin.has("diffuse_reflectance"):  # 0.6 knows both names
            parameter = "diffuse_reflectance"
        if texture is not None:
            reflectance: RGB | Bitmap = self._read_bitmap(texture)
        else:
            at = plugin.value_error(parameter, "")
            reflectance = plugin.take_colour(parameter, GREY, emission=False)
            if not all(0.0 <= channel <= 1.0 for channel in reflectance):
                shown = " ".join(f"{channel:g}" for channel in reflectance)
                raise type(at)(f'{plugin}: "{parameter}" must lie between 0 and 1, got {shown}', at.file, at.line)
        plugin.finish()
        return Material(name, reflectance, twosided)

    def _read_bitmap(self, plugin: Plugin) -> Bitmap:
        file = plugin.take_file().resolve()
        raw = plugin.take_bool("raw", False)
        wrap = Wrap(plugin.take_choice("wrap_mode", "repeat", [mode.value for mode in Wrap]))
        interpolation = self._read_filter(plugin)
        to_uv = _read_to_uv(plugin)
        self._check_gamma(plugin)
        plugin.ignore("cache", "max_anisotropy", "accel", "format")  # change speed and memory only
        plugin.finish()
        key = file, raw, wrap, interpolation, to_uv.tobytes()
        if key not in self._bitmaps:
            if (file, raw) not in self._pixels:
                self._pixels[file, raw] = read_texture(file, raw=raw)
            self._bitmaps[key] = Bitmap(file.name, self._pixels[file, raw], wrap, interpolation, to_uv)
        return self._bitmaps[key]

    def _read_filter(self, plugin: Plugin) -> Interpolation:
        name = plugin.take_choice("filter_type", "bilinear", ["bilinear", "nearest", "trilinear", "ewa"])
        if name in ("trilinear", "ewa"):  # 0.6
            self._warnings.append(f'texture {plugin.name}: filter "{name}" is replaced by "bilinear"')
            return Interpolation.BILINEAR
        return Interpolation(name)

    @staticmethod
    def _check_gamma(plugin: Plugin) -> None:
        error = plugin.value_error(
            "gamma", "other than -1 (by the file's type) is not supported; use raw for linear data"
        )
        if plugin.take_float("gamma", -1.0) != -1.0:
            raise error


def _read_to_uv(plugin: Plugin) -> NDArray[np.float64]:
    """Mitsuba's map of texture coordinates, followed by turning v upwards: its images begin at the top with v = 0."""
    given = plugin.take_transform("to_uv")
    matrix = np.eye(4) if given is None else given
    scale = [plugin.take_float("uscale", 1.0), plugin.take_float("vscale", 1.0), 1.0]  # 0.6
    offset = [plugin.take_float("uoffset", 0.0), plugin.take_float("voffset", 0.0), 0.0]
    matrix = transforms.translation(offset) @ transforms.scaling(scale) @ matrix
    planar = np.eye(3)
    planar[:2, :2] = matrix[:2, :2]
    planar[:2, 2] = matrix[:2, 3]
    upwards = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])
    return upwards @ planar
