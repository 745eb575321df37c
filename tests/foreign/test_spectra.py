"""Spectra as Mitsuba files give them, against the colours that Mitsuba 3.9.1 makes of them (variant scalar_rgb).

The numbers are those that `mitsuba.traverse(mitsuba.load_string(...))` shows for the same XML.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wdpm.scenes import SceneError
from wdpm.scenes.mitsuba.read import read_mitsuba
from wdpm.scenes.model.bsdfs import Conductor, Diffuse
from wdpm.scenes.model.scene import Scene
from wdpm.scenes.model.textures import Bitmap
from wdpm.scenes.spectra.spectrum import blackbody, color_of_light, color_of_surface, parse_pairs

CORNELL_LIGHT = "400:0, 500:8, 600:15.6, 700:18.4"
MITSUBAS = 2e-6  # of what Mitsuba shows, which is rounded to float32


def read(folder: Path, body: str, *, version: str = "3.0.0") -> Scene:
    file = folder / "s.xml"
    file.write_text(f'<scene version="{version}">\n<shape type="cube">\n{body}</shape>\n</scene>')
    return read_mitsuba(file, {})


def reflectance(folder: Path, spectrum: str) -> object:
    bsdf = read(folder, f'<bsdf type="diffuse">{spectrum}</bsdf>').materials[0].bsdf
    assert isinstance(bsdf, Diffuse)
    return bsdf.reflectance


def radiance(folder: Path, spectrum: str, *, version: str = "3.0.0") -> object:
    return read(folder, f'<emitter type="area">{spectrum}</emitter>', version=version).meshes[0].emission


REFLECTANCES = {
    '<spectrum name="reflectance" value="400:0.04, 500:0.06, 600:0.4, 700:0.63"/>': (0.527566, 0.19546, 0.025342),
    '<spectrum name="reflectance" value="400:0.78, 500:0.78, 600:0.78, 700:0.78"/>': (0.776367, 0.77981, 0.776029),
    '<spectrum name="reflectance" value="400:1, 500:0.01"/>': (0.027593, 0.0, 0.521093),  # cut off at the gamut
    '<spectrum name="reflectance" value="0.3"/>': (0.3, 0.3, 0.3),
    '<texture name="reflectance" type="srgb"><rgb name="color" value="0.1 0.2 0.3"/></texture>': (0.1, 0.2, 0.3),
    '<texture name="reflectance" type="rawconstant"><vector name="value" value="0.1 0.2 0.3"/></texture>': (
        *(0.1, 0.2, 0.3),
    ),
}

EMISSIONS = {
    f'<spectrum name="radiance" value="{CORNELL_LIGHT}"/>': (20.710836, 10.854634, 2.771152),
    '<spectrum name="radiance" type="uniform"><float name="value" value="3"/></spectrum>': (3.0, 3.0, 3.0),
    '<spectrum name="radiance" type="d65"/>': (1.0, 1.0, 1.0),
    '<spectrum name="radiance" type="d65"><float name="scale" value="2"/><rgb name="color" value="1 2 3"/>'
    "</spectrum>": (*(2.0, 4.0, 6.0),),
    '<spectrum name="radiance" value="2"/>': (2.40958, 1.896582, 1.817832),
}


@pytest.mark.parametrize(("spectrum", "expected"), REFLECTANCES.items())
def test_reflectances_are_mitsubas(tmp_path: Path, spectrum: str, expected: tuple[float, ...]) -> None:
    assert reflectance(tmp_path, spectrum) == pytest.approx(expected, rel=MITSUBAS, abs=MITSUBAS)


@pytest.mark.parametrize(("spectrum", "expected"), EMISSIONS.items())
def test_emissions_are_mitsubas(tmp_path: Path, spectrum: str, expected: tuple[float, ...]) -> None:
    assert radiance(tmp_path, spectrum) == pytest.approx(expected, rel=MITSUBAS)


def test_indices_of_metals_are_seen_under_daylight_and_not_cut_off_at_one(tmp_path: Path) -> None:
    bsdf = (
        read(
            tmp_path,
            '<bsdf type="conductor"><spectrum name="eta" value="400:1.6, 500:0.9, 600:0.2, 700:0.1"/>'
            '<spectrum name="k" value="400:2, 500:1.8, 600:2.9, 700:4"/></bsdf>',
        )
        .materials[0]
        .bsdf
    )
    assert isinstance(bsdf, Conductor)
    assert bsdf.eta == pytest.approx((0.029665, 0.589563, 1.304802), abs=MITSUBAS)
    assert bsdf.k == pytest.approx((3.387392, 2.222029, 1.815295), rel=MITSUBAS)


def test_spectra_come_from_files_too(tmp_path: Path) -> None:
    (tmp_path / "a.spd").write_text("# nm, value\n380 0.1\n550 0.9\n\n720 0.3\n")
    expected = (0.653194, 0.836459, 0.403129)
    assert reflectance(tmp_path, '<spectrum name="reflectance" filename="a.spd"/>') == pytest.approx(expected, abs=1e-6)
    lists = '<string name="wavelengths" value="380, 550, 720"/><string name="values" value="0.1, 0.9, 0.3"/>'
    by_lists = f'<spectrum name="reflectance" type="irregular">{lists}</spectrum>'
    assert reflectance(tmp_path, by_lists) == pytest.approx(expected, abs=1e-6)


def test_even_spectra_are_those_of_their_pairs(tmp_path: Path) -> None:
    even = '<string name="values" value="0, 8, 15.6"/><float name="wavelength_min" value="400"/>'
    even += '<float name="wavelength_max" value="600"/>'
    pairs = '<spectrum name="radiance" value="400:0, 500:8, 600:15.6"/>'
    regular = radiance(tmp_path, f'<spectrum name="radiance" type="regular">{even}</spectrum>')
    assert regular == radiance(tmp_path, pairs)


def test_a_black_body_has_the_colour_of_plancks_law(tmp_path: Path) -> None:
    """Mitsuba's own spectrum at 3000 K, made a colour by its own function of lists."""
    expected = (733.11047, 349.568604, 112.709702)
    assert color_of_light(blackbody(3000.0)) == pytest.approx(expected, rel=1e-4)
    new = radiance(
        tmp_path, '<spectrum name="radiance" type="blackbody"><float name="temperature" value="3000"/></spectrum>'
    )
    old = radiance(tmp_path, '<blackbody name="radiance" temperature="3000K"/>', version="0.6.0")
    half = radiance(tmp_path, '<blackbody name="radiance" temperature="3000K" scale="0.5"/>', version="0.6.0")
    assert new == old == pytest.approx(expected, rel=1e-4)
    assert np.multiply(2.0, half) == pytest.approx(old, rel=1e-12)


def test_a_surface_of_one_at_all_wavelengths_is_white_and_light_has_luminance_one() -> None:
    even = parse_pairs("300:1, 900:1")
    assert color_of_surface(even) == pytest.approx((1.0, 1.0, 1.0), abs=2e-3)
    assert color_of_light(even) @ (0.212671, 0.715160, 0.072169) == pytest.approx(1.0, abs=2e-3)


def test_a_colour_that_is_cut_off_is_said(tmp_path: Path) -> None:
    scene = read(tmp_path, '<bsdf type="diffuse"><spectrum name="reflectance" value="400:1, 500:0.01"/></bsdf>')
    assert [warning for warning in scene.warnings if "gamut" in warning] == [
        "line 3: <spectrum>: outside of sRGB's gamut, 0.02759 -0.03802 0.5211 is taken as 0.02759 0 0.5211"
    ]


def test_a_constant_stands_where_a_texture_is_asked_for(tmp_path: Path) -> None:
    flat = '<texture name="normalmap" type="rawconstant"><vector name="value" value="0.5 0.5 1"/></texture>'
    body = f'<bsdf type="normalmap">{flat}<bsdf type="diffuse"/></bsdf>'
    normals = read(tmp_path, body).materials[0].bsdf.normals  # type: ignore[union-attr]
    assert isinstance(normals, Bitmap)
    assert np.array_equal(normals.pixels, np.array([[[0.5, 0.5, 1.0]]], np.float32))


def test_a_scaled_texture_is_its_pixels_times_a_number(tmp_path: Path) -> None:
    inner = '<texture type="checkerboard"><rgb name="color0" value="0.2"/><rgb name="color1" value="0.8 0.4 0.2"/>'
    inner += "</texture>"
    scaled = f'<texture name="reflectance" type="scale"><float name="scale" value="0.5"/>{inner}</texture>'
    board = reflectance(tmp_path, scaled)
    assert board.color0 == pytest.approx((0.1, 0.1, 0.1))  # type: ignore[attr-defined]
    assert board.color1 == pytest.approx((0.4, 0.2, 0.1))  # type: ignore[attr-defined]


WRONG = {
    '<spectrum name="reflectance" value="400:1, 500"/>': 'such as "500:0.2", got "500"',
    '<spectrum name="reflectance" value="400:1, 400:2"/>': "wavelengths must increase; 400 nm does not",
    '<spectrum name="reflectance" value="400:1"/>': "at least 2",
    '<spectrum name="reflectance" value="400:a 500:2"/>': 'expected a number, got "a"',
    '<spectrum name="reflectance" value="400:nan 500:2"/>': "must be finite",
    '<spectrum name="reflectance" filename="none.spd"/>': 'file "none.spd" not found',
    '<spectrum name="reflectance" filename="s.xml"/>': "spectra are read from .spd files",
    '<spectrum name="reflectance" filename="s.xml" value="1"/>': "cannot both be given",
    '<spectrum name="reflectance" filename="three.spd"/>': "three.spd: line 2: expected a wavelength and a value",
    '<blackbody name="reflectance" temperature="-3K"/>': "the temperature must be greater than 0 kelvin",
    '<blackbody name="reflectance"/>': 'lacks the attribute "temperature"',
    '<spectrum name="reflectance" type="irregular"><string name="wavelengths" value="400 500"/>'
    '<string name="values" value="1"/></spectrum>': "2 wavelengths for 1 values",
    '<spectrum name="reflectance" type="rawconstant"/>': 'the parameter "value" is missing',
}


@pytest.mark.parametrize(("spectrum", "words"), WRONG.items())
def test_what_is_no_spectrum_is_an_error_with_its_line(tmp_path: Path, spectrum: str, words: str) -> None:
    (tmp_path / "three.spd").write_text("400 1\n500 1 2\n")
    with pytest.raises(SceneError) as caught:
        reflectance(tmp_path, spectrum)
    assert str(caught.value).startswith(f"{tmp_path / 's.xml'}:3: ")
    assert words in str(caught.value)
