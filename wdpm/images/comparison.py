"""How far two images are apart: error figures in double precision, and whether every bit is equal."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wdpm.images.blotches import Blotches, blotches
from wdpm.images.channels import PARTITION_LAYER
from wdpm.images.image import Image
from wdpm.scenes.errors import ImageError

if TYPE_CHECKING:
    from rich.console import Console

# relMSE divides by b² + this, so that black pixels do not count without end (Rousselle et al. 2011).
RELATIVE_FLOOR = 0.01

Region = tuple[int, int, int, int]
RGBMean = tuple[float, float, float]


@dataclass(frozen=True)
class Exposures:
    """Of HDR-FLIP, as powers of two: `count` of them in equal steps, at least two."""

    start: float
    stop: float
    count: int

    def values(self) -> list[float]:
        """All of them."""
        return [float(value) for value in np.linspace(self.start, self.stop, self.count)]


@dataclass(frozen=True)
class FlipFigures:
    """FLIP in one figure (wdpm.images.perceptual).

    Attributes:
        kind: "hdr" or "ldr".
        mean: over the pixels that are finite in both, from 0 (the same) to 1.
        pixels_per_degree: of the visual field.
        exposures: that the images were shown at; None for LDR-FLIP.
    """

    kind: str
    mean: float
    pixels_per_degree: float
    exposures: Exposures | None

    def in_words(self) -> str:
        """For people."""
        how = f"{self.kind.upper()}, {self.pixels_per_degree:.0f} pixels/degree"
        if self.exposures is not None:
            how += f", {self.exposures.count} exposures {self.exposures.start:+.1f} to {self.exposures.stop:+.1f}"
        return f"{self.mean:.4f} ({how})"


@dataclass(frozen=True)
class Comparison:
    """Figures of image a against reference b.

    The errors are of the beauty layer, over the values that are finite in both; the bits are of all common layers.

    Attributes:
        width, height: of what was compared, in pixels.
        mse: mean of (a - b)².
        rmse: its root.
        rel_mse: mean of (a - b)² / (b² + 0.01).
        psnr: 10 log10(peak² / mse) [dB], where peak is the largest value of b; infinite when mse is 0.
        max_abs: largest |a - b|.
        mean_a, mean_b: mean of each channel.
        ratio: mean_a / mean_b; NaN where both are 0.
        layers: the layers that both images have.
        differing: pixels of each of these in which a bit differs.
        differing_pixels: pixels in which a bit of any common layer but `cell` differs: that one shows which part of a
            cluster saw a pixel, and is meant to differ.
        nonfinite_a, nonfinite_b: values of the beauty layer that are NaN or infinite.
        blotches: how much of the error is as wide as areas; None where the image is too small to tell.
        flip: how different they look; None where that was not asked for.
    """

    width: int
    height: int
    mse: float
    rmse: float
    rel_mse: float
    psnr: float
    max_abs: float
    mean_a: RGBMean
    mean_b: RGBMean
    ratio: RGBMean
    layers: tuple[str, ...]
    differing: dict[str, int]
    differing_pixels: int
    nonfinite_a: int
    nonfinite_b: int
    blotches: Blotches | None = None
    flip: FlipFigures | None = None

    @property
    def bits_equal(self) -> bool:
        """Whether every bit of every common layer but `cell` is equal."""
        return self.differing_pixels == 0

    def to_json(self) -> str:
        """One JSON object; figures that are not finite become null."""
        return json.dumps(_finite_or_none({**asdict(self), "bits_equal": self.bits_equal}), allow_nan=False, indent=2)

    def print(self, console: Console) -> None:
        """A table for people."""
        from rich.table import Table

        figures = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
        for name, value in (("MSE", self.mse), ("RMSE", self.rmse), ("relMSE", self.rel_mse)):
            figures.add_row(name, f"{value:.4g}")
        figures.add_row("PSNR", f"{self.psnr:.2f} dB")
        if self.blotches is not None:
            figures.add_row("blotches", self.blotches.in_words())
        if self.flip is not None:
            figures.add_row("FLIP", self.flip.in_words())
        figures.add_row("largest difference", f"{self.max_abs:.4g}")
        for name, means in (("mean of A", self.mean_a), ("mean of B", self.mean_b), ("A / B", self.ratio)):
            figures.add_row(name, "  ".join(f"{mean:.5f}" for mean in means) + "  (R G B)")
        if self.nonfinite_a or self.nonfinite_b:
            figures.add_row(
                "not finite", f"{self.nonfinite_a:,} values of A, {self.nonfinite_b:,} of B, left out above"
            )
        figures.add_row("bits", self._bits_in_words())
        console.print(figures)

    def _bits_in_words(self) -> str:
        if self.bits_equal:
            return f"all equal ({', '.join(name for name in self.layers if name != PARTITION_LAYER)})"
        share = self.differing_pixels / (self.width * self.height)
        differing = {name: count for name, count in self.differing.items() if count and name != PARTITION_LAYER}
        layers = ", ".join(f"{name} {count:,}" for name, count in differing.items())
        return f"differ in {self.differing_pixels:,} pixels, {share:.2%} ({layers})"


def _pixels_that_differ(differs: dict[str, NDArray[np.bool_]]) -> int:
    masks = [mask for name, mask in differs.items() if name != PARTITION_LAYER]
    return int(np.logical_or.reduce(masks).sum())


def compare(a: Image, b: Image, region: Region | None = None) -> Comparison:
    """Compare image `a` with reference `b`.

    Args:
        region: (left, top, right, bottom) in pixels, right and bottom not included; None for all.

    Raises:
        ImageError: the sizes differ, or the region lies outside or is empty.
    """
    for each in (a, b):
        if not isinstance(each, Image):
            raise ImageError(f"{type(each).__name__} is no image: expected two of wdpm.Image")
    check_same_size(a, b)
    rows, columns = region_slices(region, a.shape)
    beauty_a = a.pixels[rows, columns].astype(np.float64)
    beauty_b = b.pixels[rows, columns].astype(np.float64)
    finite = np.isfinite(beauty_a) & np.isfinite(beauty_b)
    squared = (beauty_a[finite] - beauty_b[finite]) ** 2
    with np.errstate(invalid="ignore"):  # what is not finite counts as right there
        relative = (beauty_a - beauty_b) / np.sqrt(beauty_b**2 + RELATIVE_FLOOR)
    mse = _mean(squared)
    mean_a, mean_b = _channel_means(beauty_a, finite), _channel_means(beauty_b, finite)
    layers = tuple(name for name in a.layers if name in b.layers)
    differs = {name: _bits_differ(a.layers[name][rows, columns], b.layers[name][rows, columns]) for name in layers}
    return Comparison(
        width=beauty_a.shape[1],
        height=beauty_a.shape[0],
        mse=mse,
        rmse=math.sqrt(mse),
        rel_mse=_mean(squared / (beauty_b[finite] ** 2 + RELATIVE_FLOOR)),
        psnr=_psnr(mse, beauty_b[finite]),
        max_abs=float(np.sqrt(squared.max())) if squared.size else math.nan,
        mean_a=_triple(mean_a),
        mean_b=_triple(mean_b),
        ratio=_triple(_ratio(mean_a, mean_b)),
        layers=layers,
        differing={name: int(mask.sum()) for name, mask in differs.items()},
        differing_pixels=_pixels_that_differ(differs),
        nonfinite_a=int((~np.isfinite(beauty_a)).sum()),
        nonfinite_b=int((~np.isfinite(beauty_b)).sum()),
        blotches=blotches(relative),
    )


def check_same_size(a: Image, b: Image) -> None:
    """Raises ImageError when the images cannot be compared pixel by pixel."""
    if a.shape != b.shape:
        sizes = f"{a.shape[1]}x{a.shape[0]} and {b.shape[1]}x{b.shape[0]}"
        raise ImageError(f"images of different sizes, {sizes}, cannot be compared: render both with the same --size")


def region_slices(region: Region | None, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of a region of an image of shape [height, width]; None is all. Raises ImageError."""
    height, width = shape[:2]
    if region is None:
        return slice(0, height), slice(0, width)
    left, top, right, bottom = region
    if not (0 <= left < right <= width and 0 <= top < bottom <= height):
        raise ImageError(f"region {left},{top},{right},{bottom} is empty or not within the image of {width}x{height}")
    return slice(top, bottom), slice(left, right)


def _bits_differ(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Pixels in which a bit differs, shape [height, width]: -0 is not 0, and a NaN equals itself."""
    different = np.ascontiguousarray(a).view(np.uint32) != np.ascontiguousarray(b).view(np.uint32)
    return different.any(axis=2) if different.ndim == 3 else different


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if values.size else math.nan


def _channel_means(pixels: NDArray[np.float64], finite: NDArray[np.bool_]) -> NDArray[np.float64]:
    return np.array([_mean(pixels[..., c][finite[..., c]]) for c in range(3)])


def _ratio(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(divide="ignore", invalid="ignore"):  # a black reference has a ratio of inf, or NaN for black too
        return a / b


def _psnr(mse: float, reference: NDArray[np.float64]) -> float:
    peak = float(reference.max()) if reference.size else math.nan
    if mse == 0:
        return math.inf
    return 10 * math.log10(peak**2 / mse) if peak > 0 else math.nan


def _triple(values: NDArray[np.float64]) -> RGBMean:
    red, green, blue = values.tolist()
    return red, green, blue


def _finite_or_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite_or_none(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite_or_none(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
