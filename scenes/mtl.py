"""Reads the material libraries of OBJ files (MTL), as far as diffuse surfaces and lamps go.

Format: "MTL material format", Wavefront 1995. Kd, map_Kd and Ke are used; what asks for more than that is approximated
by the diffuse part, and said in a warning.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from wdpm.scenes.errors import SceneError
from wdpm.scenes.images import read_texture
from wdpm.scenes.model import RGB, Bitmap, Material

DIFFUSE_ILLUM = 2  # illumination models 0 to 2 are local; those above reflect, refract or cast no shadows


@dataclass(eq=False)
class MtlMaterial:
    """One `newmtl`: its diffuse part and what it emits."""

    material: Material
    emission: RGB | None


@dataclass(eq=False)
class _Entry:
    name: str
    line: int
    values: dict[str, tuple[int, list[str]]] = field(default_factory=dict)  # keyword: line, words


def read_mtl(file: Path, warnings: list[str]) -> Mapping[str, MtlMaterial]:
    """The materials of a library by name.

    Args:
        warnings: what is approximated or missing is appended here.

    Raises:
        SceneError: a colour that is not made of numbers, a texture that cannot be read.
    """
    entries = _read_entries(file)
    textures: dict[Path, Bitmap] = {}
    return {entry.name: _Converter(entry, file, warnings, textures).convert() for entry in entries}


def _read_entries(file: Path) -> list[_Entry]:
    entries: list[_Entry] = []
    for number, line in enumerate(file.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if words[0] == "newmtl":
            entries.append(_Entry(" ".join(words[1:]), number))
        elif entries:
            entries[-1].values[words[0]] = number, words[1:]
        else:
            raise SceneError(f'"{words[0]}" stands before the first "newmtl"', file, number)
    return entries


class _Converter:
    def __init__(self, entry: _Entry, file: Path, warnings: list[str], textures: dict[Path, Bitmap]) -> None:
        self.entry = entry
        self.file = file
        self.warnings = warnings
        self.textures = textures

    def convert(self) -> MtlMaterial:
        colour = self._reflectance()
        emission = self._colour("Ke", (0.0, 0.0, 0.0))
        beyond = self._beyond_diffuse()
        if beyond:
            self._warn(f"{', '.join(beyond)}: approximated by its diffuse part")
        bitmap = self._texture(colour)
        material = Material(self.entry.name, colour if bitmap is None else bitmap, twosided=True)
        return MtlMaterial(material, emission if max(emission) > 0 else None)

    def _warn(self, message: str) -> None:
        self.warnings.append(f'{self.file.name}:{self.entry.line}: material "{self.entry.name}": {message}')

    def _colour(self, keyword: str, default: RGB) -> RGB:
        if keyword not in self.entry.values:
            return default
        line, words = self.entry.values[keyword]
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) == 1:  # the other two are then the same
            values *= 3
        if len(values) != 3 or not all(math.isfinite(value) and value >= 0 for value in values):
            shown = " ".join(words)
            raise SceneError(
                f'"{keyword}" must be 1 or 3 numbers that are not negative, got "{shown}"', self.file, line
            )
        return values[0], values[1], values[2]

    def _reflectance(self) -> RGB:
        colour = self._colour("Kd", (0.5, 0.5, 0.5))
        if max(colour) > 1:
            self._warn("Kd is above 1: lowered to 1")
        return min(colour[0], 1.0), min(colour[1], 1.0), min(colour[2], 1.0)

    def _texture(self, colour: RGB) -> Bitmap | None:
        if "map_Kd" not in self.entry.values:
            return None
        line, words = self.entry.values["map_Kd"]
        file = self._texture_file(words)
        if file is None:
            self._warn(f'texture "{" ".join(words)}" (line {line}) not found: Kd is used instead')
            return None
        if file not in self.textures:
            self.textures[file] = Bitmap(file.name, read_texture(file, raw=False))
        bitmap = self.textures[file]
        # Kd tints the map; many exporters write black there when they mean the map alone
        if colour in ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)):
            return bitmap
        return Bitmap(bitmap.name, bitmap.pixels * np.array(colour, dtype=np.float32))

    def _texture_file(self, words: list[str]) -> Path | None:
        """The file behind options such as "-s 2 2"; names may hold blanks and a foreign system's separators."""
        for begin in range(len(words)):
            file = self.file.parent / " ".join(words[begin:]).replace("\\", "/")
            if file.is_file():
                if begin:
                    self._warn(f'options "{" ".join(words[:begin])}" of map_Kd are ignored')
                return file
        return None

    def _beyond_diffuse(self) -> list[str]:
        values = self.entry.values
        looks = [key for key in ("Ks", "Tf", "Ns", "Ni", "d", "Tr", "illum") if key in values and self._matters(key)]
        found = [f"{key} {' '.join(values[key][1])}" for key in looks]
        maps = sorted(
            key for key in self.entry.values if key.lower().startswith(("map_", "bump", "norm", "disp", "refl"))
        )
        return found + [key for key in maps if key != "map_Kd"]

    def _matters(self, keyword: str) -> bool:
        try:
            values = [float(word) for word in self.entry.values[keyword][1]]
        except ValueError:
            return True
        match keyword:
            case "Ks":
                return max(values, default=0.0) > 0
            case "Ns" | "Ni" | "Tf":
                return self._is_specular()  # they describe the highlight and the refraction, which must be there first
            case "d":
                return values != [1.0]
            case "Tr":
                return values != [0.0]
        return values[:1] > [DIFFUSE_ILLUM]

    def _is_specular(self) -> bool:
        return any(key in self.entry.values and self._matters(key) for key in ("Ks", "illum", "d"))
