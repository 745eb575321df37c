"""Images of a sweep for its page: renders and error maps side by side, all at one exposure and one scale of errors."""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wdpm.accuracy.error import Truth
from wdpm.accuracy.plots import is_choice, quality_curves
from wdpm.accuracy.result import Accuracy, CurveFigures, PointFigures
from wdpm.images.channels import encode_srgb8
from wdpm.images.files import png_bytes
from wdpm.images.heat_map import Scale, magma
from wdpm.images.image import load

WIDEST = 320
"""Pixels; wider images are averaged down for the page. The files keep every pixel."""

DECADES = 4

MID_BRIGHT = 0.8
"""Of linear light: the exposure leaves 95 % of the pixels darker than this."""


@dataclass(frozen=True)
class Look:
    """What all pictures of a page have in common."""

    exposure: float
    errors: Scale


def look_of(found: Accuracy, folder: Path, truth: Truth) -> Look:
    """An exposure for the reference, in whole stops, and a scale for the error of the base."""
    bright = float(np.quantile(truth.pixels.max(axis=2), 0.95))
    stops = math.floor(math.log2(MID_BRIGHT / bright)) if bright > 0 else 0
    errors = _errors(found.base, folder, truth)
    positive = errors[errors > 0]
    power = math.ceil(math.log10(float(np.quantile(positive, 0.995))) - 1e-9) if positive.size else 0
    return Look(2.0**stops, Scale(10.0 ** (power - DECADES), 10.0**power, logarithmic=True))


def strips(found: Accuracy, folder: Path, truth: Truth, look: Look) -> str:
    """The reference and the base, then each knob's lowest and highest value; each image is in the page once.

    Raises:
        ImageError: an image cannot be read.
    """
    head = [_figure("reference", "ref", ""), *_pair(found.base, "base")]
    shown = {0}
    rows = [f"<div class='strip'>{''.join(head)}</div>"]
    for curve in quality_curves(found):
        numbers = _ends(curve)
        shown |= set(numbers)
        pairs = [
            picture
            for number in numbers
            for picture in _pair(found.points[number], f"{curve.label} {curve.words[curve.points.index(number)]}")
        ]
        rows.append(f"<h3>{escape(curve.label)}</h3><div class='strip'>{''.join(pairs)}</div>")
    return _sources(found, sorted(shown), folder, truth, look) + _legend(look) + "".join(rows)


def _ends(curve: CurveFigures) -> list[int]:
    """The points with the lowest and the highest value, or all choices; not the base, which is shown already."""
    numbers = curve.points if is_choice(curve) else curve.points[:: len(curve.points) - 1]
    return [number for number in dict.fromkeys(numbers) if number != 0]


def _pair(point: PointFigures, name: str) -> list[str]:
    error = f"relMSE {point.rel_mse.error.value:.2g}"
    return [
        _figure(name, f"r{point.number}", f"{point.seconds:.1f} s"),
        _figure("its error", f"e{point.number}", error),
    ]


def _figure(name: str, source: str, words: str) -> str:
    said = escape(f"{name} {words}".strip(), quote=True)
    return (
        f"<figure><div class='pic s-{source}' role='img' aria-label='{said}'></div>"
        f"<figcaption>{escape(name)}{f' <small>{escape(words)}</small>' if words else ''}</figcaption></figure>"
    )


def _legend(look: Look) -> str:
    stops = round(math.log2(look.exposure))
    low, high = look.errors.low, look.errors.high
    return (
        f"<p class='scale'>All renders at {stops:+d} stops, first seed. Errors: (render − reference)² / (reference² + "
        f"0.01), <span>{low:g}</span><i class='magma'></i><span>{high:g}</span>, logarithmic.</p>"
    )


def _sources(found: Accuracy, numbers: list[int], folder: Path, truth: Truth, look: Look) -> str:
    """Every picture once, as a background of a CSS class."""
    height, width = truth.pixels.shape[:2]
    rules = [
        f".pic{{aspect-ratio:{width}/{height}}}",
        _rule("ref", encode_srgb8(_smaller(truth.pixels * look.exposure))),
    ]
    for number in numbers:
        point = found.points[number]
        pixels = load(folder / point.images[0]).pixels.astype(np.float64)
        rules.append(_rule(f"r{number}", encode_srgb8(_smaller(pixels * look.exposure))))
        errors = _smaller(_errors(point, folder, truth)[..., np.newaxis])[..., 0]
        rules.append(_rule(f"e{number}", magma(look.errors.share(errors))))
    stops = ",".join(f"rgb({r},{g},{b})" for r, g, b in magma(np.linspace(0, 1, 11)).tolist())
    rules.append(f".magma{{background:linear-gradient(90deg,{stops})}}")
    return "<style>" + "\n".join(rules) + "</style>"


def _rule(name: str, pixels: NDArray[np.uint8]) -> str:
    data = base64.b64encode(png_bytes(pixels)).decode()
    return f".s-{name}{{background-image:url(data:image/png;base64,{data})}}"


def _errors(point: PointFigures, folder: Path, truth: Truth) -> NDArray[np.float64]:
    """Of the first seed, each pixel's part of relMSE, shape [height, width]."""
    pixels = load(folder / point.images[0]).pixels.astype(np.float64)
    return np.asarray(((pixels - truth.pixels) ** 2 * truth.relative).mean(axis=2))


def _smaller(pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Averaged down by a whole factor to at most WIDEST pixels across; what is left over at the edges is cut off."""
    factor = -(-pixels.shape[1] // WIDEST)
    height, width = (max(side // factor, 1) for side in pixels.shape[:2])
    cut = pixels[: height * factor, : width * factor]
    if cut.shape[0] < factor:  # flatter than a block
        return cut[:, ::factor]
    return cut.reshape(height, factor, width, factor, -1).mean(axis=(1, 3))
