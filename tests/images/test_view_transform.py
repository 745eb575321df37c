"""How images are shown: exposure, view transforms, what a PNG's and an EXR's header say of them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from numpy.typing import NDArray

from wdpm.cli.main import main
from wdpm.images.channels import encode_srgb8
from wdpm.images.image import Image, load
from wdpm.images.view_transform import Look, ViewTransform, auto_exposure, shown_pixels
from wdpm.scenes.errors import ImageError


def grey(value: float, width: int = 4, height: int = 3) -> NDArray[np.float32]:
    return np.full((height, width, 3), value, np.float32)


@pytest.fixture
def picture() -> NDArray[np.float32]:
    """Radiance over twelve stops, in all hues."""
    random = np.random.default_rng(3)
    return (2.0 ** random.uniform(-8, 4, (16, 24, 3))).astype(np.float32)


def test_standard_is_srgb_and_a_stop_doubles(picture: NDArray[np.float32]) -> None:
    assert np.array_equal(shown_pixels(picture, Look()), encode_srgb8(picture))
    assert np.array_equal(shown_pixels(picture, Look(-2.0)), encode_srgb8(picture / 4))


@pytest.mark.parametrize("transform", ViewTransform)
def test_more_light_is_never_darker_and_grey_stays_grey(transform: ViewTransform) -> None:
    ramp = np.repeat(2.0 ** np.linspace(-12, 8, 400, dtype=np.float32)[None, :, None], 3, axis=2)
    shown = shown_pixels(ramp, Look(0.0, transform)).astype(int)[0]
    assert (np.diff(shown[:, 1]) >= 0).all()
    assert np.ptp(shown, axis=1).max() <= 1
    assert shown[0].max() <= 8
    assert shown[-1].min() >= 250
    assert not shown_pixels(grey(-1.0), Look(0.0, transform)).max() > 8


@pytest.mark.parametrize(
    ("transform", "light", "expected"),
    [
        # Hable: the shown light is f(2 x) / f(11.2), 11.2 his white point
        (ViewTransform.FILMIC, [5.6] * 3, [1.0] * 3),
        # Khronos: up to 0.8 - 0.04, 0.04 is taken off, the reflection of a dielectric ...
        (ViewTransform.NEUTRAL, [0.44, 0.24, 0.14], [0.40, 0.20, 0.10]),
        # ... and what is darker than 0.08 loses x - 6.25 x²
        (ViewTransform.NEUTRAL, [0.04, 0.04, 0.04], [0.01, 0.01, 0.01]),
        # ... and what is brighter goes towards 1: 1 - 0.24² / (1.04 + 0.24 - 0.76)
        (ViewTransform.NEUTRAL, [1.08, 1.08, 1.08], [1 - 0.24**2 / 0.52] * 3),
        # AgX: middle grey is half of what a screen is told, which raises it to the power 2.2
        (ViewTransform.AGX, [0.18] * 3, [0.5**2.2] * 3),
    ],
)
def test_known_values(transform: ViewTransform, light: list[float], expected: list[float]) -> None:
    shown = shown_pixels(np.array([[light]], np.float32), Look(0.0, transform))
    assert np.abs(shown.astype(int) - encode_srgb8(np.array([[expected]]))).max() <= 1


def test_saturated_light_burns_out_to_white_in_agx_alone() -> None:
    red = np.array([[[200.0, 0.5, 0.5]]], np.float32)
    assert shown_pixels(red, Look(0.0, ViewTransform.AGX)).min() > 150
    assert shown_pixels(red, Look()).min() < 200


def test_automatic_exposure_finds_middle_grey() -> None:
    assert auto_exposure(grey(0.18)) == 0.0
    assert auto_exposure(grey(0.18 / 8)) == 3.0
    assert auto_exposure(grey(0.0)) == 0.0
    assert auto_exposure(grey(np.nan)) == 0.0


def test_automatic_exposure_takes_no_heed_of_black_nor_of_a_lamp(picture: NDArray[np.float32]) -> None:
    found = auto_exposure(picture)
    assert auto_exposure(picture * 16) == pytest.approx(found - 4)
    framed = np.pad(picture, ((9, 9), (9, 9), (0, 0)))
    assert abs(auto_exposure(framed) - found) <= 0.3  # the share that may burn out is of lit pixels
    lamp = picture.copy()
    lamp[0, :3] = 1e5
    assert abs(auto_exposure(lamp) - found) < 0.6


def test_automatic_exposure_burns_out_a_tenth_at_most() -> None:
    room = grey(0.001, 10, 10)
    room[:2] = 1.0  # a fifth is a window
    assert auto_exposure(room) == 0.0


def test_files_hold_radiance_and_pictures_are_exposed(tmp_path: Path, picture: NDArray[np.float32]) -> None:
    image = Image({"beauty": picture})
    for name in ("a.exr", "a.pfm", "a.npy"):
        image.save(tmp_path / name, exposure=2.0, view_transform="agx")
        assert np.array_equal(load(tmp_path / name).pixels, picture)
    again = load(tmp_path / "a.exr")
    assert again.metadata["look"] == {"exposure": 2.0, "transform": "agx"}
    again.save(tmp_path / "a.png")
    again.save(tmp_path / "b.png", exposure=0, view_transform="standard")
    with PIL.Image.open(tmp_path / "a.png") as a, PIL.Image.open(tmp_path / "b.png") as b:
        assert np.array_equal(np.asarray(a), shown_pixels(picture, Look(2.0, ViewTransform.AGX)))
        assert np.array_equal(np.asarray(b), image.to_srgb8())
        assert json.loads(a.text["wdpm"])["look"] == {"exposure": 2.0, "transform": "agx"}
        assert a.info["srgb"] == 0


def test_an_image_that_is_read_from_a_png_is_not_exposed_twice(tmp_path: Path) -> None:
    Image({"beauty": grey(0.1)}).save(tmp_path / "a.png", exposure=1)
    again = load(tmp_path / "a.png")
    again.save(tmp_path / "b.png")
    assert np.array_equal(load(tmp_path / "b.png").pixels, again.pixels)


def test_auto_is_worked_out_when_it_is_said() -> None:
    image = Image({"beauty": grey(0.09)}).looking("auto")
    assert image.look == Look(1.0)
    assert image.to_srgb8(exposure=0)[0, 0, 0] == encode_srgb8(np.array(0.09))


@pytest.mark.parametrize("exposure", ["bright", 1e9, float("nan")])
def test_wrong_exposures(tmp_path: Path, exposure: float | str) -> None:
    with pytest.raises(ImageError, match="expected 'auto' or stops"):
        Image({"beauty": grey(1.0)}).save(tmp_path / "a.png", exposure=exposure)


def test_a_wrong_transform() -> None:
    with pytest.raises(ImageError, match="must be one of standard, filmic, agx, neutral"):
        Image({"beauty": grey(1.0)}).to_srgb8(view_transform="aces")


@pytest.mark.parametrize("look", [3, {"exposure": "x", "transform": "standard"}, {"exposure": 1}, {"transform": []}])
def test_headers_of_others_may_say_anything(look: object) -> None:
    assert Image({"beauty": grey(1.0)}, {"look": look}).look == Look()


def test_convert(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    Image({"beauty": grey(0.09), "depth": grey(1.0)[..., 0]}, {"note": "kept"}).save("a.exr")
    assert main(["convert", "a.exr", "a.png", "b.exr", "a.pfm", "--exposure", "auto"]) == 0
    assert "wrote a.png at +1 stops" in capsys.readouterr().out
    assert np.array_equal(load("a.pfm").pixels, grey(0.09))
    assert load("b.exr").metadata == {"note": "kept", "look": {"exposure": 1.0, "transform": "standard"}}
    assert "depth" in load("b.exr").layers
    with PIL.Image.open("a.png") as shown:
        assert np.asarray(shown)[0, 0, 0] == encode_srgb8(np.array(0.18))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing.exr", "a.png"], "missing.exr: no such file"),
        (["a.exr", "a.exr"], "cannot hold both"),
        (["a.exr", "a.jpg"], "must be one of .exr .png"),
    ],
)
def test_convert_of_what_cannot_be(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Image({"beauty": grey(1.0)}).save("a.exr")
    assert main(["convert", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
