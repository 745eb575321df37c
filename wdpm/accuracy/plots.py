"""The plots of a sweep: error against time, noise and bias, the band, slaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape

from wdpm.accuracy.result import Accuracy, CurveFigures, PointFigures
from wdpm.accuracy.words import clock_words
from wdpm.report.svg import (
    MARKERS,
    Axis,
    Label,
    frame,
    linear_axis,
    log_axis,
    marker,
    placed_labels,
    polyline,
    svg,
    text,
)
from wdpm.report.tables import format_seconds

ON_PLOTS_OF_THEIR_OWN = ("band", "slaves")
"""Knobs whose curves say nothing about the error against the reference."""

_WIDTH, _HEIGHT = 760.0, 520.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 66.0, 20.0, 20.0, 52.0


def quality_curves(found: Accuracy) -> list[CurveFigures]:
    """Curves whose knobs are about quality."""
    return [curve for curve in found.curves if curve.knob not in ON_PLOTS_OF_THEIR_OWN]


def style_of(found: Accuracy, curve: CurveFigures) -> tuple[str, str]:
    """The CSS class of a curve's colour, and its marker."""
    number = quality_curves(found).index(curve)
    return f"c{number % 8}", MARKERS[number % len(MARKERS)]


def error_plot(found: Accuracy) -> str:
    """relMSE against time, log-log, one curve per knob, and the Pareto front."""
    shown = _shown(found)
    x = log_axis([point.seconds for point in shown], _LEFT, _WIDTH - _RIGHT, 0.1)
    y = log_axis([_positive(point) for point in shown], _HEIGHT - _BOTTOM, _TOP, 0.1)
    parts = frame(x, y, _seconds_words, _number_words)
    parts.append(text(_WIDTH - _RIGHT, _HEIGHT - 10, f"{clock_words(found)} of a render", "axis", "end"))
    parts.append(text(_LEFT + 6, _TOP + 4, "relMSE", "axis"))
    parts.append(_front_line(found, x, y))
    base = x.at(found.base.seconds), y.at(_positive(found.base))
    labels = [Label(*base, "base", "basetext", 13.0)]
    for curve in quality_curves(found):
        colour, shape = style_of(found, curve)
        points = [found.points[number] for number in curve.points]
        places = [(x.at(point.seconds), y.at(_positive(point))) for point in points]
        parts += _lines(curve, places, colour)
        parts += [_whisker(x, y, point, colour) for point in points]
        for number, place, point, word in zip(curve.points, places, points, curve.words, strict=True):
            if number != curve.base:
                parts.append(marker(*place, shape, f"mark {colour}", _tip(f"{curve.label} {word}", point)))
        labels += _labels(curve, places, colour, base[0])
    parts.append(marker(*base, "circle", "base", _tip("base", found.base), 7))
    marks = [(x.at(point.seconds), y.at(_positive(point))) for point in shown]
    parts += placed_labels(labels, marks, (_LEFT, _WIDTH), (y.stop + 12, y.start - 8))
    return svg(_WIDTH, _HEIGHT, "relMSE against the time of a render, one curve for each knob", parts)


def legend(found: Accuracy) -> str:
    """Names of the curves, with their markers."""
    chips = []
    for curve in quality_curves(found):
        colour, shape = style_of(found, curve)
        icon = svg(18, 14, curve.label, [marker(9, 7, shape, f"mark {colour}", curve.label, 4.5)])
        chips.append(f"<span class='chip'>{icon}{escape(curve.label)}</span>")
    icon = svg(22, 14, "Pareto front", [polyline([(1, 7), (21, 7)], "front")])
    chips.append(f"<span class='chip long'>{icon}Pareto front</span>")
    return f"<p class='legend'>{''.join(chips)}</p>"


def split_bars(found: Accuracy, curve: CurveFigures) -> str:
    """Noise and bias of a curve's points, stacked; a line for the interval of their sum."""
    points = [found.points[number] for number in curve.points]
    most = max(max(point.rel_mse.error.high, point.rel_mse.noise.value) for point in points)
    rows = []
    for number, point, word in zip(curve.points, points, curve.words, strict=True):
        split = point.rel_mse
        noise, bias = max(split.noise.value, 0.0), max(split.bias.value, 0.0)
        tip = f"noise {split.noise.value:.3g}, bias² {split.bias.value:.3g}"
        low, high = (_percent(max(value, 0.0), most) for value in (split.error.low, split.error.high))
        mine = " own" if number == curve.base else ""
        rows.append(
            f"<div class='bar{mine}' title='{escape(tip, quote=True)}'><span class='value'>{escape(word)}</span>"
            f"<span class='track'><i class='noise' style='width:{_percent(noise, most):.2f}%'></i>"
            f"<i class='bias' style='width:{_percent(bias, most):.2f}%'></i>"
            f"<b style='left:{low:.2f}%;width:{max(high - low, 0.2):.2f}%'></b></span>"
            f"<span class='sum'>{split.error.value:.2g}</span></div>"
        )
    return f"<section class='panel'><h3>{escape(curve.label)}</h3>{''.join(rows)}</section>"


def band_plots(found: Accuracy, curve: CurveFigures) -> str:
    """Error, ghosts, traffic and time against the width of the band."""
    points = [found.points[number] for number in curve.points]
    errors = [0.0 if point.band is None else point.band.mse for point in points]
    panels = [
        _band_panel("mean squared error", curve, errors, _scientific, zero=True),
        _band_panel("ghost photons", curve, [float(point.ghosts) for point in points], _count_words),
        _band_panel("sent by slaves [MB]", curve, [point.bytes / 2**20 for point in points], "{:.3g}".format),
        _band_panel(clock_words(found), curve, [point.seconds for point in points], _seconds_words),
    ]
    return f"<div class='small'>{''.join(panels)}</div>"


def slaves_plot(found: Accuracy, curve: CurveFigures) -> str:
    """Time against the number of slaves."""
    seconds = [found.points[number].seconds for number in curve.points]
    return f"<div class='small'>{_band_panel(clock_words(found), curve, seconds, _seconds_words)}</div>"


def _band_panel(
    title: str, curve: CurveFigures, heights: Sequence[float], words: Callable[[float], str], zero: bool = False
) -> str:
    """A small plot over a knob's values. With `zero`, logarithmic, and what is exactly 0 lies on a line of its own."""
    width, height = 300.0, 210.0
    numbers = [float(value) for value in curve.values]
    x = Axis(min(numbers), max(numbers), 68, width - 18)
    positive = [value for value in heights if value > 0]
    bottom = height - 44
    logarithmic = zero and bool(positive)
    y = (
        log_axis(positive, bottom - 34 if len(positive) < len(heights) else bottom, 40)
        if logarithmic
        else linear_axis(heights, bottom, 40)
    )
    floor = Axis(y.low, y.high, bottom, y.stop, y.logarithmic)  # vertical lines reach down to the line of zeros
    parts = [text(8, 20, title, "title")]
    parts += frame(x, y, lambda _: "", words, x_ticks=numbers)
    parts += [
        text(x.at(value), bottom + 19, word, "tick", "middle") for value, word in zip(numbers, curve.words, strict=True)
    ]
    if logarithmic and floor.start != y.start:
        parts.append(f"<path class='grid' d='M{x.start:.1f} {bottom:.1f}H{x.stop:.1f}'/>")
        parts.append(text(x.start - 7, bottom + 4.5, "exactly 0", "tick", "end"))
    places = [
        (x.at(number), bottom if logarithmic and not value > 0 else y.at(value))
        for number, value in zip(numbers, heights, strict=True)
    ]
    parts.append(polyline(places, "line c0"))
    for place, value, word in zip(places, heights, curve.words, strict=True):
        exact = "exactly 0" if zero and value == 0 else words(value)
        parts.append(marker(*place, "circle", "mark c0", f"{curve.label} {word}: {exact}", 4.5))
    parts.append(text(x.stop, height - 6, _X_WORDS[curve.knob], "axis", "end"))
    return svg(width, height, f"{title} against {curve.label}", parts)


_X_WORDS = {"band": "band / gather radius", "slaves": "slaves"}


def _shown(found: Accuracy) -> list[PointFigures]:
    numbers = {0, *found.front, *(number for curve in quality_curves(found) for number in curve.points)}
    return [found.points[number] for number in sorted(numbers)]


def _positive(point: PointFigures) -> float:
    """An error for a logarithmic axis: one that is not above zero is put at the end of its interval."""
    error = point.rel_mse.error
    return error.value if error.value > 0 else max(error.high, 1e-12)


def _front_line(found: Accuracy, x: Axis, y: Axis) -> str:
    """A staircase: nothing that was tried lies left of it and below it."""
    points = [found.points[number] for number in found.front]
    places = []
    for i, point in enumerate(points):
        places.append((x.at(point.seconds), y.at(_positive(point))))
        after = x.at(points[i + 1].seconds) if i + 1 < len(points) else x.stop
        places.append((after, y.at(_positive(point))))
    return polyline(places, "front")


def _whisker(x: Axis, y: Axis, point: PointFigures, colour: str) -> str:
    error = point.rel_mse.error
    low, high = y.at(max(error.low, y.low)), y.at(max(error.high, y.low))
    return f"<path class='whisker {colour}' d='M{x.at(point.seconds):.1f} {low:.1f}V{high:.1f}'/>"


def _labels(curve: CurveFigures, places: Sequence[tuple[float, float]], colour: str, base: float) -> list[Label]:
    """Words for both ends of a curve, or for every choice, away from the base, which has words of its own."""
    ends = range(len(places)) if is_choice(curve) else dict.fromkeys((0, len(places) - 1))
    return [
        Label(*places[i], f"{curve.label} {curve.words[i]}", f"label {colour}", before=places[i][0] < base)
        for i in ends
        if curve.points[i] != curve.base
    ]


def is_choice(curve: CurveFigures) -> bool:
    """Whether values have no order, so that no line leads through them."""
    return any(isinstance(value, str) for value in curve.values)


def _lines(curve: CurveFigures, places: Sequence[tuple[float, float]], colour: str) -> list[str]:
    """Through all points; from the base to each choice."""
    if not is_choice(curve):
        return [polyline(places, f"line {colour}")]
    base = places[curve.points.index(curve.base)]
    return [polyline([base, place], f"line {colour} loose") for place in places if place != base]


def _tip(name: str, point: PointFigures) -> str:
    split = point.rel_mse
    return (
        f"{name}: relMSE {split.error.value:.3g} ({split.error.low:.2g} to {split.error.high:.2g}), "
        f"noise {split.noise.value:.2g}, bias² {split.bias.value:.2g}, {format_seconds(point.seconds)}"
    )


def _percent(value: float, most: float) -> float:
    return min(100 * value / most, 100.0) if most > 0 else 0.0


def _seconds_words(value: float) -> str:
    return f"{value:.4g} s"


def _number_words(value: float) -> str:
    return f"{value:.4g}" if value >= 1e-4 else f"{value:.0e}"


def _scientific(value: float) -> str:
    return f"{value:.0e}".replace("e-0", "e-")


def _count_words(value: float) -> str:
    for unit, size in (("M", 1e6), ("k", 1e3)):
        if value >= size:
            return f"{value / size:.3g}{unit}"
    return f"{value:.3g}"
