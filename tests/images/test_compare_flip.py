"""FLIP against its library and its own definition, and heat maps against their scales."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from wdpm.cli import main
from wdpm.images import perceptual
from wdpm.images.comparison import compare
from wdpm.images.heat_map import Heat, Scale, error_map, flip_map, heat_map, magma, pixel_errors
from wdpm.images.image import Image
from wdpm.images.image import load as load_image
from wdpm.images.perceptual import FlipKind, choose_exposures, flip
from wdpm.scenes.errors import ImageError, SettingsError, WdpmError

needs_flip = pytest.mark.skipif(not perceptual.flip_is_installed(), reason="flip-evaluator is not installed")


def image_of(pixels: np.ndarray) -> Image:
    return Image({"beauty": np.asarray(pixels, np.float32)})


def noise(seed: int, height: int = 24, width: int = 32) -> np.ndarray:
    """Lit from dark to bright over 2^9, so that HDR-FLIP wants several exposures."""
    ramp = 2.0 ** np.linspace(-6, 3, width)[None, :, None]
    return np.random.default_rng(seed).uniform(0.5, 1.5, (height, width, 3)) * ramp


# ---- FLIP ---------------------------------------------------------------------------------------------------------


@needs_flip
@pytest.mark.parametrize("seed", [1, 3])
def test_hdr_flip_is_the_librarys(seed: int) -> None:
    import flip_evaluator

    a, b = noise(seed), noise(seed + 1)
    errors, mean, used = flip_evaluator.evaluate(
        np.float32(b), np.float32(a), "HDR", inputsRGB=False, applyMagma=False, computeMeanError=True, parameters={}
    )
    result = flip(image_of(a), image_of(b))
    assert result.exposures is not None
    assert result.exposures.count == used["numExposures"] > 2
    assert result.exposures.start == pytest.approx(used["startExposure"], abs=1e-4)
    assert result.exposures.stop == pytest.approx(used["stopExposure"], abs=1e-4)
    assert result.pixels_per_degree == used["ppd"]
    np.testing.assert_allclose(result.errors, errors[..., 0], atol=1e-3)
    assert result.figures().mean == pytest.approx(mean, abs=1e-5)


@needs_flip
def test_a_faint_pattern_counts_for_hdr_alone() -> None:
    """What is too dark to be seen on a screen is brought up by an exposure."""
    dark = np.full((16, 24, 3), 1e-5)
    dark[:, :4] = 1.0
    off = dark.copy()
    off[:, 12:18] *= 8
    screen = flip(image_of(off), image_of(dark), FlipKind.LDR).errors[:, 12:18]
    linear = flip(image_of(off), image_of(dark), FlipKind.HDR).errors[:, 12:18]
    assert screen.max() < 0.01
    assert linear.mean() > 0.3


@needs_flip
def test_more_pixels_a_degree_hide_noise() -> None:
    a, b = image_of(noise(1)), image_of(noise(2))
    assert flip(a, b, pixels_per_degree=200.0).figures().mean < flip(a, b, pixels_per_degree=20.0).figures().mean


@needs_flip
def test_an_image_looks_like_itself() -> None:
    a = image_of(noise(1))
    assert flip(a, a).figures().mean == 0
    assert flip(a, a, FlipKind.LDR).figures().mean == 0


@needs_flip
@pytest.mark.parametrize("lit", [0, 1, 3])
def test_references_that_are_mostly_black(lit: int) -> None:
    """The library ends the process on these."""
    reference = np.zeros((8, 12, 3))
    reference[0, :lit] = 0.5
    result = flip(image_of(noise(1, 8, 12)), image_of(reference))
    assert np.isfinite(result.errors).all()
    assert 0.3 < result.figures().mean <= 1


@needs_flip
def test_values_that_are_not_finite_are_left_out() -> None:
    a, b = noise(1), noise(2)
    clean = flip(image_of(a), image_of(b)).figures().mean
    a[3, 4, 1], a[5, 6] = np.nan, np.inf
    b[7, 8, 2] = -np.inf
    result = flip(image_of(a), image_of(b))
    broken = np.argwhere(np.isnan(result.errors)).tolist()
    assert broken == [[3, 4], [5, 6], [7, 8]]
    assert result.figures().mean == pytest.approx(clean, rel=0.05)
    nothing = flip(image_of(np.full((2, 2, 3), np.nan)), image_of(np.ones((2, 2, 3))))
    assert np.isnan(nothing.figures().mean)


@needs_flip
def test_light_of_any_size() -> None:
    a, b = noise(1), noise(2)
    a[0, 0] = b[0, 0] = 1e20
    result = flip(image_of(a), image_of(b))
    without = flip(image_of(noise(1)), image_of(noise(2)))
    assert np.isfinite(result.errors).all()
    assert result.errors[4:, 4:] == pytest.approx(without.errors[4:, 4:], abs=0.15)  # other exposures between


def test_exposures_bring_the_brightest_and_the_median_near_white() -> None:
    reference = np.float32(noise(1))
    luminance = reference.astype(float) @ [0.2126, 0.7152, 0.0722]
    exposures = choose_exposures(reference)

    def curve(x: float) -> float:
        x *= 0.6
        return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)

    assert curve(float(luminance.max()) * 2**exposures.start) == pytest.approx(0.85)
    assert curve(float(np.sort(luminance, axis=None)[luminance.size // 2]) * 2**exposures.stop) == pytest.approx(0.85)
    values = exposures.values()
    assert len(values) == exposures.count
    assert np.diff(values).max() <= 2  # no step leaves much out


@needs_flip
def test_the_figure_of_a_region() -> None:
    a, b = noise(1), noise(2)
    a[:, :16] = b[:, :16]
    result = flip(image_of(a), image_of(b))
    assert result.figures((0, 0, 6, 24)).mean == 0
    assert result.figures((20, 0, 32, 24)).mean == pytest.approx(result.errors[:, 20:].mean())
    with pytest.raises(ImageError, match="region 0,0,33,1 is empty or not within"):
        result.figures((0, 0, 33, 1))


def test_flip_says_what_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = image_of(noise(1)), image_of(noise(2, 3, 4))
    with pytest.raises(ImageError, match="different sizes"):
        flip(a, b)
    with pytest.raises(SettingsError, match="pixels a degree are 0; expected a positive number"):
        flip(a, a, pixels_per_degree=0)
    monkeypatch.setattr(perceptual, "find_spec", lambda _: None)
    with pytest.raises(WdpmError, match=r"not installed: pip install 'wdpm\[flip\]'"):
        flip(a, a)


# ---- heat maps ----------------------------------------------------------------------------------------------------


def test_the_pixels_of_rel_mse_average_to_it() -> None:
    a, b = image_of(noise(1)), image_of(noise(2))
    assert pixel_errors(a, b, Heat.REL_MSE).mean() == pytest.approx(compare(a, b).rel_mse)
    assert pixel_errors(a, b, Heat.ABS).max() == pytest.approx(compare(a, b).max_abs)


def test_brighter_is_worse() -> None:
    colours = magma(np.linspace(0, 1, 50)).astype(float)
    assert (np.diff(colours @ [0.2126, 0.7152, 0.0722]) > 0).all()


@pytest.mark.parametrize(
    ("scale", "values", "shares"),
    [
        (Scale(0.0, 2.0), [0.0, 1.0, 2.0, 9.0], [0.0, 0.5, 1.0, 1.0]),
        (Scale(1e-4, 1.0, True), [0.0, 1e-4, 1e-2, 1.0, 9.0], [0.0, 0.0, 0.5, 1.0, 1.0]),
        (Scale(0.0, 0.0), [0.0, 0.0], [0.0, 0.0]),
    ],
)
def test_scales(scale: Scale, values: list[float], shares: list[float]) -> None:
    assert scale.share(np.array(values)) == pytest.approx(shares)
    assert np.isnan(scale.share(np.array([np.nan]))).all()


@pytest.mark.parametrize("heat", [Heat.REL_MSE, Heat.ABS])
@pytest.mark.parametrize("width", [32, 300])
def test_the_map_has_the_image_above_the_scale(heat: Heat, width: int) -> None:
    a, b = noise(1, width=width), noise(2, width=width)
    a[0, 0] = np.nan
    a[1, 1] = b[1, 1]
    a[2, 2] = b[2, 2] + 1e6
    picture = error_map(image_of(a), image_of(b), heat)
    assert picture.shape == (24 + 34, max(width, 256), 3)
    left = (picture.shape[1] - width) // 2
    assert picture[0, left].tolist() == [0, 255, 0]
    assert picture[1, left + 1].tolist() == magma(np.array(0.0)).tolist()
    assert picture[2, left + 2].tolist() == magma(np.array(1.0)).tolist()
    assert (picture[24:] > 200).any()  # the words of the scale


def test_equal_images_are_dark() -> None:
    a = image_of(noise(1))
    for heat in (Heat.REL_MSE, Heat.ABS):
        assert (error_map(a, a, heat)[:24] == magma(np.array(0.0))).all(axis=2)[:, 112:144].all()


def test_flip_has_one_scale_for_all() -> None:
    errors = np.full((4, 256), 0.5)
    assert flip_map(errors)[0, 0].tolist() == magma(np.array(0.5)).tolist()
    assert (flip_map(errors) == heat_map(errors, Scale(0.0, 1.0), "FLIP")).all()


# ---- command line -------------------------------------------------------------------------------------------------


@pytest.fixture
def files(tmp_path: Path) -> tuple[str, str]:
    """Two images."""
    for name, seed in (("a.exr", 1), ("b.exr", 2)):
        image_of(noise(seed)).save(tmp_path / name)
    return str(tmp_path / "a.exr"), str(tmp_path / "b.exr")


def error_of(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    capsys.readouterr()
    assert main.main(["compare", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    return err


@needs_flip
def test_figures_and_map_from_the_command_line(
    files: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heat = tmp_path / "heat.png"
    assert main.main(["compare", *files, "--json", "--heat", str(heat)]) == 0
    found = json.loads(capsys.readouterr().out)["flip"]
    expected = flip(load_image(files[0]), load_image(files[1]))
    assert found["kind"] == "hdr"
    assert found["mean"] == expected.figures().mean
    assert expected.exposures is not None
    assert found["exposures"]["count"] == expected.exposures.count
    assert load_image(heat).shape == (24 + 34, 256)
    assert main.main(["compare", *files, "--flip", "ldr", "--ppd", "30"]) == 0
    assert "(LDR, 30 pixels/degree)" in capsys.readouterr().out


@needs_flip
def test_two_screens_are_compared_as_screens(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = [str(tmp_path / "a.png"), str(tmp_path / "b.png")]
    for name, seed in zip(names, (1, 2), strict=True):
        image_of(noise(seed)).save(name)
    assert main.main(["compare", *names, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["flip"]["kind"] == "ldr"


@pytest.mark.parametrize("heat", ["rel_mse", "abs"])
def test_a_map_without_flip(
    heat: str, files: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "heat.png"
    assert main.main(["compare", *files, "--flip", "none", "--json", "--heat", str(file), "--heat-of", heat]) == 0
    assert json.loads(capsys.readouterr().out)["flip"] is None
    assert load_image(file).shape == (24 + 34, 256)


def test_without_the_package_all_else_is_there(
    files: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(perceptual, "find_spec", lambda _: None)
    heat = tmp_path / "heat.png"
    assert main.main(["compare", *files, "--heat", str(heat)]) == 0
    out = capsys.readouterr().out
    assert "relMSE" in out
    assert "No FLIP: pip install 'wdpm[flip]', or --flip none." in out
    assert heat.is_file()
    for option in (["--flip", "hdr"], ["--ppd", "30"], ["--heat", str(heat), "--heat-of", "flip"]):
        assert "FLIP: flip-evaluator is not installed" in error_of(capsys, *files, *option)


def test_options_that_do_not_go_together(
    files: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heat = str(tmp_path / "heat.png")
    assert "give --heat FILE.png, too" in error_of(capsys, *files, "--heat-of", "abs")
    said = error_of(capsys, *files, "--flip", "none", "--heat", heat, "--heat-of", "flip")
    assert "--flip none leaves nothing for --heat-of flip" in said
    assert "cannot hold both" in error_of(capsys, *files, "-o", heat, "--heat", heat)
    assert "must be one of .png" in error_of(capsys, *files, "--heat", str(tmp_path / "heat.exr"))
    assert not (tmp_path / "heat.png").exists()
