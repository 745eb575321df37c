"""FLIP: how different two images look to a person who flips between them.

Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images"; HDR-FLIP: Andersson et al. 2021,
"Visualizing Errors in Rendered High Dynamic Range Images". The figures are NVIDIA's own (package `flip-evaluator`).
What is done here is what its library leaves to the caller: it ends the process on images that are mostly black, and
takes values that are not finite for colours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from wdpm.images.comparison import Exposures, FlipFigures, Region, check_same_size, region_slices
from wdpm.images.image import Image
from wdpm.progress import Progress, SilentProgress
from wdpm.scenes.errors import SettingsError, WdpmError

PIXELS_PER_DEGREE = 67.02064514160156
"""FLIP's own: a display of 3840 pixels on 0.7 m, looked at from 0.7 m."""

# HDR-FLIP is the worst of several exposures. The darkest and the brightest bring the reference's brightest pixel and
# its median to 85 % of white by the ACES tone curve (a x² + b x + c) / (d x² + e x + f) (Andersson et al. 2021).
_ACES = (0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.0, 0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14)
_NEAR_WHITE = 0.85
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])

_WHITE = 1e4
"""Brighter light is white after the tone curve, whose squares would overflow."""

_EXPOSURES_A_CALL = 2
"""The least that the library takes. One call for all could not tell how far it is."""


class FlipKind(Enum):
    """Which FLIP."""

    LDR = "ldr"
    """Of the images as a screen shows them, clipped to [0, 1]."""
    HDR = "hdr"
    """Of linear light: the worst of several exposures, at each pixel."""


@dataclass(frozen=True, eq=False)
class Flip:
    """FLIP of two images.

    Attributes:
        errors: from 0 (the same) to 1, shape [height, width]; NaN where a value of either image is not finite.
        pixels_per_degree: of the visual field.
        exposures: of HDR-FLIP; None for LDR-FLIP.
    """

    kind: FlipKind
    errors: NDArray[np.float64]
    pixels_per_degree: float
    exposures: Exposures | None

    def figures(self, region: Region | None = None) -> FlipFigures:
        """The mean of a region, and what it was made with. A pixel's error depends on its surroundings, which may lie
        outside the region."""
        rows, columns = region_slices(region, self.errors.shape)
        finite = self.errors[rows, columns]
        finite = finite[np.isfinite(finite)]
        return FlipFigures(
            kind=self.kind.value,
            mean=float(finite.mean()) if finite.size else math.nan,
            pixels_per_degree=self.pixels_per_degree,
            exposures=self.exposures,
        )


def flip_is_installed() -> bool:
    """Whether `flip` can be called."""
    return find_spec("flip_evaluator") is not None


def flip(
    a: Image,
    b: Image,
    kind: FlipKind = FlipKind.HDR,
    pixels_per_degree: float = PIXELS_PER_DEGREE,
    progress: Progress | None = None,
) -> Flip:
    """FLIP of image `a` against reference `b`.

    Pixels that are not finite in either are black in both, and left out of the result. Light below 0 counts as 0.

    Raises:
        ImageError: the sizes differ.
        SettingsError: the pixels a degree are not positive.
        WdpmError: the package is not installed.
    """
    check_same_size(a, b)
    if not (math.isfinite(pixels_per_degree) and pixels_per_degree > 0):
        raise SettingsError(f"pixels a degree are {pixels_per_degree}; expected a positive number, like 67")
    if not flip_is_installed():
        raise WdpmError("FLIP: flip-evaluator is not installed: pip install 'wdpm[flip]'")
    progress = progress or SilentProgress()
    finite: NDArray[np.bool_] = np.all(np.isfinite(a.pixels) & np.isfinite(b.pixels), axis=2)
    test, reference = (_plain(image.pixels, finite) for image in (a, b))
    if kind is FlipKind.LDR:
        test, reference = test.clip(0, 1), reference.clip(0, 1)
    exposures = choose_exposures(reference) if kind is FlipKind.HDR else None
    if (test == reference).all():
        errors = np.zeros(finite.shape)
    else:
        errors = _errors(test, reference, exposures, pixels_per_degree, progress)
    return Flip(kind, np.where(finite, errors, np.nan), pixels_per_degree, exposures)


def choose_exposures(reference: NDArray[np.float32]) -> Exposures:
    """The exposures of HDR-FLIP for a reference of shape [height, width, 3] with no value below 0.

    Where more than half of the image is black, its median would want an exposure without end: the median of the pixels
    that are not stands in for it.
    """
    luminance = reference.astype(np.float64) @ _LUMINANCE
    lit = luminance[luminance > 0]
    if not lit.size:
        return Exposures(0.0, 0.0, _EXPOSURES_A_CALL)
    a, b, c = (high - _NEAR_WHITE * low for high, low in zip(_ACES[:3], _ACES[3:], strict=True))
    white = (math.sqrt(b * b - 4 * a * c) - b) / (2 * a)
    start, stop = math.log2(white / float(lit.max())), math.log2(white / (_median(luminance) or _median(lit)))
    return Exposures(start, stop, max(_EXPOSURES_A_CALL, math.ceil(stop - start)))


def _median(values: NDArray[np.float64]) -> float:
    """The upper one of an even number, as the library has it."""
    middle = values.size // 2
    return float(np.partition(values, middle, axis=None)[middle])


def _plain(pixels: NDArray[np.float32], finite: NDArray[np.bool_]) -> NDArray[np.float32]:
    return np.where(finite[..., None], pixels, np.float32(0)).clip(0, None)


def _errors(
    test: NDArray[np.float32],
    reference: NDArray[np.float32],
    exposures: Exposures | None,
    pixels_per_degree: float,
    progress: Progress,
) -> NDArray[np.float64]:
    import flip_evaluator

    def evaluate(kind: str, brightest: float, **parameters: float | str) -> NDArray[np.float64]:
        limit = np.float32(min(brightest, float(np.finfo(np.float32).max)))
        errors, _, _ = flip_evaluator.evaluate(
            np.minimum(reference, limit),
            np.minimum(test, limit),
            kind,
            inputsRGB=False,
            applyMagma=False,
            computeMeanError=False,
            parameters={"ppd": pixels_per_degree, **parameters},
        )
        return np.asarray(errors[..., 0], dtype=np.float64)

    if exposures is None:
        return evaluate("LDR", 1.0)
    values = exposures.values()
    starts = range(0, len(values), _EXPOSURES_A_CALL)
    progress.start("FLIP", len(starts))
    worst = np.zeros(test.shape[:2])
    for first in starts:
        pair = values[first : first + _EXPOSURES_A_CALL]
        exposure = {"startExposure": pair[0], "stopExposure": pair[-1], "numExposures": _EXPOSURES_A_CALL}
        errors = evaluate("HDR", _WHITE / 2 ** pair[0], **exposure, tonemapper="ACES")
        worst = np.maximum(worst, errors)
        progress.advance()
    return worst
