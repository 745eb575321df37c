"""Numbers in text, many at a time: words are found and read by whole arrays, with the bits that Python gives.

Digits are read eight at a time, as bytes of a 64-bit word (D. Lemire, "Quickly parsing eight digits", 2018). A decimal
fraction of at most 15 digits is the quotient of two whole numbers that a double holds, so its one rounding is the right
one (W. Clinger, "How to read floating point numbers accurately", 1990). What is not of that form, such as exponents, is
left to Python, word by word.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

PADDING: Final = 16
"""Bytes that must stand before the text: words are fetched by their ends."""

SAFE_DIGITS: Final = 15
EIGHT: Final = 8
_ZEROS: Final = np.uint64(0x3030303030303030)
_NO_DIGIT: Final = np.uint64(0x7676767676767676)
_ALL: Final = np.uint64(0xFFFFFFFFFFFFFFFF)
_HIGH: Final = np.uint64(0x8080808080808080)
POWERS: Final = np.concatenate([10.0 ** np.arange(2 * EIGHT + 1), -(10.0 ** np.arange(2 * EIGHT + 1))])
_NEWLINE, _PLUS, _MINUS, _DOT = (ord(letter) for letter in "\n+-.")
_HUNDRED_MILLION: Final = np.uint64(10**EIGHT)
_BITS: Final = (8 * np.arange(2 * EIGHT + 1)).astype(np.uint64)
# of a word of eight bytes, those before its digits, by their number
_BITS_BEFORE: Final = np.maximum(8 * (EIGHT - np.arange(2 * EIGHT + 1)), 0).astype(np.uint64)
# steps of putting together neighbours of one, two and four digits
_STEPS: Final = tuple(
    (np.uint64(factor), np.uint64(shift), np.uint64(mask))
    for factor, shift, mask in (
        (10, 8, 0x00FF00FF00FF00FF),
        (100, 16, 0x0000FFFF0000FFFF),
        (10000, 32, 0x00000000FFFFFFFF),
    )
)

Places = NDArray[np.int64]
"""Places in a text, by byte."""


def padded(text: bytes) -> NDArray[np.uint8]:
    """Text as bytes that can be read, with PADDING before it and a line's end behind."""
    return np.frombuffer(b"".join((b" " * PADDING, text, b"" if text.endswith(b"\n") else b"\n")), np.uint8)


@dataclass(frozen=True, eq=False)
class Words:
    """The words of a text, in order.

    Attributes:
        begin, end: where each begins, and where it has ended, shape [W].
        counts: words of each line, shape [L].
        first: how many words stand before each line, shape [L].
        lines: where each line begins, shape [L].
    """

    begin: Places
    end: Places
    counts: NDArray[np.int64]
    first: NDArray[np.int64]
    lines: Places


def find_words(data: NDArray[np.uint8]) -> Words | None:
    """Words between white space, by lines; None where there are bytes of which Python's split would think otherwise.

    Args:
        data: from `padded`.
    """
    breaks = np.flatnonzero(data <= ord(" "))
    kinds = data[breaks]
    if ((kinds < 9) | ((kinds > 13) & (kinds < 28))).any():
        return None
    begin = breaks[PADDING - 1 : -1] + 1
    end = breaks[PADDING:]
    (last,) = np.nonzero(kinds[PADDING:] == _NEWLINE)
    lines = np.concatenate([np.array([PADDING]), end[last[:-1]] + 1])
    is_word = end > begin
    after: NDArray[np.int64] = last + 1
    if not is_word.all():
        after = np.cumsum(is_word, dtype=np.int64)[last]
        begin, end = begin[is_word], end[is_word]
    first = np.concatenate([np.zeros(1, np.int64), after[:-1]])
    return Words(begin, end, after - first, first, lines)


def floats(data: NDArray[np.uint8], begin: Places, end: Places) -> NDArray[np.float64]:
    """The numbers that words are, shape [W].

    Raises:
        ValueError: one is none.
    """
    sign = data[begin]
    minus = sign == _MINUS
    dot = _dots(data, begin, end)
    decimals = np.maximum(end - dot - 1, 0)
    count = dot - begin
    count -= minus
    count -= sign == _PLUS
    digits = count + decimals
    bad = (digits < 1) | (digits > SAFE_DIGITS)
    longest = int(digits.max(initial=0))
    if longest > 2 * EIGHT:
        count, decimals = np.minimum(count, 2 * EIGHT), np.minimum(decimals, 2 * EIGHT)
    # the sign is the divisor's, so that there is a minus zero
    divisor = POWERS[decimals + minus * len(POWERS) // 2] if minus.any() else POWERS[decimals]
    if longest <= EIGHT:
        word = _last(data, dot, count)
        word >>= _BITS[decimals]
        word |= _last(data, end, decimals)
        values = _number(word, bad).astype(np.float64)
    else:
        values = _digits(data, dot, count, bad).astype(np.float64)
        values *= np.abs(divisor)
        values += _digits(data, end, decimals, bad)
    values /= divisor
    for row in np.flatnonzero(bad).tolist():
        values[row] = float(data[begin[row] : end[row]].tobytes())
    return values


def integers(data: NDArray[np.uint8], begin: Places, end: Places) -> NDArray[np.int64]:
    """The whole numbers that words are, shape [W].

    Raises:
        ValueError: one is none.
        OverflowError: one has more than 63 bits.
    """
    sign = data[begin]
    minus = sign == _MINUS
    count = end - begin
    count -= minus
    count -= sign == _PLUS
    bad = (count < 1) | (count > SAFE_DIGITS)
    if int(count.max(initial=0)) > 2 * EIGHT:
        count = np.minimum(count, 2 * EIGHT)
    values = _digits(data, end, count, bad).astype(np.int64)
    if minus.any():
        values *= np.where(minus, -1, 1)
    for word in np.flatnonzero(bad).tolist():
        values[word] = int(data[begin[word] : end[word]].tobytes())
    return values


def _dots(data: NDArray[np.uint8], begin: Places, end: Places) -> Places:
    """Where the first dot of each word is; its end where it has none."""
    if not len(begin):
        return end
    dots = np.flatnonzero(data[begin[0] : end[-1]] == _DOT)
    dots += begin[0]
    if len(dots) == len(begin) and ((dots >= begin) & (dots < end)).all():
        return dots
    if not len(dots):
        return end
    number = np.searchsorted(dots, begin)
    return np.minimum(np.where(number < len(dots), dots[np.minimum(number, len(dots) - 1)], end), end)


def _digits(data: NDArray[np.uint8], end: Places, count: Places, bad: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """The numbers whose digits end before `end`; `bad` grows by those that are none.

    Args:
        count: of digits, at most twice eight where it is not bad.
    """
    lower = _number(_last(data, end, count), bad)
    (longer,) = np.nonzero(count > EIGHT)
    if len(longer):
        wrong = np.zeros(len(longer), np.bool_)
        lower[longer] += _number(_last(data, end[longer] - EIGHT, count[longer] - EIGHT), wrong) * _HUNDRED_MILLION
        bad[longer] |= wrong
    return lower


def _last(data: NDArray[np.uint8], end: Places, count: Places) -> NDArray[np.uint64]:
    """The bytes before `end`, at most eight, the last one highest; digits are 0 to 9, and before them are zeros.

    Args:
        count: how many are wanted, at most twice eight.
    """
    word = _eights(data).take(end - EIGHT, mode="clip")  # which is the faster; all of them are there
    word ^= _ZEROS
    before = _BITS_BEFORE[count]
    word >>= before  # NumPy shifts by 64 to zero
    word <<= before
    return word


def shifted(data: NDArray[np.uint8], end: Places, count: Places) -> NDArray[np.uint64]:
    """The digits before `end` as words for `of_digits`, of the same shape.

    Args:
        data: with eight bytes before each end.
        count: of digits, at most eight.
    """
    word = _eights(data).take(end - EIGHT, mode="clip")  # which is the faster; all of them are there
    word ^= _ZEROS
    before = (EIGHT * (EIGHT - count)).view(np.uint64)
    word >>= before  # NumPy shifts by 64 to zero
    word <<= before
    return word


def of_decimals(
    data: NDArray[np.uint8], dot: Places, count: Places, end: Places, decimals: int
) -> NDArray[np.uint64] | None:
    """The numbers that decimal fractions are without their dots, of the same shape; None if any has what is no digit.

    Args:
        data: with eight bytes before each dot.
        dot, count: where it stands, and how many digits stand before it.
        end, decimals: where the number ends, and how many stand behind the dot; all in all at most eight.
    """
    eights = _eights(data)
    word = eights.take(dot - EIGHT, mode="clip")
    word ^= _ZEROS
    before = EIGHT * (EIGHT - count)
    word >>= before.view(np.uint64)
    before -= EIGHT * decimals
    word <<= before.view(np.uint64)
    if decimals:
        behind = eights.take(end - EIGHT, mode="clip")
        behind ^= _ZEROS
        behind &= _ALL << np.uint64(EIGHT * (EIGHT - decimals))
        word |= behind
    return of_digits(word)


def of_digits(word: NDArray[np.uint64]) -> NDArray[np.uint64] | None:
    """The number of the eight digits of each word, the last one in its highest byte; None if any is no digit.

    The words are overwritten.
    """
    bad = np.zeros(word.shape, np.bool_)
    number = _number(word, bad)
    return None if bad.any() else number


def _eights(data: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """The eight bytes from each byte on, nothing copied."""
    return np.ndarray((len(data) - EIGHT + 1,), np.dtype("<u8"), data, 0, (1,))


def _number(word: NDArray[np.uint64], bad: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """The number of eight digits; the word is overwritten, and `bad` grows by those with a byte that is no digit."""
    check = word + _NO_DIGIT
    check |= word
    check &= _HIGH
    if check.any():
        bad |= check != 0
    for factor, by, mask in _STEPS:
        np.multiply(word, factor, out=check)
        word >>= by
        word += check
        word &= mask
    return word
