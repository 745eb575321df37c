"""Colours as linear sRGB: <rgb>, <srgb>, <spectrum> by wavelength, from a file or of one number, and 0.6's <blackbody>.

Spectra become the colours that Mitsuba 3 makes of them in its RGB mode, whatever version a file is for.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.images.read import srgb_to_linear
from wdpm.scenes.mitsuba.document import Document, Element
from wdpm.scenes.mitsuba.values import numbers, xyz
from wdpm.scenes.model.textures import RGB
from wdpm.scenes.spectra.spectrum import (
    Spectrum,
    blackbody,
    color_of_light,
    color_of_surface,
    parse_pairs,
    read_spd,
)

COLOUR_TAGS: Final = ("rgb", "srgb", "spectrum", "blackbody", "float", "integer")

# Mitsuba 3 makes the emission of a constant spectrum the colour of equal-energy white in linear sRGB
# (its rgb variants; measured from version 3.9). A reflectance stays the plain number.
EQUAL_ENERGY_WHITE: Final = (1.20479, 0.948291, 0.908916)

_WORTH_A_WARNING: Final = 1e-6
"""What a channel must be out of gamut by, as a share of the largest, for a warning: more than roundings."""


def read_colour(element: Element, document: Document, *, emission: bool, most: float = math.inf) -> RGB:
    """The value of an element with one of COLOUR_TAGS.

    Args:
        emission: whether it is a light's: Mitsuba sees lights as they are, and surfaces under D65.
        most: what spectra outside of sRGB's gamut are cut off at; below, it is 0.

    Raises:
        SceneError: it is no colour; with file and line.
    """
    spectrum = _spectrum(element, document)
    if spectrum is not None:
        seen = color_of_light(spectrum) if emission else color_of_surface(spectrum)
        return within_gamut(seen, most, element, document)
    text = element.attribute("value") if "value" in element.attributes else ""
    if not text:
        raise element.error(f'<{element.tag}>: expected a colour as value="..."')
    colour = _hexadecimal(element, text) if text.startswith("#") else xyz(element, 0.0)
    if element.tag == "srgb":
        with np.errstate(invalid="ignore"):  # what is negative stays linear
            decoded = srgb_to_linear(np.array(colour))
        return float(decoded[0]), float(decoded[1]), float(decoded[2])
    if element.tag == "spectrum" and emission and len(numbers(text, element)) == 1:
        return (
            colour[0] * EQUAL_ENERGY_WHITE[0],
            colour[1] * EQUAL_ENERGY_WHITE[1],
            colour[2] * EQUAL_ENERGY_WHITE[2],
        )
    return colour


def within_gamut(colour: NDArray[np.float64], most: float, at: Element, document: Document) -> RGB:
    """The nearest colour whose channels lie between 0 and `most`, as Mitsuba cuts them off; a warning if it differs."""
    inside = np.clip(colour, 0.0, most)
    if np.abs(inside - colour).max() > _WORTH_A_WARNING * np.abs(colour).max():
        shown = (" ".join(f"{channel:.4g}" for channel in each) for each in (colour, inside))
        document.rules.tell(at.line, "<{}>: outside of sRGB's gamut, {} is taken as {}".format(at.tag, *shown))
    return float(inside[0]), float(inside[1]), float(inside[2])


def _spectrum(element: Element, document: Document) -> Spectrum | None:
    """The spectrum that an element gives by wavelength; None where it does not."""
    if element.tag == "blackbody":
        return _blackbody(element)
    if element.tag != "spectrum":
        return None
    if "filename" in element.attributes:
        if "value" in element.attributes:
            raise element.error('<spectrum>: "value" and "filename" cannot both be given')
        return read_spectrum_file(document.resolve_file(element.attributes["filename"], element), element)
    if ":" not in element.attributes.get("value", ""):
        return None
    try:
        return parse_pairs(element.attributes["value"])
    except ValueError as error:
        raise element.error(f"<spectrum>: {error}") from error


def read_spectrum_file(file: Path, at: Element) -> Spectrum:
    """A file of wavelengths and values; errors point at who names it."""
    if file.suffix.lower() != ".spd":
        raise at.error(f'<{at.tag}>: spectra are read from .spd files, not from "{file.name}"')
    try:
        return read_spd(file)
    except ValueError as error:
        raise at.error(f"<{at.tag}>: {file.name}: {error}") from error


def _blackbody(element: Element) -> Spectrum:
    """0.6's, whose temperature may end with a K."""
    kelvin = numbers(element.attribute("temperature").strip().removesuffix("K").removesuffix("k"), element)
    scale = numbers(element.attributes.get("scale", "1"), element)
    if len(kelvin) != 1 or len(scale) != 1 or scale[0] < 0.0:
        raise element.error('<blackbody>: expected a number as "temperature", and one that is not negative as "scale"')
    try:
        spectrum = blackbody(kelvin[0])
    except ValueError as error:
        raise element.error(f"<blackbody>: {error}") from error
    return Spectrum(spectrum.wavelengths, scale[0] * spectrum.values)


def _hexadecimal(element: Element, text: str) -> RGB:
    if element.tag != "srgb":
        raise element.error(f'<{element.tag}>: "{text}" is a colour on screen (sRGB); write <srgb ... value="{text}"/>')
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        raise element.error(f'<{element.tag}>: expected "#rrggbb", got "{text}"')
    return int(text[1:3], 16) / 255.0, int(text[3:5], 16) / 255.0, int(text[5:7], 16) / 255.0
