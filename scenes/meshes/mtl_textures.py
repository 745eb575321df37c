"""The texture statements of MTL files: `map_Kd -s 2 2 -clamp on wood.png` and its like."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from glob import escape
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.beside import file_beside
from wdpm.scenes.meshes.text.words import is_number
from wdpm.scenes.model.textures import Wrap
from wdpm.scenes.scene_root import check_within

# options and how many words at most follow them
_OPTIONS: Final = {
    **dict.fromkeys(("-s", "-o", "-t"), 3),
    **dict.fromkeys(("-blendu", "-blendv", "-cc", "-clamp", "-boost", "-texres", "-bm", "-imfchan", "-type"), 1),
    "-mm": 2,
}


def _identity() -> NDArray[np.float64]:
    return np.eye(3)


@dataclass(frozen=True, eq=False)
class TextureStatement:
    """A texture with its options.

    Attributes:
        file: None if none of the words names a file that is there.
        to_uv: of -s and -o.
        bump_scale: of -bm.
        notes: what is ignored.
    """

    keyword: str
    file: Path | None
    to_uv: NDArray[np.float64] = field(default_factory=_identity)
    wrap: Wrap = Wrap.REPEAT
    bump_scale: float = 1.0
    notes: tuple[str, ...] = ()

    @property
    def is_plain(self) -> bool:
        """Whether no option changes how the texture is looked up."""
        return self.wrap is Wrap.REPEAT and bool(np.array_equal(self.to_uv, np.eye(3)))


def read_statement(keyword: str, words: Sequence[str], library: Path) -> TextureStatement:
    """The words behind a keyword. File names may hold blanks and a foreign system's separators.

    Args:
        library: beside which the file is looked for.
    """
    options: dict[str, list[str]] = {}
    rest = list(words)
    while rest and rest[0] in _OPTIONS and _find(rest, library) is None:
        option = rest.pop(0)
        options[option] = []
        while rest and len(options[option]) < _OPTIONS[option] and (_OPTIONS[option] != 3 or is_number(rest[0])):
            options[option].append(rest.pop(0))
    statement = _statement(keyword, options, _find(rest, library))
    return replace(statement, notes=(*statement.notes, *_tiles_in_words(statement.file)))


_PATTERN: Final = "<UDIM>"
"""In the name of a file it stands for the numbers of tiles, each for a unit square of texture coordinates."""

_FIRST_TILE: Final = "1001"


def _tiles_in_words(file: Path | None) -> Iterator[str]:
    """That of several tiles the first is all that is read."""
    if file is None or file.stem[-5:] not in (f".{_FIRST_TILE}", f"_{_FIRST_TILE}"):
        return
    others = file.parent.glob(f"{escape(file.stem[:-4])}1[0-9][0-9][0-9]{escape(file.suffix)}")
    if len(list(others)) > 1:
        yield f'is in tiles (UDIM), of which the first is repeated: "{file.name}"'


def _find(words: Sequence[str], library: Path) -> Path | None:
    if not words:
        return None
    file = file_beside(library, " ".join(words).replace("\\", "/").replace(_PATTERN, _FIRST_TILE))
    if not file.is_file():
        return None
    check_within(file)
    return file


def _statement(keyword: str, options: dict[str, list[str]], file: Path | None) -> TextureStatement:
    scale, offset = _pair(options.get("-s"), 1.0), _pair(options.get("-o"), 0.0)
    to_uv = np.array([[scale[0], 0.0, offset[0]], [0.0, scale[1], offset[1]], [0.0, 0.0, 1.0]])
    wrap = Wrap.CLAMP if options.get("-clamp") == ["on"] else Wrap.REPEAT
    strength = options.get("-bm", [])
    bump_scale = float(strength[0]) if strength and is_number(strength[0]) else 1.0
    unused = [option for option in options if option not in ("-s", "-o", "-clamp", "-bm")]
    notes = (f"{option} {' '.join(options[option])} is ignored" for option in unused)
    return TextureStatement(keyword, file, to_uv, wrap, bump_scale, tuple(notes))


def _pair(words: list[str] | None, default: float) -> tuple[float, float]:
    values = [float(word) for word in words or []]
    return values[0] if values else default, values[1] if len(values) > 1 else default
