"""The page of a sweep: one HTML file that needs nothing else, in light and dark, on a desk and on a phone.

No templates: there is one page, and its sections are functions of the sweep, which the type checker follows into what
they say. What comes from files or the command line is escaped where it enters. An engine such as jinja2 would be one
more package to install, for little markup.
"""

from __future__ import annotations

from html import escape
from pathlib import Path

from wdpm.accuracy.error import Truth
from wdpm.accuracy.plots import band_plots, error_plot, legend, quality_curves, slaves_plot, split_bars
from wdpm.accuracy.result import Accuracy, PointFigures
from wdpm.accuracy.strips import look_of, strips
from wdpm.accuracy.style import STYLE
from wdpm.accuracy.words import band_sentence, listed, summary, warnings
from wdpm.report.report import ErrorFigure
from wdpm.report.tables import format_seconds


def page_of(found: Accuracy, folder: Path, truth: Truth) -> str:
    """The page, as HTML.

    Raises:
        ImageError: an image of the folder cannot be read.
    """
    title = (
        f"Accuracy of {Path(found.scene).parent.name or found.scene}"
        if found.scene.endswith("scene.xml")
        else (f"Accuracy of {Path(found.scene).stem}")
    )
    parts = [_head(title, found), _error(found), _front(found), _split(found)]
    if found.curve_of("band"):
        parts.append(_band(found))
    if found.curve_of("slaves"):
        parts.append(_slaves(found))
    look = look_of(found, folder, truth)
    parts += [_images(strips(found, folder, truth, look)), _table(found), _method(found)]
    body = "\n".join(parts)
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>\n<body><main>\n{body}\n</main></body></html>\n"
    )


def _head(title: str, found: Accuracy) -> str:
    cores = found.machine["threads"]
    facts = (
        f"{escape(found.scene)} · {found.width}×{found.height} · {len(found.points)} points × {len(found.seeds)} seeds"
        f" · {cores} thread{'s' if cores != 1 else ''}"
    )
    text = [f"<h1>{escape(title)}</h1><p class='facts'>{facts}</p>{_lede(summary(found))}"]
    text += [f"<p class='warn'>{escape(line)}</p>" for line in warnings(found)]
    return "<header>" + "".join(text) + "</header>"


def _lede(sentences: list[str]) -> str:
    first, rest = escape(sentences[0]), escape(" ".join(sentences[1:]))
    return f"<p class='lede'><strong>{first}</strong> {rest}</p>"


_CLOCK = {"wall": "", "cpu": " Time is CPU time, of all cores together."}


def _error(found: Accuracy) -> str:
    return _section(
        "What an error costs",
        "One knob is turned at a time, from the base. Lower is better, left is cheaper: a curve that falls steeply is "
        f"worth its time, a flat one is not. Bars are 95 % intervals.{_CLOCK[found.clock]}",
        f"<div class='plot'>{error_plot(found)}</div>{legend(found)}",
    )


def _front(found: Accuracy) -> str:
    items = []
    for number in found.front:
        point = found.points[number]
        items.append(
            f"<li><p><b>{format_seconds(point.seconds)}</b> relMSE {point.rel_mse.error.value:.2g} "
            f"<span>{escape(point.name)}</span></p><code>{escape(point.command)}</code></li>"
        )
    return _section(
        "The best of these points",
        "The Pareto front: no other point is both faster and closer.",
        f"<ol class='best'>{''.join(items)}</ol>",
    )


def _split(found: Accuracy) -> str:
    panels = "".join(split_bars(found, curve) for curve in quality_curves(found))
    return _section(
        "Where the error comes from",
        "Noise is what another seed would change; bias, squared, is what it would not: the blur of the density "
        "estimate, and what is approximated. Each knob has a scale of its own; the line is the interval of the sum.",
        "<p class='legend'><span class='chip'><i class='swatch noise'></i>noise</span>"
        f"<span class='chip'><i class='swatch bias'></i>bias²</span></p><div class='panels'>{panels}</div>",
    )


def _band(found: Accuracy) -> str:
    curve = found.curve_of("band")
    if curve is None:
        raise ValueError("there is no curve of the band")
    slaves = found.points[curve.base].slaves
    return _section(
        "The band",
        f"{band_sentence(found)} With {slaves} slaves, which share this machine's cores.",
        band_plots(found, curve),
    )


def _slaves(found: Accuracy) -> str:
    curve = found.curve_of("slaves")
    if curve is None:
        raise ValueError("there is no curve of slaves")
    same = all(found.points[number].bits_as_base for number in curve.points)
    text = (
        f"Images of {listed(curve.words)} slaves are the same, bit for bit."
        if same
        else "IMAGES DIFFER between numbers of slaves: this is a bug, please report it."
    )
    return _section(
        "Slaves",
        f"{text} They share this machine's cores, so time shows what distribution costs.",
        slaves_plot(found, curve),
    )


def _images(pictures: str) -> str:
    return _section("How it looks", "The lowest and the highest value of each knob.", pictures)


def _table(found: Accuracy) -> str:
    names = ("point", "time", "CPU", "relMSE", "95 %", "noise", "bias²", "MSE", "command")
    heading = "".join(f"<th>{name}</th>" for name in names)
    rows = [_row(point, point.number in found.front) for point in found.points]
    return _section(
        "All points",
        "★ is on the Pareto front. Times are medians over seeds, without loading the scene and compiling kernels. The "
        "same figures, and more, are in points.csv and points.json beside this page; images of every seed are in "
        "renders/.",
        f"<div class='wide'><table><thead><tr>{heading}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>",
    )


def _row(point: PointFigures, on_front: bool) -> str:
    split = point.rel_mse
    cells = [
        f"{'★ ' if on_front else ''}{escape(point.name)}",
        format_seconds(point.wall_seconds),
        format_seconds(point.cpu_seconds),
        f"{split.error.value:.3g}",
        _interval(split.error),
        f"{split.noise.value:.2g}",
        f"{split.bias.value:.2g}",
        f"{point.mse.error.value:.2g}",
        f"<details><summary>show</summary><code>{escape(point.command)}</code></details>",
    ]
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def _method(found: Accuracy) -> str:
    noise = found.reference_noise
    own = "" if noise is None else f" Its own noise, a relMSE of {noise:.2g}, is measured and subtracted."
    left_out = (
        f" The {found.trim:.2%} of the pixels that make up the most of the errors of all points are left out."
        if found.trim
        else ""
    )
    machine = ", ".join(f"{name} {value}" for name, value in found.machine.items())
    lines = (
        f"Reference: {found.reference}.{own}",
        f"relMSE is the mean of (render − reference)² / (reference² + 0.01) over pixels and channels.{left_out}",
        f"With the images x of {len(found.seeds)} seeds, bias² is the mean of (x − b)(y − b) over pairs of different "
        "seeds, noise the rest: both unbiased, so bias² can come out below 0 where there is none. Intervals are of "
        "95 %, by a jackknife over seeds in 16 blocks along the image's longer side.",
        "Renders were made seed by seed and otherwise in random order, in one process that stayed warm; compiling took "
        f"{format_seconds(found.compile_seconds)} in all, apart. CPU is all cores together.",
        f"Machine: {machine}.",
    )
    return _section(
        "How this was measured", "", "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"
    )


def _section(title: str, words: str, body: str) -> str:
    said = f"<p>{escape(words)}</p>" if words else ""
    return f"<section><h2>{escape(title)}</h2>{said}{body}</section>"


def _interval(figure: ErrorFigure) -> str:
    return f"{figure.low:.2g} – {figure.high:.2g}"
