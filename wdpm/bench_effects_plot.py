"""The plot of `wdpm bench effects`: a bar for each effect, as an SVG file that needs nothing else."""

from __future__ import annotations

from html import escape

from wdpm.bench_effects import EffectFigures, SceneFigures

_WIDTH, _LABEL, _BAR, _GAP, _TOP, _BOTTOM, _FIGURE = 860, 130, 14, 14, 64, 56, 150
_OWN, _ALL, _BOX = "#2f6f9f", "#c9ced3", "#b0413e"
_FONT = "font-family='sans-serif' font-size='13'"


def plot(figures: EffectFigures) -> str:
    """CPU time of each scene, over that of the diffuse box with kernels of its own."""
    unit = figures.scenes[0].own.cpu_seconds
    most = max(max(each.own.cpu_seconds, each.all_effects.cpu_seconds) for each in figures.scenes) / unit
    scale = (_WIDTH - _LABEL - _FIGURE) / most
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
    own, everything = figures.own.cpu_seconds / unit, figures.all_effects.cpu_seconds / unit
    return [
        f"<text x='{_LABEL - 8}' y='{top + _BAR + 5}' text-anchor='end'>{escape(figures.name)}</text>",
        f"<rect x='{_LABEL}' y='{top}' width='{own * scale:.1f}' height='{_BAR}' fill='{_OWN}'/>",
        f"<text x='{_LABEL + own * scale + 6:.1f}' y='{top + _BAR - 3}'>{own:.2f}</text>",
        f"<rect x='{_LABEL}' y='{top + _BAR}' width='{everything * scale:.1f}' height='{_BAR}' fill='{_ALL}'/>",
        f"<text x='{_LABEL + everything * scale + 6:.1f}' y='{top + 2 * _BAR - 3}'>{everything:.2f}</text>",
    ]
