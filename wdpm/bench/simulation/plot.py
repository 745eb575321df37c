"""The plot of `wdpm bench scaling --simulate`: speed-up over slaves, a panel a scene, as one SVG file.

By hand for the reasons that wdpm/report/svg.py gives.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from wdpm.bench.simulation.figures import Run, Simulation
from wdpm.report.svg import Axis, frame, marker, polyline, text

_WIDTH, _PANEL, _COLUMNS, _LEFT, _RIGHT, _TOP, _BOTTOM = 420, 330, 2, 56, 20, 62, 50
_COLOURS = {"auto": "#2f6f9f", "none": "#b0413e"}
_WORDS = {"auto": "copies auto", "none": "copies none"}
_STYLE = """<style>
text { font-family: sans-serif; font-size: 13px; fill: #222 }
.title { font-size: 15px }
.grid { stroke: #ddd; fill: none }
.ideal { stroke: #888; stroke-dasharray: 5 4; fill: none }
.auto { stroke: #2f6f9f; fill: none; stroke-width: 2 }
.none { stroke: #b0413e; fill: none; stroke-width: 2 }
.at-auto { fill: #2f6f9f }
.at-none { fill: #b0413e }
</style>"""


def plot(scenes: Sequence[Simulation]) -> str:
    """Speed-up over the number of slaves, both logarithmic; dashed: as many times as fast as there are slaves."""
    columns = min(_COLUMNS, len(scenes))
    width, height = _WIDTH * columns, _PANEL * -(-len(scenes) // columns)
    parts = [
        f"<svg xmlns='http://www.w3.org/2000/svg' width='{width}' height='{height}'>",
        _STYLE,
        f"<rect width='{width}' height='{height}' fill='white'/>",
    ]
    most = max((run.slaves for scene in scenes for run in scene.runs), default=2)
    for number, scene in enumerate(scenes):
        place = f"{number % columns * _WIDTH} {number // columns * _PANEL}"
        parts += [f"<g transform='translate({place})'>", *_panel(scene, most), "</g>"]
    return "\n".join([*parts, "</svg>"]) + "\n"


def _panel(scene: Simulation, most: int) -> list[str]:
    x = Axis(1.0, max(most, 2), _LEFT, _WIDTH - _RIGHT, logarithmic=True)
    low = min([0.5, *(run.speed_up for run in scene.runs)])
    y = Axis(low, max(most, 2), _PANEL - _BOTTOM, _TOP, logarithmic=True)
    ticks = [float(1 << power) for power in range(max(most, 2).bit_length())]
    parts = [text(12, 22, name_of(scene.scene), "title"), text(_LEFT, _PANEL - 12, "slaves", "tick")]
    parts += frame(x, y, lambda value: f"{value:g}", lambda value: f"{value:g}", x_ticks=ticks)
    parts.append(polyline([(x.at(1.0), y.at(1.0)), (x.at(most), y.at(most))], "ideal"))
    left = float(_LEFT)
    for copies, colour in _COLOURS.items():
        runs = [run for run in scene.runs if run.copies == copies]
        if runs:
            parts += [f"<rect x='{left}' y='34' width='12' height='12' fill='{colour}'/>"]
            parts += [text(left + 17, 45, _WORDS[copies], "key"), *_line(x, y, runs)]
            left += 120
    return parts


def _line(x: Axis, y: Axis, runs: Sequence[Run]) -> list[str]:
    kind = runs[0].copies
    places = [(x.at(run.slaves), y.at(run.speed_up)) for run in runs]
    marks = (
        marker(*place, "circle", f"at-{kind}", f"{run.slaves} slaves: {run.speed_up:.2f}; most lost to {run.limit}", 4)
        for place, run in zip(places, runs, strict=True)
    )
    return [polyline([(x.at(1.0), y.at(1.0)), *places], kind), *marks]


def name_of(scene: str) -> str:
    """Of a file scene.xml the folder tells more."""
    path = Path(scene)
    return path.parent.name if path.stem == "scene" and path.parent.name else path.stem
