"""The plot of `wdpm bench effects`: a bar for each effect, as an SVG file that needs nothing else.

By hand for the reasons that wdpm/report/svg.py gives: it is four kB of text.
"""

from __future__ import annotations

from html import escape

from wdpm.bench.effects import EffectFigures, SceneFigures
from wdpm.bench.effects_scenes import EVERYTHING

_WIDTH, _LABEL, _BAR, _GAP, _TOP, _BOTTOM, _FIGURE = 860, 130, 14, 14, 64, 56, 150
_LONGEST = _WIDTH - _LABEL - _FIGURE
_OWN, _ALL, _BOX = "#2f6f9f", "#c9ced3", "#b0413e"
_FONT = "font-family='sans-serif' font-size='13'"


def plot(figures: EffectFigures) -> str:
    """CPU time of each scene, over that of the diffuse box with kernels of its own.

    The scale is that of single effects; a longer bar is cut off, with a gap that shows it, and its figure.
    """
    unit = figures.scenes[0].own.cpu_seconds
    single = [each for each in figures.scenes if each.name != EVERYTHING] or figures.scenes
    scale = _LONGEST * unit / max(max(each.own.cpu_seconds, each.all_effects.cpu_seconds) for each in single)
    height = _TOP + len(figures.scenes) * (2 * _BAR + _GAP) + _BOTTOM
    parts = [
        f"<svg xmlns='http://www.w3.org/2000/svg' width='{_WIDTH}' height='{height}' {_FONT}>",
        f"<rect width='{_WIDTH}' height='{height}' fill='white'/>",
        "<text x='12' y='24' font-size='16'>What each effect costs where a scene calls for it</text>",
        *_legend(),
    ]
    for row, each in enumerate(figures.scenes):
        parts += _bars(each, _TOP + row * (2 * _BAR + _GAP), unit, scale)
    line = _LABEL + scale
    parts.append(f"<path d='M{line:.1f} {_TOP - 6}V{height - _BOTTOM}' stroke='{_BOX}' stroke-dasharray='4 3'/>")
    box = figures.scenes[0]
    gain = box.all_effects.cpu_seconds / box.own.cpu_seconds
    equal = "equal in every scene" if all(each.bits_equal for each in figures.scenes) else "NOT EQUAL"
    parts += [
        f"<text x='12' y='{height - 32}'>Dashed: the diffuse box, which pays for none of them. "
        f"With all effects compiled in it takes {gain:.2f} times as long.</text>",
        f"<text x='12' y='{height - 12}'>Bits of both kinds of kernels: {equal}.</text>",
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _legend() -> list[str]:
    return [
        f"<rect x='12' y='36' width='12' height='12' fill='{_OWN}'/>",
        "<text x='30' y='47'>kernels for what the scene calls for</text>",
        f"<rect x='300' y='36' width='12' height='12' fill='{_ALL}'/>",
        "<text x='318' y='47'>all effects compiled in</text>",
        "<text x='500' y='47'>CPU time, in times the diffuse box</text>",
    ]


def _bars(figures: SceneFigures, top: int, unit: float, scale: float) -> list[str]:
    label = escape(figures.name)
    own, everything = figures.own.cpu_seconds / unit, figures.all_effects.cpu_seconds / unit
    return [
        f"<text x='{_LABEL - 8}' y='{top + _BAR + 5}' text-anchor='end'>{label}</text>",
        *_bar(top, own, scale, _OWN),
        *_bar(top + _BAR, everything, scale, _ALL),
    ]


def _bar(top: int, value: float, scale: float, color: str) -> list[str]:
    length = min(value * scale, _LONGEST)
    parts = [
        f"<rect x='{_LABEL}' y='{top}' width='{length:.1f}' height='{_BAR}' fill='{color}'/>",
        f"<text x='{_LABEL + length + 6:.1f}' y='{top + _BAR - 3}'>{value:.2f}</text>",
    ]
    if value * scale > _LONGEST * (1 + 1e-9):
        gap = _LABEL + 0.9 * _LONGEST
        parts.append(f"<path d='M{gap:.1f} {top + _BAR}l8 {-_BAR}h8l-8 {_BAR}z' fill='white'/>")
    return parts
