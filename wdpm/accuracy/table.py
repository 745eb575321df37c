"""The results of a sweep on the terminal: sentences, a table of all points, the Pareto front."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wdpm.accuracy.result import Accuracy, PointFigures
from wdpm.accuracy.words import band_sentence, summary, warnings
from wdpm.report.grid import Grid
from wdpm.report.report import ErrorFigure
from wdpm.report.tables import format_bytes, format_seconds

if TYPE_CHECKING:
    from rich.console import Console


def print_accuracy(found: Accuracy, console: Console) -> None:
    """For people."""
    console.print()
    console.print(" ".join(summary(found)), markup=False, highlight=False)
    for line in (band_sentence(found), *warnings(found)):
        if line is not None:
            console.print(line, markup=False, highlight=False)
    for grid in grids_of(found):
        grid.print(console)


def grids_of(found: Accuracy) -> list[Grid]:
    """The table of all points by knob, that of the band, and the Pareto front."""
    columns = ("point", "time", "CPU", "relMSE", "95 %", "noise", "bias²")
    rows = [_row(found.base, "base")]
    for curve in found.curves:
        for number, word in zip(curve.points, curve.words, strict=True):
            if number:
                rows.append(_row(found.points[number], f"{curve.label} {word}"))
    notes: tuple[str, ...] = (
        f"{len(found.seeds)} seeds a point, one knob turned at a time; time: median, without loading and compiling "
        f"({format_seconds(found.compile_seconds)} in all). relMSE = noise + bias²; bias² below 0: none to be seen.",
        f"reference: {found.reference}"
        + ("" if found.reference_noise is None else f"; its own noise, {found.reference_noise:.2g}, is subtracted"),
    )
    if found.trim:
        notes += (
            f"{found.trim:.2%} of the pixels, those that make up the most of the errors of all points, are left out.",
        )
    grids = [Grid(f"{found.scene}, {found.width}x{found.height}", columns, tuple(rows), notes)]
    band = found.curve_of("band")
    if band is not None:
        grids.append(_band(found, band.points, band.words))
    front = tuple(_row(found.points[number], found.points[number].name) for number in found.front)
    grids.append(Grid("Pareto front: no point is faster and has a smaller error", columns, front))
    return grids


def _row(point: PointFigures, name: str) -> tuple[str, ...]:
    split = point.rel_mse
    return (
        name,
        format_seconds(point.wall_seconds),
        format_seconds(point.cpu_seconds),
        f"{split.error.value:.3g}",
        _interval(split.error),
        f"{split.noise.value:.2g}",
        f"{split.bias.value:.2g}",
    )


def _band(found: Accuracy, numbers: tuple[int, ...], words: tuple[str, ...]) -> Grid:
    rows = []
    for number, word in zip(numbers, words, strict=True):
        point = found.points[number]
        if point.band is None:
            raise ValueError(f"point {number} of the band's curve was not held against the exact image")
        rows.append(
            (
                word,
                f"{point.band.mse:.2e}" if point.band.mse else "0",
                f"{point.band.max_abs:.2g}",
                "equal" if point.band.bits_equal else f"{point.band.pixels:.1%} differ",
                f"{point.ghosts:,}",
                format_bytes(point.bytes),
                format_seconds(point.seconds),
            )
        )
    columns = ("band", "MSE", "largest", "bits", "ghosts", "sent", "time")
    slaves = found.points[numbers[0]].slaves
    return Grid(f"The band, {slaves} slaves: error against the exact image", columns, tuple(rows))


def _interval(figure: ErrorFigure) -> str:
    return f"{figure.low:.2g} to {figure.high:.2g}"
