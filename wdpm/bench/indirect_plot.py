"""The plot of `wdpm bench indirect`: a panel a scene, a line for each way and number of photons, as one SVG file.

By hand for the reasons that wdpm/report/svg.py gives.
"""

from __future__ import annotations

from collections.abc import Sequence

from wdpm.bench.indirect import WAYS, Found, IndirectFigures
from wdpm.cluster.render_settings import Indirect
from wdpm.report.svg import Axis, log_axis, marker, polyline, text

_WIDTH, _PANEL, _LEFT, _RIGHT, _TOP, _BOTTOM = 760, 420, 84, 24, 66, 58
_COLOURS = {Indirect.MAP: "#b0413e", Indirect.GATHER: "#c78c1d", Indirect.CACHE: "#2f6f9f"}
_SHAPES = ("circle", "square", "triangle", "diamond", "down")
_STYLE = """<style>
text { font-family: sans-serif; font-size: 13px; fill: #222 }
.title { font-size: 16px }
.grid { stroke: #ddd; fill: none }
</style>"""


def plot(figures: Sequence[IndirectFigures]) -> str:
    """RMSE over CPU time, both logarithmic; each line goes through the numbers of samples at one number of photons."""
    height = _PANEL * len(figures)
    parts = [
        f"<svg xmlns='http://www.w3.org/2000/svg' width='{_WIDTH}' height='{height}'>",
        _STYLE,
        f"<rect width='{_WIDTH}' height='{height}' fill='white'/>",
    ]
    for row, each in enumerate(figures):
        parts += [f"<g transform='translate(0 {row * _PANEL})'>", *_panel(each), "</g>"]
    return "\n".join([*parts, "</svg>"]) + "\n"


def _panel(figures: IndirectFigures) -> list[str]:
    # A time below the clock's step, or an error of 0, has no place on such an axis; it is put at the end.
    x = log_axis([max(each.cost.cpu_s, 1e-3) for each in figures.found], _LEFT, _WIDTH - _RIGHT)
    y = log_axis([max(each.rmse, 1e-9) for each in figures.found], _PANEL - _BOTTOM, _TOP)
    width, height = figures.size
    parts = [text(12, 24, f"{figures.scene}, {width}x{height}: error against time", "title"), *_legend(figures)]
    parts += _frame(x, y)
    for way in WAYS:
        for photons, shape in zip(figures.sweep.photons, _shapes(figures), strict=True):
            parts += _line(x, y, [each for each in figures.found_by(way) if each.choice.photons == photons], shape)
    return parts


def _legend(figures: IndirectFigures) -> list[str]:
    parts, left = [], 18.0
    for way in WAYS:
        parts += [f"<rect x='{left - 6}' y='40' width='12' height='12' fill='{_COLOURS[way]}'/>"]
        parts += [text(left + 12, 51, way.value, "key")]
        left += 84
    for photons, shape in zip(figures.sweep.photons, _shapes(figures), strict=True):
        parts += [marker(left, 46, shape, "key", f"{photons:,} photons")]
        parts += [text(left + 12, 51, f"{photons:,} photons", "key")]
        left += 136
    return parts


def _shapes(figures: IndirectFigures) -> list[str]:
    """One for each number of photons; beyond five they repeat."""
    return [_SHAPES[number % len(_SHAPES)] for number in range(len(figures.sweep.photons))]


def _frame(x: Axis, y: Axis) -> list[str]:
    parts = []
    for value in y.ticks():
        parts.append(f"<path class='grid' d='M{x.start:.1f} {y.at(value):.1f}H{x.stop:.1f}'/>")
        parts.append(text(x.start - 7, y.at(value) + 4.5, f"{value:g}", "tick", "end"))
    for value in x.ticks():
        parts.append(f"<path class='grid' d='M{x.at(value):.1f} {y.start:.1f}V{y.stop:.1f}'/>")
        parts.append(text(x.at(value), y.start + 19, f"{value:g} s", "tick", "middle"))
    parts.append(text((x.start + x.stop) / 2, y.start + 42, "CPU time of all threads", "tick", "middle"))
    middle = (y.start + y.stop) / 2
    parts.append(f"<text transform='translate(22 {middle:.0f}) rotate(-90)' text-anchor='middle'>RMSE</text>")
    return parts


def _line(x: Axis, y: Axis, found: Sequence[Found], shape: str) -> list[str]:
    colour = _COLOURS[found[0].choice.way]
    places = [(x.at(each.cost.cpu_s), y.at(each.rmse)) for each in found]
    parts = [
        f"<g fill='none' stroke='{colour}' stroke-width='1.6'>{polyline(places, 'line')}</g>",
        f"<g fill='{colour}'>",
    ]
    for each, place in zip(found, places, strict=True):
        tip = f"{each.choice.way.value}, {each.choice.photons:,} photons, {each.choice.spp} samples: {each.rmse:.5f}"
        parts.append(marker(*place, shape, "mark", tip))
    return [*parts, "</g>"]
