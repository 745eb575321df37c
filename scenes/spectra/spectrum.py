"""Spectra by wavelength, and the colours in linear sRGB that stand for them.

Colours are those that Mitsuba 3 makes of spectra in its RGB mode (its src/core/spectrum.cpp), so
that a scene looks the same in both: light is seen as it is, surfaces under the illuminant D65, whose white is sRGB's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.spectra.cie import LONGEST, SHORTEST, table

_STEPS: Final = 1000  # of the sum that stands for the integral; Mitsuba's

# What makes the luminance of an equal-energy spectrum of 1, and of D65, 1 in that sum; Mitsuba's
_PER_Y: Final = 1.0 / 106.7502593994140625
_PER_D65: Final = 1.0 / 98.99741751876255

_XYZ_TO_SRGB: Final = np.array(
    [[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]]
)

# 2 h c^2 [W m^2] and h c / k [m K] of Planck's law; CODATA 2014, as in Mitsuba
_PLANCK_1: Final = 2.0 * 6.62607004e-34 * 2.99792458e8**2
_PLANCK_2: Final = 6.62607004e-34 * 2.99792458e8 / 1.38064852e-23
_PLANCK_STEP: Final = 1.0  # nm; a straight line between is off by less than 1e-5 at all temperatures that glow

MOST_BYTES: Final = 1 << 24
"""Largest file of a spectrum that is read: a million lines."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A function of the wavelength: straight between its points, 0 outside of them.

    Attributes:
        wavelengths: in nm, increasing, shape [n] with n at least 2.
        values: finite, shape [n].
    """

    wavelengths: NDArray[np.float64]
    values: NDArray[np.float64]

    def __post_init__(self) -> None:
        if len(self.wavelengths) != len(self.values):
            raise ValueError(f"{len(self.wavelengths)} wavelengths for {len(self.values)} values; expected one each")
        if len(self.wavelengths) < 2:
            raise ValueError(f"{len(self.wavelengths)} values; a spectrum by wavelength has at least 2")
        if not (np.isfinite(self.wavelengths).all() and np.isfinite(self.values).all()):
            raise ValueError("wavelengths and values must be finite")
        steps = np.diff(self.wavelengths)
        if not (steps > 0.0).all():
            at = self.wavelengths[int(np.argmax(steps <= 0.0)) + 1]
            raise ValueError(f"wavelengths must increase; {at:g} nm does not")

    def at(self, wavelengths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Its values at wavelengths in nm."""
        return np.interp(wavelengths, self.wavelengths, self.values, left=0.0, right=0.0)


def color_of_light(spectrum: Spectrum) -> NDArray[np.float64]:
    """The colour of a light; channels outside of sRGB's gamut are negative. An equal-energy 1 has luminance 1."""
    return _seen(spectrum, np.ones(len(table())))


def color_of_surface(spectrum: Spectrum) -> NDArray[np.float64]:
    """The colour of a reflectance, or of an index of refraction; 1 at all wavelengths is white, within 1e-3."""
    return _seen(spectrum, table()[:, 4] * _PER_D65)


def _seen(spectrum: Spectrum, illuminant: NDArray[np.float64]) -> NDArray[np.float64]:
    wavelengths = np.linspace(SHORTEST, LONGEST, _STEPS)
    rows = table()
    matching = [np.interp(wavelengths, rows[:, 0], rows[:, column]) for column in (1, 2, 3)]
    under = np.interp(wavelengths, rows[:, 0], illuminant)
    seen = np.array(matching) @ (spectrum.at(wavelengths) * under)
    return _XYZ_TO_SRGB @ seen * ((LONGEST - SHORTEST) * _PER_Y / _STEPS)


def parse_pairs(text: str) -> Spectrum:
    """A spectrum as "400:0.1, 500:0.2".

    Raises:
        ValueError: it is not one.
    """
    pairs = [token.split(":") for token in text.replace(",", " ").split()]
    for pair in pairs:
        if len(pair) != 2:
            raise ValueError(f'expected pairs of wavelength and value such as "500:0.2", got "{":".join(pair)}"')
    return Spectrum(_numbers([pair[0] for pair in pairs]), _numbers([pair[1] for pair in pairs]))


def parse_even(text: str, shortest: float, longest: float) -> Spectrum:
    """A spectrum whose values, between commas or spaces, lie evenly between two wavelengths in nm.

    Raises:
        ValueError: it is not one.
    """
    values = _numbers(text.replace(",", " ").split())
    return Spectrum(np.linspace(shortest, longest, len(values)), values)


def parse_lists(wavelengths: str, values: str) -> Spectrum:
    """A spectrum by its wavelengths and their values, each between commas or spaces.

    Raises:
        ValueError: it is not one.
    """
    lists = [_numbers(text.replace(",", " ").split()) for text in (wavelengths, values)]
    return Spectrum(lists[0], lists[1])


def read_spd(file: Path) -> Spectrum:
    """A file with a wavelength and a value in each line; "#" begins a comment.

    Raises:
        ValueError: it cannot be read, or is none; says why.
    """
    try:
        with file.open("rb") as opened:
            data = opened.read(MOST_BYTES + 1)
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror}") from error
    if len(data) > MOST_BYTES:
        raise ValueError(f"more than {MOST_BYTES:,} bytes: it is no spectrum")
    rows = []
    for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), 1):
        tokens = line.split("#")[0].replace(",", " ").split()
        if tokens and len(tokens) != 2:
            raise ValueError(f'line {number}: expected a wavelength and a value, got "{line.strip()[:40]}"')
        rows += [tokens] if tokens else []
    return Spectrum(_numbers([row[0] for row in rows]), _numbers([row[1] for row in rows]))


def blackbody(temperature: float, shortest: float = SHORTEST, longest: float = LONGEST) -> Spectrum:
    """What a black body sends out by Planck's law, in W/(m² sr nm).

    Args:
        temperature: in kelvin.
        shortest, longest: wavelengths in nm outside of which it is cut off.

    Raises:
        ValueError: the temperature or the wavelengths are out of range.
    """
    if not (temperature > 0.0 and math.isfinite(temperature)):
        raise ValueError(f"the temperature must be greater than 0 kelvin, got {temperature:g}")
    if not 0.0 < shortest < longest < math.inf:
        raise ValueError(f"expected wavelengths from small to large, got {shortest:g} to {longest:g} nm")
    low, high = max(shortest, SHORTEST), min(longest, LONGEST)
    if not low < high:
        raise ValueError(f"nothing is seen between {shortest:g} and {longest:g} nm; expected some of 360 to 830 nm")
    wavelengths = np.linspace(low, high, math.ceil((high - low) / _PLANCK_STEP) + 1)
    metres = wavelengths * 1e-9
    exponent = np.minimum(_PLANCK_2 / (metres * temperature), 700.0)  # e^700 is still finite
    return Spectrum(wavelengths, 1e-9 * _PLANCK_1 / (metres**5 * np.expm1(exponent)))


def _numbers(tokens: list[str]) -> NDArray[np.float64]:
    values = []
    for token in tokens:
        try:
            values.append(float(token))
        except ValueError:
            raise ValueError(f'expected a number, got "{token}"') from None
    return np.array(values)
