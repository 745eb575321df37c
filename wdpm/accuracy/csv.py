"""points.csv: one line a point, with everything that was turned and everything that was found."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from typing import Any

from wdpm.accuracy.error import SplitError
from wdpm.accuracy.knobs import KNOBS
from wdpm.accuracy.result import Accuracy, PointFigures
from wdpm.report.report import ErrorFigure


def to_csv(found: Accuracy) -> str:
    """One line a point, with a heading. A knob that was left to the renderer is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for point in found.points:
        writer.writerow([column(found, point) for column in _COLUMNS.values()])
    return text.getvalue()


_Column = Callable[[Accuracy, PointFigures], Any]


def _knob(name: str) -> _Column:
    """Of a knob: on its own curve what it was turned to, which at the base may be what the renderer chose."""

    def column(found: Accuracy, point: PointFigures) -> Any:
        curve = found.curve_of(name)
        if curve is not None and point.number in curve.points:
            return curve.values[curve.points.index(point.number)]
        return point.slaves if name == "slaves" else _plain(point.settings[name])

    return column


def _setting(name: str) -> _Column:
    return lambda _, point: _plain(point.settings[name])


def _plain(value: Any) -> Any:
    """For one cell."""
    return ",".join(value) if isinstance(value, list | tuple) else value


def _part(metric: str, part: str, figure: str) -> _Column:
    def column(_: Accuracy, point: PointFigures) -> float:
        split: SplitError = getattr(point, metric)
        whole: ErrorFigure = getattr(split, part)
        value: float = getattr(whole, figure)
        return value

    return column


def _split_columns(metric: str) -> dict[str, _Column]:
    return {
        f"{metric}_{part}{suffix}": _part(metric, part, figure)
        for part in ("error", "noise", "bias")
        for figure, suffix in (("value", ""), ("low", "_low"), ("high", "_high"))
    }


def _band(name: str) -> _Column:
    return lambda _, point: "" if point.band is None else getattr(point.band, name)


_COLUMNS: dict[str, _Column] = {
    "point": lambda _, point: point.number,
    "name": lambda _, point: point.name,
    **{knob.name: _knob(knob.name) for knob in KNOBS},
    **{name: _setting(name) for name in ("integrator", "max_depth", "without")},
    "wall_seconds": lambda _, point: point.wall_seconds,
    "cpu_seconds": lambda _, point: point.cpu_seconds,
    **_split_columns("rel_mse"),
    **_split_columns("mse"),
    "on_front": lambda all_of_it, point: point.number in all_of_it.front,
    "stored": lambda _, point: point.stored,
    "ghosts": lambda _, point: point.ghosts,
    "bytes": lambda _, point: point.bytes,
    "left_band": lambda _, point: point.left_band,
    "bits_as_base": lambda _, point: point.bits_as_base,
    **{f"band_{name}": _band(name) for name in ("mse", "rel_mse", "max_abs", "pixels", "bits_equal")},
    "command": lambda _, point: point.command,
}
