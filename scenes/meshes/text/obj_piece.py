"""A piece of an OBJ file, read by whole arrays.

It takes lines as programs write them. Of anything else, and of all that is wrong, it says no more than that it is not
plain; `obj` then reads the file line by line, and says what and where.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.meshes.obj_file import IGNORED
from wdpm.scenes.meshes.text.even_lines import EvenLines, read_even
from wdpm.scenes.meshes.text.numbers import Places, Words, find_words, floats, integers, padded
from wdpm.scenes.model.checks import FARTHEST
from wdpm.scenes.model.transforms import normalized

_OTHER, _POSITION, _UV, _NORMAL, _FACE, _COMMENT = range(6)
_KEYWORDS: Final = {_POSITION: b"v", _UV: b"vt", _NORMAL: b"vn", _FACE: b"f"}
_NEWLINE, _DOT, _SLASH = b"\n./"
_MOST: Final = 2**31 - 1


Corners = tuple[NDArray[np.int32], NDArray[np.int32] | None, NDArray[np.int32] | None]


class NotPlainError(Exception):
    """The piece is to be read line by line."""


@dataclass(eq=False)
class ObjPiece:
    """What some lines hold, one after another.

    Attributes:
        positions, uvs, normals: float64, shapes [V, 3], [T, 2] and [N, 3]; normals of unit length.
        colors: behind the positions of some vertices, float64, shape [C, 3].
        corners: of faces, numbers of position, texture coordinate and normal from 0, -1 where there is none, and one
            less than written where they count back, int32, of shape [K] each. None where no corner has one; the very
            array of the positions where they are the same.
        counts: corners of each face, shape [F].
        seen: positions, texture coordinates and normals in the piece above each corner's face, shape [K, 3]; None where
            no number is negative.
        materials: faces above each `usemtl`, and its name.
        libraries: from `mtllib`, with lines from 0.
        unknown: keywords that nobody knows, with lines from 0.
        lines: of the piece.
    """

    positions: NDArray[np.float64]
    uvs: NDArray[np.float64]
    normals: NDArray[np.float64]
    colors: NDArray[np.float64]
    corners: Corners
    counts: NDArray[np.int32]
    seen: NDArray[np.int64] | None
    lines: int
    materials: list[tuple[int, str]] = field(default_factory=list)
    libraries: list[tuple[str, int]] = field(default_factory=list)
    unknown: dict[str, int] = field(default_factory=dict)


def read_pieces(text: bytes) -> list[ObjPiece]:
    """Reads whole lines: long runs of even ones as such, others by what their words are.

    Raises:
        NotPlainError: something in them is not as programs write it.
    """
    if text and not text.endswith(b"\n"):
        text += b"\n"
    whole = _read_even(text)
    if whole is not None:
        return [whole]
    parts = _runs(text)
    if len(parts) == 1:
        return [read_piece(text)]
    return [_read_even(part) or read_piece(part) for part in parts]


LONG_RUN: Final = 1 << 14
"""Bytes of lines of one kind that are worth being read by themselves."""


def _runs(text: bytes) -> list[bytes]:
    """The text, cut where long runs of one kind of lines begin and end."""
    data = np.frombuffer(text, np.uint8)
    starts = np.flatnonzero(data[:-1] == _NEWLINE) + 1
    starts = np.concatenate([np.zeros(1, np.int64), starts])
    kinds = data[starts].astype(np.uint16) << 8 | data[np.minimum(starts + 1, len(data) - 1)]
    cuts = starts[np.append(True, kinds[1:] != kinds[:-1])]
    ends = np.append(cuts[1:], len(text))
    long = ends - cuts >= LONG_RUN
    # a run of short ones together begins where none is before
    begins = cuts[long | np.append(True, long[:-1])].tolist()
    return [text[begin:end] for begin, end in zip(begins, [*begins[1:], len(text)], strict=True)]


def _read_even(text: bytes) -> ObjPiece | None:
    """Lines of one kind and one form; None if they are not, or hold what is unusual."""
    keyword, last = text[:3].split(b" ")[0], text.rfind(b"\n", 0, len(text) - 1) + 1
    if keyword not in _KEYWORDS.values() or not text.startswith(keyword + b" ", last):
        return None
    lines = read_even(text, keyword, _SLASH if keyword == b"f" else _DOT)
    if lines is None:
        return None
    return _even_faces(lines) if keyword == b"f" else _even_vertices(lines, keyword)


def _even_faces(lines: EvenLines) -> ObjPiece | None:
    corners = lines.corners()
    if corners is None or corners[0] is None or corners[0].shape[1] < 3:
        return None
    count, each = corners[0].shape
    v = corners[0].reshape(-1)
    vt, vn = (None if one is None else v if one is corners[0] else one.reshape(-1) for one in corners[1:])
    none = np.zeros((0, 3))
    return ObjPiece(none, none[:, :2], none, none, (v, vt, vn), np.full(count, each, np.int32), None, count)


def _even_vertices(lines: EvenLines, keyword: bytes) -> ObjPiece | None:
    values = lines.decimals()
    if values is None:
        return None
    count, each = values.shape
    least, width = (1, 2) if keyword == b"vt" else (3, 3)
    if each < least:
        return None
    rows = np.ascontiguousarray(values[:, :width]) if each >= width else np.pad(values, ((0, 0), (0, width - each)))
    none, no_corners = np.zeros((0, 3)), np.zeros(0, np.int32)
    return ObjPiece(
        rows if keyword == b"v" else none,
        rows if keyword == b"vt" else none[:, :2],
        normalized(rows) if keyword == b"vn" else none,
        values[:, 3:] if keyword == b"v" and each == 6 else none,
        (no_corners, None, None),
        np.zeros(0, np.int32),
        None,
        count,
    )


def read_piece(text: bytes) -> ObjPiece:
    """Reads whole lines.

    Raises:
        NotPlainError: something in them is not as programs write it.
    """
    data = padded(text)
    words = find_words(data)
    if words is None:
        raise NotPlainError
    kinds = _kinds(data, words)
    try:
        positions, colors, uvs, normals = _vertices(data, words, kinds)
        corners = _corners(data, words, kinds)
    except (ValueError, OverflowError):
        raise NotPlainError from None
    seen = None
    if any(column is not None and column.min(initial=0) < -1 for column in corners):
        above = np.stack([np.cumsum(kinds == kind) for kind in (_POSITION, _UV, _NORMAL)], axis=1)
        seen = np.repeat(above[kinds == _FACE], words.counts[kinds == _FACE] - 1, axis=0)
    counts = (words.counts[kinds == _FACE] - 1).astype(np.int32)
    piece = ObjPiece(positions, uvs, normals, colors, corners, counts, seen, len(words.lines))
    _read_others(piece, text, data, words, kinds)
    return piece


def _kinds(data: NDArray[np.uint8], words: Words) -> NDArray[np.int8]:
    """What each line is, by its first word. Lines without words are comments."""
    kinds = np.full(len(words.lines), _COMMENT, np.int8)
    (filled,) = np.nonzero(words.counts)
    first = words.first[filled]
    begin = words.begin[first]
    length = words.end[first] - begin
    letter, second = data[begin], data[begin + 1]
    kind = np.where(letter == ord("#"), _COMMENT, _OTHER).astype(np.int8)
    for number, keyword in _KEYWORDS.items():
        alike = (letter == keyword[0]) & (length == len(keyword))
        if len(keyword) == 2:
            alike &= second == keyword[1]
        kind[alike] = number
    kinds[filled] = kind
    return kinds


def _values_of(words: Words, chosen: NDArray[np.bool_]) -> tuple[Places, Places]:
    """Begins and ends of the words behind the keywords of some lines."""
    if chosen.all() and (words.counts == words.counts[0]).all():  # as in most of a file
        wanted = np.ones((len(chosen), words.counts[0]), np.bool_)
        wanted[:, 0] = False
    else:
        wanted = np.repeat(chosen, words.counts)
        wanted[words.first[chosen]] = False
    numbers = np.flatnonzero(wanted)
    return words.begin[numbers], words.end[numbers]


def _vertices(
    data: NDArray[np.uint8], words: Words, kinds: NDArray[np.int8]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Positions, colours, texture coordinates and normals."""
    wanted = (kinds == _POSITION) | (kinds == _UV) | (kinds == _NORMAL)
    values = floats(data, *_values_of(words, wanted))
    counts = words.counts[wanted] - 1
    kinds = kinds[wanted]
    found = []
    for kind in (_POSITION, _UV, _NORMAL):
        own = kinds == kind
        found.append((values if own.all() else values[np.repeat(own, counts)], counts[own]))
    positions, sizes = _rows(*found[0], least=3, width=3), found[0][1]
    colored = np.flatnonzero((sizes == 6) | (sizes == 7))  # a seventh number is opacity
    first = (np.cumsum(sizes) - sizes)[colored]
    colors = found[0][0][first[:, None] + np.arange(3, 6)].reshape(-1, 3)
    normals = _rows(*found[2], least=3, width=3)
    uvs = _rows(*found[1], least=1, width=2)
    for rows in (positions, uvs, normals):
        if not (np.abs(rows) <= FARTHEST).all():
            raise NotPlainError
    return positions, colors, uvs, normalized(normals)


def _rows(values: NDArray[np.float64], counts: NDArray[np.int64], *, least: int, width: int) -> NDArray[np.float64]:
    """The first values of each line, zero where there are fewer, shape [lines, width]."""
    if not len(counts):
        return np.zeros((0, width))
    if counts.min() < least:
        raise NotPlainError
    if counts.min() == counts.max() and counts[0] >= width:
        return np.ascontiguousarray(values.reshape(-1, counts[0])[:, :width])
    rows = np.zeros((len(counts), width))
    first = np.cumsum(counts) - counts
    for column in range(width):
        given = counts > column
        rows[given, column] = values[first[given] + column]
    return rows


def _corners(data: NDArray[np.uint8], words: Words, kinds: NDArray[np.int8]) -> Corners:
    """Numbers as they stand in a piece."""
    faces = kinds == _FACE
    if (words.counts[faces] < 4).any():
        raise NotPlainError
    begin, end = _values_of(words, faces)
    first, second = _slashes(data, begin, end)
    v = _numbers(data, begin, first, np.ones(len(begin), np.bool_))
    vt = _numbers(data, first + 1, second, second > first + 1)
    vn = _numbers(data, second + 1, end, end > second + 1)
    if v is None:
        return np.zeros(0, np.int32), None, None
    vt, vn = (v if column is not None and np.array_equal(column, v) else column for column in (vt, vn))
    return v, vt, vn


def _numbers(data: NDArray[np.uint8], begin: Places, end: Places, given: NDArray[np.bool_]) -> NDArray[np.int32] | None:
    """One less than is written, -1 where nothing is given; None where nothing is anywhere."""
    if not given.any():
        return None
    if not given.all():
        begin, end = begin[given], end[given]
    read = integers(data, begin, end)
    if (read == 0).any() or read.max() > _MOST or read.min() < -_MOST:
        raise NotPlainError
    read -= 1
    if given.all():
        return read.astype(np.int32)
    numbers = np.full(len(given), -1, np.int32)
    numbers[given] = read
    return numbers


def _slashes(data: NDArray[np.uint8], begin: Places, end: Places) -> tuple[Places, Places]:
    """The first and the second slash of each corner; its end where there is none."""
    slashes = np.flatnonzero(data == _SLASH)
    if not len(slashes):
        return end, end
    for each in (1, 2):
        if len(slashes) == each * len(begin):
            first, last = slashes[::each], slashes[each - 1 :: each]
            if ((first > begin) & (last < end)).all() and (first[1:] >= end[:-1]).all():
                return first, last if each == 2 else end
    low, high = np.searchsorted(slashes, begin), np.searchsorted(slashes, end)
    if (high - low > 2).any():
        raise NotPlainError
    slashes = np.append(slashes, [0, 0])
    return np.where(high > low, slashes[low], end), np.where(high > low + 1, slashes[low + 1], end)


def _read_others(piece: ObjPiece, text: bytes, data: NDArray[np.uint8], words: Words, kinds: NDArray[np.int8]) -> None:
    """Reads the lines that are neither vertices nor faces."""
    (others,) = np.nonzero(kinds == _OTHER)
    if b"\\" in text and _continues(text):
        raise NotPlainError
    above = np.cumsum(kinds == _FACE)
    ends = np.append(words.lines[1:], len(data))
    for line in others.tolist():
        content = data[words.lines[line] : ends[line]].tobytes().decode("utf-8", errors="replace")
        parts = content.partition("#")[0].split()
        if not parts:
            continue
        if parts[0] == "fo":  # an old spelling
            raise NotPlainError
        rest = " ".join(parts[1:])
        if parts[0] == "usemtl":
            piece.materials.append((int(above[line]), rest))
        elif parts[0] == "mtllib":
            piece.libraries.append((rest, line))
        elif parts[0] not in IGNORED:
            piece.unknown.setdefault(parts[0], line)


def _continues(text: bytes) -> bool:
    """Whether a line goes on in the next."""
    return any(line.partition(b"#")[0].rstrip().endswith(b"\\") for line in text.split(b"\n") if b"\\" in line)
