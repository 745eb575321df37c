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

from wdpm.scenes.meshes.text.numbers import EIGHT, POWERS, SAFE_DIGITS, of_decimals, of_digits, shifted

_WORD: Final = re.compile(rb"[^\t\n\r ./]+")
_LETTER: Final = b"x"
_CORNER: Final = re.compile(rb"x|x/x|x//x|x/x/x")
_MINUS, _DOT = b"-."
_SIGN: Final = np.uint64(63)


@dataclass(frozen=True, eq=False)
class EvenLines:
    """Lines of one form, cut at separators: white space and one mark more.

    Attributes:
        form: of each line, every word a letter x: b"x x.x x.x x.x" and its end.
        data: the text, with EIGHT bytes before and behind.
        ends: of what stands between separators behind the first word, of shape [lines, separators of each but one].
        digits: of each number, zero where there is none; at most EIGHT.
        minus: whether there is a minus before it; None where there are none.
    """

    form: bytes
    data: NDArray[np.uint8]
    ends: NDArray[np.int64]
    digits: NDArray[np.int64]
    minus: NDArray[np.bool_] | None

    def decimals(self) -> NDArray[np.float64] | None:
        """The numbers behind the first word, shape [lines, numbers], if each has a dot."""
        tokens = self.form.split()[1:]
        if not tokens or not all(token.count(_DOT) == 1 for token in tokens):
            return None
        dots = [number for number, each in enumerate(_separators(self.form)[1:]) if each == _DOT]
        others = [column for column in range(self.ends.shape[1]) if column not in dots and column - 1 not in dots]
        if not self._as_first(others):
            return None
        parts = [column + 1 for column in dots]
        whole, decimals = _columns(self.digits, dots), _columns(self.digits, parts)
        count = whole + decimals
        if count.min() < 1 or count.max() > SAFE_DIGITS:
            return None
        if self.minus is not None and _columns(self.minus, parts).any():
            return None
        dot, end = _columns(self.ends, dots), _columns(self.ends, parts)
        first = int(decimals[0, 0])
        even = bool((decimals == first).all())  # programs write as many of each
        power = POWERS[first] if even else POWERS[decimals]
        if even and count.max() <= EIGHT:
            number = of_decimals(self.data, dot, whole, end, first)
            if number is None:
                return None
            values: NDArray[np.float64] = number.astype(np.float64)
        else:
            upper, lower = of_digits(shifted(self.data, dot, whole)), of_digits(shifted(self.data, end, decimals))
            if upper is None or lower is None:
                return None
            values = upper * power
            values += lower
        values /= power
        if self.minus is not None:
            bits = values.view(np.uint64)
            bits |= _columns(self.minus, dots).astype(np.uint64) << _SIGN  # of zeros too
        return values

    def corners(self) -> tuple[NDArray[np.int32] | None, ...] | None:
        """Of faces, the numbers of position, texture coordinate and normal at each corner, shape [lines, corners].

        They are counted from 0. None for what no corner has; the same array where they are the same.
        """
        tokens = self.form.split()[1:]
        if self.minus is not None or len(set(tokens)) != 1 or not _CORNER.fullmatch(tokens[0]):
            return None
        if not self._as_first(slice(None)):
            return None
        columns = np.flatnonzero(self.digits[0]).tolist()
        given = [bool(part) for part in tokens[0].split(b"/")]
        words = shifted(self.data, self.ends, self.digits)
        kinds: list[NDArray[np.int32] | None] = []
        of_first = _columns(words, columns[:: sum(given)])
        for kind, each in enumerate(given):
            own = _columns(words, columns[sum(given[:kind]) :: sum(given)])
            if not each:
                kinds.append(None)
            elif kind and np.array_equal(own, of_first):
                kinds.append(kinds[0])
            else:
                numbers = of_digits(own.copy())
                if numbers is None or not numbers.all():  # the first has the number 1
                    return None
                found = numbers.astype(np.int32)
                found -= 1
                kinds.append(found)
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
    # before the text ends the word before it, and eight bytes are read before the end of each number
    data = np.frombuffer(b"".join((b"0" * (EIGHT - 1), b"\n", text, b"0" * EIGHT)), np.uint8)
    marks = data <= ord(" ")
    marks |= data == mark
    breaks = np.flatnonzero(marks)
    width = len(separators)
    if (len(breaks) - 1) % width:
        return None
    starts = breaks[:-1:width] + 1
    found = data[breaks[1:]].reshape(-1, width)
    if (
        found[0].tobytes() != separators
        or not (found == found[0]).all()
        or not _begin_with(keyword, data, starts)
        or not (breaks[1::width] - starts == len(keyword)).all()
    ):
        return None
    between = np.diff(breaks)
    between -= 1
    digits = between.reshape(-1, width)[:, 1:].copy()
    ends = breaks[1:].reshape(-1, width)[:, 1:].copy()
    minus = None
    if b"-" in text:
        minus = data[ends - digits] == _MINUS
        digits -= minus
        minus = minus if minus.any() else None
    if digits.max(initial=0) > EIGHT:
        return None
    return EvenLines(form, data, ends, digits, minus)


def _separators(form: bytes) -> bytes:
    return form.replace(_LETTER, b"")


def _begin_with(keyword: bytes, data: NDArray[np.uint8], starts: NDArray[np.int64]) -> bool:
    return all(bool((data[starts + place] == letter).all()) for place, letter in enumerate(keyword))
