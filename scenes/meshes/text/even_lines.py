"""Lines that are all of one form, such as `v -1.5 0.25 3.125` or `f 1/1/1 2/2/2 3/3/3` thousands of times.

Where words stand need not be looked for line by line then: as many separators later the same stands in the next line.
Most bytes of large OBJ files are in such lines. Of lines that are not so, or hold anything unusual, this says no more
than that they are not.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.meshes.text.numbers import EIGHT, POWERS, SAFE_DIGITS, of_digits, shifted

_WORD: Final = re.compile(rb"[^\t\n\r ./]+")
_LETTER: Final = b"x"
_CORNER: Final = re.compile(rb"x|x/x|x//x|x/x/x")
_MINUS, _DOT, _SLASH = b"-./"


@dataclass(frozen=True, eq=False)
class EvenLines:
    """Lines of one form, cut at separators: white space and one mark more.

    Attributes:
        form: of each line, every word a letter x: b"x x.x x.x x.x" and its end.
        values: the whole numbers between separators, 0 where there is none and for the first word, uint64, of shape
            [lines, separators of each].
        digits: of each number.
        minus: whether there is a minus before it; None where there are none.
    """

    form: bytes
    values: NDArray[np.uint64]
    digits: NDArray[np.int64]
    minus: NDArray[np.bool_] | None

    def decimals(self) -> NDArray[np.float64] | None:
        """The numbers behind the first word, shape [lines, numbers], if each has a dot."""
        tokens = self.form.split()[1:]
        if not all(token.count(_DOT) == 1 for token in tokens):
            return None
        dots = [number for number, each in enumerate(_separators(self.form)) if each == _DOT]
        others = [column for column in range(self.values.shape[1]) if column not in dots and column - 1 not in dots]
        if not self._as_first(others):
            return None
        parts = [column + 1 for column in dots]
        decimals = _columns(self.digits, parts)
        count = _columns(self.digits, dots) + decimals
        if count.min() < 1 or count.max() > SAFE_DIGITS:
            return None
        minus = None if self.minus is None else _columns(self.minus, dots)
        if self.minus is not None and _columns(self.minus, parts).any():
            return None
        first = decimals[0, 0]
        power = POWERS[first] if (decimals == first).all() else POWERS[decimals]  # programs write as many of each
        values: NDArray[np.float64] = _columns(self.values, dots) * power
        values += _columns(self.values, parts)
        values /= power
        if minus is not None:
            np.negative(values, out=values, where=minus)  # of zeros too
        return values

    def corners(self) -> tuple[NDArray[np.int32] | None, ...] | None:
        """Of faces, the numbers of position, texture coordinate and normal at each corner, shape [lines, corners].

        None for what no corner has.
        """
        tokens = self.form.split()[1:]
        if self.minus is not None or len(set(tokens)) != 1 or not _CORNER.fullmatch(tokens[0]):
            return None
        if not self._as_first(slice(None)):
            return None
        columns = np.flatnonzero(self.digits[0]).tolist()
        given = [bool(part) for part in tokens[0].split(b"/")]
        found = (_columns(self.values, columns[kind :: sum(given)]) for kind in range(sum(given)))
        kinds = [next(found).astype(np.int32) if each else None for each in given]
        if any(each is not None and each.min() == 0 for each in kinds):  # they are counted from 1
            return None
        return (*kinds, None, None)[:3]

    def _as_first(self, columns: slice | list[int]) -> bool:
        """Whether there are numbers in some columns where there are in the first line."""
        there = self.digits[:, columns] > 0
        return bool((there == there[0]).all())


def _columns(table: NDArray[Any], columns: list[int]) -> NDArray[Any]:
    """Some columns; where they lie at even distances nothing is copied."""
    step = columns[1] - columns[0] if len(columns) > 1 else 1
    even = range(columns[0], columns[0] + step * len(columns), step)
    return table[:, even.start : even.stop : step] if columns == list(even) else table[:, columns]


def read_even(text: bytes, keyword: bytes, mark: int) -> EvenLines | None:
    """Lines that all begin with a word, and have one form.

    Args:
        text: whole lines, with their ends.
        mark: what stands between numbers besides white space: a dot or a slash.
    """
    form = _WORD.sub(_LETTER, text[: text.index(b"\n") + 1])
    separators = _separators(form)
    # before the text ends the word before it, and eight bytes are read from the begin of each number on
    data = np.frombuffer(b"".join((b"\n", text, b"0" * EIGHT)), np.uint8)
    breaks = np.flatnonzero((data <= ord(" ")) | (data == mark))
    begin = breaks[:-1] + 1
    width = len(separators)
    if len(begin) % width:
        return None
    found = data[breaks[1:]].reshape(-1, width)
    if (
        found[0].tobytes() != separators
        or not (found == found[0]).all()
        or not _begin_with(keyword, data, begin[::width])
    ):
        return None
    digits = breaks[1:] - begin
    by_line = digits.reshape(-1, width)
    if not (by_line[:, 0] == len(keyword)).all():
        return None
    by_line[:, 0] = 0
    minus = data[begin] == _MINUS
    signed = bool(minus.any())
    if signed:
        begin += minus
        digits -= minus
    if digits.max() > EIGHT:
        return None
    values = of_digits(shifted(data, begin, digits))
    if values is None:
        return None
    return EvenLines(form, values.reshape(-1, width), by_line, minus.reshape(-1, width) if signed else None)


def _separators(form: bytes) -> bytes:
    return form.replace(_LETTER, b"")


def _begin_with(keyword: bytes, data: NDArray[np.uint8], starts: NDArray[np.int64]) -> bool:
    return all(bool((data[starts + place] == letter).all()) for place, letter in enumerate(keyword))
