"""Plots as SVG by hand: axes, linear and logarithmic, and what is drawn on them. Colours are the page's CSS classes.

Why not matplotlib: its SVG has colours of its own written into every element, where these follow the page from light to
dark. A mark tells its figures when the mouse is on it, and text is text, which can be searched. `wdpm accuracy` writes
its page wherever wdpm is installed, with nothing added.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

MOST_TICKS = 7

LETTER_WIDTH, LINE_HEIGHT = 9.0, 17.0
"""Of labels [pixels]: those of the larger letters that a phone gets."""

MARK_REACH = 5.0

MARKERS = ("circle", "square", "triangle", "diamond", "down", "cross", "star")


@dataclass(frozen=True)
class Axis:
    """From values to places.

    Attributes:
        low, high: values at its ends.
        start, stop: where these are, in pixels.
        logarithmic: whether equal steps are equal factors.
    """

    low: float
    high: float
    start: float
    stop: float
    logarithmic: bool = False

    def at(self, value: float) -> float:
        """The place of a value; one beyond an end is put there."""
        if self.logarithmic:
            share = math.log(max(value, self.low) / self.low) / math.log(self.high / self.low)
        else:
            share = (value - self.low) / (self.high - self.low)
        return self.start + min(max(share, 0.0), 1.0) * (self.stop - self.start)

    def ticks(self) -> list[float]:
        """Round values between the ends."""
        return log_ticks(self.low, self.high) if self.logarithmic else linear_ticks(self.low, self.high)


def log_axis(values: Sequence[float], start: float, stop: float, room: float = 0.08) -> Axis:
    """An axis for positive values, with some room beyond them."""
    low, high = min(values), max(values)
    spread = max(math.log10(high / low), 0.3) * room
    return Axis(low * 10**-spread, high * 10**spread, start, stop, logarithmic=True)


def linear_axis(values: Sequence[float], start: float, stop: float) -> Axis:
    """An axis from 0 to a bit beyond the largest value."""
    high = max([*values, 0.0])
    return Axis(0.0, 1.08 * high if high > 0 else 1.0, start, stop)


def log_ticks(low: float, high: float) -> list[float]:
    """Round values in every decade, as many as there is room for; every second or third power of ten at last."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for steps in ((1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8), (1, 1.5, 2, 3, 5, 7), (1, 2, 5), (1, 3), (1,)):
        ticks = [step * 10.0**decade for decade in decades for step in steps]
        ticks = [tick for tick in ticks if low <= tick <= high]
        if len(ticks) <= MOST_TICKS:
            return ticks
    return ticks[:: -(-len(ticks) // MOST_TICKS)]


def linear_ticks(low: float, high: float) -> list[float]:
    """At most five multiples of 1, 2 or 5 times a power of ten."""
    if not high > low:
        return [low]
    step = 10.0 ** math.floor(math.log10((high - low) / 5))
    step *= next(factor for factor in (1, 2, 5, 10) if (high - low) / (step * factor) <= 5)
    first = math.ceil(low / step - 1e-9)
    return [number * step for number in range(first, math.floor(high / step + 1e-9) + 1)]


def frame(
    x: Axis, y: Axis, x_words: Callable[[float], str], y_words: Callable[[float], str], *, x_ticks: Sequence[float] = ()
) -> list[str]:
    """Grid lines, and ticks with their words."""
    parts = []
    for value in y.ticks():
        place = y.at(value)
        parts.append(f"<path class='grid' d='M{x.start:.1f} {place:.1f}H{x.stop:.1f}'/>")
        parts.append(text(x.start - 7, place + 4.5, y_words(value), "tick", "end"))
    for value in x_ticks or x.ticks():
        place = x.at(value)
        parts.append(f"<path class='grid' d='M{place:.1f} {y.start:.1f}V{y.stop:.1f}'/>")
        parts.append(text(place, y.start + 19, x_words(value), "tick", "middle"))
    return parts


def text(x: float, y: float, words: str, kind: str, anchor: str = "start", style: str = "") -> str:
    """A line of text of a CSS class."""
    style = f" style='{style}'" if style else ""
    return f"<text x='{x:.1f}' y='{y:.1f}' class='{kind}' text-anchor='{anchor}'{style}>{escape(words)}</text>"


def polyline(places: Sequence[tuple[float, float]], kind: str) -> str:
    """A line through places."""
    return f"<path class='{kind}' d='M{'L'.join(f'{x:.1f} {y:.1f}' for x, y in places)}'/>"


def marker(x: float, y: float, shape: str, kind: str, tip: str, size: float = 5.0) -> str:
    """A marker, with words for a pointer that rests on it."""
    title = f"<title>{escape(tip)}</title>"
    if shape == "circle":
        return f"<circle class='{kind}' cx='{x:.1f}' cy='{y:.1f}' r='{size:.1f}'>{title}</circle>"
    return f"<path class='{kind}' d='{_outline(x, y, shape, size)}'>{title}</path>"


def svg(width: float, height: float, words: str, parts: Sequence[str]) -> str:
    """A picture that scales with the page; `words` say what it shows to who cannot see it."""
    body = "\n".join(parts)
    return (
        f"<svg viewBox='0 0 {width:g} {height:g}' role='img' aria-label='{escape(words, quote=True)}'>\n{body}\n</svg>"
    )


@dataclass(frozen=True)
class Label:
    """Words beside a place.

    Attributes:
        kind: CSS class.
        room: pixels between the place and the words.
        before: whether to stand left of the place, if there is room.
    """

    x: float
    y: float
    words: str
    kind: str
    room: float = 10.0
    before: bool = False


def placed_labels(
    labels: Sequence[Label], marks: Sequence[tuple[float, float]], x: tuple[float, float], y: tuple[float, float]
) -> list[str]:
    """Labels beside their places, or as near as can be where none covers another, nor a mark.

    Args:
        marks: places of markers.
        x, y: between which ends labels may stand.
    """
    taken = [(mark_x - MARK_REACH, mark_x + MARK_REACH, mark_y) for mark_x, mark_y in marks]
    parts = []
    for label in labels:
        long = LETTER_WIDTH * len(label.words)
        left = label.before or label.x + label.room + long > x[1]
        left = left and label.x - label.room - long >= x[0]
        start = label.x - label.room - long if left else label.x + label.room
        tries = [label.y + LINE_HEIGHT * step * sign for step in range(12) for sign in (1, -1)]
        free = [each for each in tries if y[0] <= each <= y[1] and not _covers(taken, start, start + long, each)]
        height = free[0] if free else label.y
        taken.append((start, start + long, height))
        place = label.x - label.room if left else label.x + label.room
        parts.append(text(place, height + 4.5, label.words, label.kind, "end" if left else "start"))
    return parts


def _covers(taken: Sequence[tuple[float, float, float]], start: float, stop: float, y: float) -> bool:
    return any(start < other_stop and stop > other and abs(y - at) < LINE_HEIGHT for other, other_stop, at in taken)


def _outline(x: float, y: float, shape: str, size: float) -> str:
    s = size
    corners = {
        "square": [(-s, -s), (s, -s), (s, s), (-s, s)],
        "triangle": [(0, -1.25 * s), (1.15 * s, 0.85 * s), (-1.15 * s, 0.85 * s)],
        "diamond": [(0, -1.35 * s), (1.35 * s, 0), (0, 1.35 * s), (-1.35 * s, 0)],
        "down": [(0, 1.25 * s), (1.15 * s, -0.85 * s), (-1.15 * s, -0.85 * s)],
        "cross": [(s * a, s * b) for a, b in _CROSS],
        "star": [
            (
                s * (1.5 if i % 2 == 0 else 0.65) * math.sin(i * math.pi / 5),
                -s * (1.5 if i % 2 == 0 else 0.65) * math.cos(i * math.pi / 5),
            )
            for i in range(10)
        ],
    }[shape]
    return "M" + "L".join(f"{x + dx:.1f} {y + dy:.1f}" for dx, dy in corners) + "z"


_CROSS = (
    (-0.4, -1.2), (0.4, -1.2), (0.4, -0.4), (1.2, -0.4), (1.2, 0.4), (0.4, 0.4),
    (0.4, 1.2), (-0.4, 1.2), (-0.4, 0.4), (-1.2, 0.4), (-1.2, -0.4), (-0.4, -0.4),
)  # fmt: skip
