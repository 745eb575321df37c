"""Reads the material libraries of OBJ files (MTL).

Format: "MTL material format", Wavefront 1995, with the statements that later became usual: Ke, map_Ke, norm, and those
of physically based materials. What the statements stand for is said in mtl_looks.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from wdpm.scenes.errors import SceneError
from wdpm.scenes.images.read import read_alpha, read_texture
from wdpm.scenes.meshes.mtl_looks import ILLUM_MODELS, Looks, Pbr, scattering
from wdpm.scenes.meshes.mtl_textures import TextureStatement, read_statement
from wdpm.scenes.model.bsdfs import BLACK, WHITE
from wdpm.scenes.model.scene import Material
from wdpm.scenes.model.textures import RGB, Bitmap, Color, Number
from wdpm.scenes.scene_root import check_within

# neither do these change how light is scattered
_IGNORED: Final = frozenset(("Ka", "map_Ka", "sharpness", "map_aat"))
_BUMP: Final = ("bump", "map_bump", "map_Bump")
_NORMAL: Final = ("norm", "map_Kn", "map_norm")
# fmt: off
_KNOWN: Final = frozenset((
    "Kd", "Ks", "Ke", "Ns", "Ni", "Tf", "d", "Tr", "illum", "map_Kd", "map_Ke", "map_d", "map_opacity",
    "Pr", "Pm", "Ps", "Pc", "Pcr", "map_Pr", "map_Pm", *_BUMP, *_NORMAL,
))
# fmt: on


@dataclass(eq=False)
class MtlMaterial:
    """One `newmtl`: how it scatters light and what it emits."""

    material: Material
    emission: Color | None


@dataclass(eq=False)
class _Entry:
    name: str
    line: int
    values: dict[str, tuple[int, list[str]]] = field(default_factory=dict)  # keyword: line, words


def read_mtl(file: Path, warnings: list[str]) -> Mapping[str, MtlMaterial]:
    """The materials of a library by name.

    Args:
        warnings: what is approximated, unknown or missing is appended here, with file and line.

    Raises:
        SceneError: a colour that is not made of numbers, a texture that cannot be read.
    """
    entries = _read_entries(file)
    textures: dict[tuple[Path, bool], Bitmap] = {}
    return {entry.name: _Converter(entry, file, warnings, textures).convert() for entry in entries}


def _read_entries(file: Path) -> list[_Entry]:
    check_within(file)
    entries: list[_Entry] = []
    for number, line in enumerate(file.read_text(encoding="utf-8-sig", errors="replace").splitlines(), start=1):
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
    def __init__(
        self, entry: _Entry, file: Path, warnings: list[str], textures: dict[tuple[Path, bool], Bitmap]
    ) -> None:
        self.entry = entry
        self.file = file
        self.warnings = warnings
        self.textures = textures

    def convert(self) -> MtlMaterial:
        self._warn_about_unknown()
        looks = self._looks()
        bsdf = scattering(looks, lambda keyword, what: self._warn(self._statement(keyword), what, keyword))
        emission = self._emission()
        return MtlMaterial(Material(self.entry.name, bsdf), emission)

    def _looks(self) -> Looks:
        bump = self._texture_statement(_BUMP)
        height = None if bump is None else self._bitmap(bump, raw=True)
        if bump is not None and height is not None:
            self._warn(bump.keyword, "heights are taken in the scene's unit of length", bump.keyword)
        normal = self._texture_statement(_NORMAL)
        return Looks(
            diffuse=self._diffuse(),
            specular=self._colour("Ks", BLACK),
            exponent=self._optional("Ns"),
            index=self._optional("Ni"),
            opacity=self._opacity(),
            transmission_filter=self._colour("Tf", WHITE),
            illum=self._illum(),
            height=height,
            height_scale=1.0 if bump is None else bump.bump_scale,
            normals=None if normal is None else self._bitmap(normal, raw=True),
            pbr=self._pbr(),
        )

    def _warn(self, subject: str, what: str, keyword: str | None = None) -> None:
        line = self.entry.values[keyword][0] if keyword in self.entry.values else self.entry.line
        self.warnings.append(f'{self.file.name}:{line}: material "{self.entry.name}": {subject} {what}')

    def _statement(self, keyword: str) -> str:
        if keyword not in self.entry.values:
            return keyword
        return f"{keyword} {' '.join(self.entry.values[keyword][1])}".strip()

    def _warn_about_unknown(self) -> None:
        for keyword in self.entry.values:
            if keyword not in _KNOWN | _IGNORED:
                self._warn(f'"{keyword}"', "is ignored", keyword)

    def _numbers(self, keyword: str) -> list[float]:
        words = self.entry.values[keyword][1]
        try:
            values = [float(word) for word in words]
        except ValueError:
            return []
        return values if all(math.isfinite(value) and value >= 0 for value in values) else []

    def _colour(self, keyword: str, default: RGB) -> RGB:
        if keyword not in self.entry.values:
            return default
        values = self._numbers(keyword)
        if len(values) == 1:  # the other two are then the same
            values *= 3
        if len(values) != 3:
            self._refuse(keyword, "1 or 3 numbers that are not negative")
        return values[0], values[1], values[2]

    def _optional(self, keyword: str) -> float | None:
        if keyword not in self.entry.values:
            return None
        values = self._numbers(keyword)
        if len(values) != 1:
            self._refuse(keyword, "one number that is not negative")
        return values[0]

    def _share(self, keyword: str, default: float) -> float:
        value = self._optional(keyword)
        if value is None:
            return default
        if value > 1.0:
            self._warn(self._statement(keyword), "is above 1: lowered to 1", keyword)
        return min(value, 1.0)

    def _refuse(self, keyword: str, expected: str) -> None:
        line, words = self.entry.values[keyword]
        raise SceneError(f'"{keyword}" must be {expected}, got "{" ".join(words)}"', self.file, line)

    def _illum(self) -> int | None:
        value = self._optional("illum")
        if value is not None and value not in ILLUM_MODELS:
            self._warn(self._statement("illum"), "is no illumination model (0 to 10), and is ignored", "illum")
            return None
        return None if value is None else int(value)

    def _diffuse(self) -> Color:
        statement = self._texture_statement(("map_Kd",))
        bitmap = None if statement is None else self._bitmap(statement, raw=False)
        colour = self._colour("Kd", (0.5, 0.5, 0.5) if bitmap is None else WHITE)
        # Kd tints the map; many exporters write black there when they mean the map alone
        return colour if bitmap is None else _tinted(bitmap, WHITE if colour == BLACK else colour)

    def _emission(self) -> Color | None:
        statement = self._texture_statement(("map_Ke",))
        bitmap = None if statement is None else self._bitmap(statement, raw=False)
        emission = self._colour("Ke", BLACK if bitmap is None else WHITE)
        if max(emission) == 0.0:
            return None
        return emission if bitmap is None else _tinted(bitmap, emission)

    def _opacity(self) -> Number:
        opacity = self._share("d", 1.0) if self.entry.values.get("d", (0, [""]))[1][:1] != ["-halo"] else self._halo()
        if "Tr" in self.entry.values:
            see_through = self._share("Tr", 0.0)
            if "d" not in self.entry.values:
                opacity = 1.0 - see_through
            elif abs(1.0 - see_through - opacity) > 1e-3:
                self._warn(self._statement("Tr"), "contradicts d, which is used", "Tr")
        statement = self._texture_statement(("map_d", "map_opacity"))
        if statement is None:
            return opacity
        bitmap = self._alpha(statement)
        return opacity if bitmap is None else _tinted(bitmap, (opacity, opacity, opacity))

    def _halo(self) -> float:
        self._warn(self._statement("d"), "depends on the angle of view, which is ignored", "d")
        words = self.entry.values["d"][1][1:]
        self.entry.values["d"] = self.entry.values["d"][0], words
        return self._share("d", 1.0)

    def _pbr(self) -> Pbr | None:
        if not any(keyword in self.entry.values for keyword in ("Pr", "Pm", "map_Pr", "map_Pm")):
            return None
        return Pbr(
            self._textured_share("Pr", 0.5),
            self._textured_share("Pm", 0.0),
            self._share("Ps", 0.0),
            self._share("Pc", 0.0),
            self._share("Pcr", 0.0),
        )

    def _textured_share(self, keyword: str, default: float) -> Number:
        statement = self._texture_statement((f"map_{keyword}",))
        bitmap = None if statement is None else self._bitmap(statement, raw=True)
        if bitmap is None:
            return self._share(keyword, default)
        factor = self._share(keyword, 1.0)
        return _tinted(bitmap, (factor, factor, factor))

    def _texture_statement(self, keywords: tuple[str, ...]) -> TextureStatement | None:
        """The first of some statements that is there and names a file that is there."""
        for keyword in keywords:
            if keyword not in self.entry.values:
                continue
            line, words = self.entry.values[keyword]
            statement = read_statement(keyword, words, self.file)
            for note in statement.notes:
                self._warn(keyword, note, keyword)
            if statement.file is not None:
                return statement
            self._warn(f'texture "{" ".join(words)}" (line {line})', f"not found: {keyword} is ignored", keyword)
        return None

    def _bitmap(self, statement: TextureStatement, *, raw: bool) -> Bitmap:
        assert statement.file is not None
        key = statement.file, raw
        if key not in self.textures:
            self.textures[key] = Bitmap(statement.file.name, read_texture(statement.file, raw=raw))
        return _placed(self.textures[key], statement)

    def _alpha(self, statement: TextureStatement) -> Bitmap:
        """The image's alpha where it has one, else its brightness."""
        assert statement.file is not None
        pixels = read_alpha(statement.file)
        if pixels is None:
            return self._bitmap(statement, raw=True)
        return _placed(Bitmap(f"{statement.file.name} (alpha)", pixels), statement)


def _placed(bitmap: Bitmap, statement: TextureStatement) -> Bitmap:
    if statement.is_plain:
        return bitmap
    return replace(bitmap, to_uv=statement.to_uv, wrap=statement.wrap)


def _tinted(bitmap: Bitmap, colour: RGB) -> Bitmap:
    if colour == WHITE:
        return bitmap
    return replace(bitmap, pixels=bitmap.pixels * np.array(colour, dtype=np.float32))
