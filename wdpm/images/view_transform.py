"""From radiance to what a screen shows: exposure, then a view transform. PNG, pages and notebooks show images so.

Numbers of an image are never changed by it: EXR, HDR, PFM and NPY files hold radiance.

Sources: IEC 61966-2-1 (sRGB). Hable, "Uncharted 2: HDR Lighting", GDC 2010. Khronos Group, "PBR Neutral Tone Mapper",
2024. Wrensch, "Minimal AgX Implementation", 2023, after Sobotka's AgX, which Blender 4 shows pictures with. Reinhard
et al., "Photographic Tone Reproduction for Digital Images", 2002, for the key of automatic exposure.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from numbers import Real
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wdpm.images.channels import encode_srgb8
from wdpm.scenes.errors import ImageError
from wdpm.values import MOST_STOPS

Array = NDArray[np.floating[Any]]

LUMINANCE: Final = np.array([0.2126, 0.7152, 0.0722])

LOOK: Final = "look"
"""Under which an image's metadata has its look: `exposure` in stops and `transform`."""

KEY: Final = 0.18
"""What automatic exposure makes of a picture's logarithmic mean: middle grey."""

MOST_CLIPPED: Final = 0.1
"""Share of a picture that automatic exposure lets grow brighter than white: lamps, the sky in a window."""


class ViewTransform(Enum):
    """How radiance, exposed, becomes colours of a screen."""

    STANDARD = "standard"
    FILMIC = "filmic"
    AGX = "agx"
    NEUTRAL = "neutral"


@dataclass(frozen=True)
class Look:
    """How an image is shown.

    Attributes:
        exposure: in stops: radiance is multiplied by 2 to this power. None is found from the picture itself
            (`auto_exposure`).
        transform: what follows.
    """

    exposure: float | None = 0.0
    transform: ViewTransform = ViewTransform.STANDARD

    def to_dict(self) -> dict[str, Any]:
        """As metadata has it."""
        return {"exposure": self.exposure, "transform": self.transform.value}

    def resolved(self, pixels: Array) -> Look:
        """The same with the exposure as a number, for a picture; linear RGB, shape [height, width, 3]."""
        return self if self.exposure is not None else Look(auto_exposure(pixels), self.transform)


def look_in(metadata: Mapping[str, Any]) -> Look:
    """What an image's metadata says; as it is where it says nothing, or nothing that makes sense."""
    said = metadata.get(LOOK)
    try:
        return look_of(said["exposure"], said["transform"], Look()) if isinstance(said, Mapping) else Look()
    except (ImageError, KeyError, TypeError):  # a file's header may hold anything
        return Look()


def look_of(exposure: float | str | None, transform: ViewTransform | str | None, default: Look) -> Look:
    """A look from what a person gives: stops, "auto" or None; a transform, its name or None.

    Raises:
        ImageError: there is no such exposure or transform.
    """
    stops = default.exposure if exposure is None else None if exposure == "auto" else _stops(exposure)
    if transform is None or isinstance(transform, ViewTransform):
        return Look(stops, transform or default.transform)
    names = [each.value for each in ViewTransform]
    if transform not in names:
        raise ImageError(f"view transform '{transform}': must be one of {', '.join(names)}")
    return Look(stops, ViewTransform(transform))


def _stops(exposure: float | str) -> float:
    if not isinstance(exposure, Real) or not abs(exposure) <= MOST_STOPS:
        raise ImageError(f"exposure {exposure!r}: expected 'auto' or stops between -{MOST_STOPS:g} and {MOST_STOPS:g}")
    return float(exposure)


def auto_exposure(pixels: Array) -> float:
    """Stops, to a tenth, that make a picture neither dark nor burnt out; a function of its pixels alone.

    The logarithmic mean of luminance, of pixels that are not black, becomes middle grey, unless that would make more
    than MOST_CLIPPED of the picture brighter than white. 0 for a black one.

    Args:
        pixels: linear RGB, shape [height, width, 3]; what is not finite is left out.
    """
    luminance = np.asarray(pixels, np.float64) @ LUMINANCE
    luminance = luminance[np.isfinite(luminance) & (luminance > 0.0)]
    if not luminance.size:
        return 0.0
    lit = luminance[luminance > luminance.max() * 1e-6]
    middle = math.log2(KEY) - float(np.log2(lit).mean())
    bright = -math.log2(float(np.quantile(luminance, 1.0 - MOST_CLIPPED)))
    return round(min(max(min(middle, bright), -MOST_STOPS), MOST_STOPS), 1)


def shown_pixels(pixels: NDArray[np.float32], look: Look) -> NDArray[np.uint8]:
    """Linear RGB, shape [height, width, 3], as a screen shows it, 8 bits a channel.

    Raises:
        ImageError: a pixel is NaN.
    """
    bad = int(np.isnan(pixels).any(axis=2).sum())
    if bad:
        raise ImageError(f"{bad} pixels are NaN and have no colour: save as .exr to find them")
    look = look.resolved(pixels)
    if look.exposure:
        with np.errstate(over="ignore"):  # beyond the largest number is white
            pixels = pixels * np.float32(2.0**look.exposure)
    return encode_srgb8(_TRANSFORMS[look.transform](pixels))


def _filmic(pixels: Array) -> Array:
    """Hable's curve with his constants: twice the exposure, white at 11.2."""
    light = 2.0 * np.clip(pixels.astype(np.float64), 0.0, 1e9)
    return _hable(light) / _hable(np.float64(11.2))


def _hable(x: Any) -> Any:
    a, b, c, d, e, f = 0.15, 0.50, 0.10, 0.20, 0.02, 0.30
    return (x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f) - e / f


_AGX_IN: Final = np.array(
    [
        [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
        [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
        [0.0423756549057051, 0.0784336, 0.879142973793104],
    ]
)
_AGX_OUT: Final = np.array(
    [
        [1.19687900512017, -0.0980208811401368, -0.0990297440797205],
        [-0.0528968517574562, 1.15190312990417, -0.0989611768448433],
        [-0.0529716355144438, -0.0980434501171241, 1.15107367264116],
    ]
)
_AGX_STOPS: Final = (-12.47393, 4.026069)
_AGX_CURVE: Final = (15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232)
"""Of Wrensch's polynomial, from the sixth power down."""


def _agx(pixels: Array) -> Array:
    """Stops about middle grey, a curve with a soft toe and shoulder, and colours that go to white as they burn out."""
    low, high = _AGX_STOPS
    light = np.clip(pixels.astype(np.float64), 0.0, 1e9) @ _AGX_IN.T
    stops = (np.log2(np.maximum(light, 1e-10)).clip(low, high) - low) / (high - low)
    return np.maximum(np.polyval(_AGX_CURVE, stops) @ _AGX_OUT.T, 0.0) ** 2.2  # the curve's values are encoded


def _neutral(pixels: Array) -> Array:
    """Khronos' tone mapper for pictures of products: base colours stay as they are, highlights alone are compressed."""
    light = np.clip(pixels.astype(np.float64), 0.0, 1e9)
    least = light.min(axis=-1, keepdims=True)
    light = light - np.where(least < 0.08, least - 6.25 * least * least, 0.04)
    peak = np.maximum(light.max(axis=-1, keepdims=True), 1e-12)
    start, room = 0.76, 0.24
    pressed = 1.0 - room * room / (np.maximum(peak, start) + room - start)
    white = 1.0 - 1.0 / (0.15 * (peak - pressed) + 1.0)
    squeezed = light * (pressed / peak)
    return np.where(peak < start, light, squeezed + (pressed - squeezed) * white)


_TRANSFORMS: Final[Mapping[ViewTransform, Callable[[Array], Array]]] = {
    ViewTransform.STANDARD: lambda pixels: pixels,
    ViewTransform.FILMIC: _filmic,
    ViewTransform.AGX: _agx,
    ViewTransform.NEUTRAL: _neutral,
}
