"""Comparison of images: the figures against their definitions by hand, and the picture against its scale."""

from __future__ import annotations

import io
import json
import math

import numpy as np
import pytest
from rich.console import Console

from wdpm.images.comparison import compare
from wdpm.images.difference_picture import difference_picture, heat, round_scale, signed_difference
from wdpm.images.image import Image
from wdpm.scenes.errors import ImageError


def flat(value: float, height: int = 2, width: int = 3, **layers: np.ndarray) -> Image:
    return Image({"beauty": np.full((height, width, 3), value, dtype=np.float32), **layers})


def random_image(seed: int, height: int = 16, width: int = 24) -> Image:
    return Image({"beauty": np.random.default_rng(seed).uniform(0, 3, (height, width, 3)).astype(np.float32)})


def test_figures_of_flat_images() -> None:
    figures = compare(flat(1.5), flat(1.0))
    assert figures.mse == 0.25
    assert figures.rmse == 0.5
    assert figures.rel_mse == pytest.approx(0.25 / 1.01, rel=1e-15)
    assert figures.psnr == pytest.approx(10 * math.log10(1 / 0.25), rel=1e-15)
    assert figures.max_abs == 0.5
    assert figures.mean_a == (1.5, 1.5, 1.5)
    assert figures.ratio == (1.5, 1.5, 1.5)
    assert not figures.bits_equal
    assert figures.differing_pixels == 6
    assert (figures.width, figures.height) == (3, 2)


def test_figures_against_their_definitions() -> None:
    image, reference = random_image(1), random_image(2)
    a, b = image.pixels.astype(np.longdouble), reference.pixels.astype(np.longdouble)
    figures = compare(image, reference)
    assert figures.mse == pytest.approx(float(((a - b) ** 2).mean()), rel=1e-13)
    assert figures.rel_mse == pytest.approx(float(((a - b) ** 2 / (b**2 + 0.01)).mean()), rel=1e-13)
    assert figures.psnr == pytest.approx(20 * math.log10(float(b.max())) - 10 * math.log10(figures.mse), rel=1e-13)
    assert figures.mean_b == pytest.approx(tuple(b.mean(axis=(0, 1)).astype(float)), rel=1e-13)


def test_relative_error_is_relative_to_the_second() -> None:
    assert compare(flat(0.0), flat(1.0)).rel_mse == pytest.approx(1 / 1.01)
    assert compare(flat(1.0), flat(0.0)).rel_mse == pytest.approx(1 / 0.01)


def test_an_image_equals_itself_even_with_nan() -> None:
    pixels = random_image(3).pixels.copy()
    pixels[0, 0, 0] = np.nan
    figures = compare(Image({"beauty": pixels}), Image({"beauty": pixels.copy()}))
    assert figures.bits_equal
    assert figures.mse == 0
    assert figures.psnr == math.inf
    assert (figures.nonfinite_a, figures.nonfinite_b) == (1, 1)


def test_zero_and_minus_zero_differ_in_bits_only() -> None:
    figures = compare(flat(0.0), flat(-0.0))
    assert figures.max_abs == 0
    assert not figures.bits_equal
    assert figures.differing_pixels == 6


def test_the_last_bit_of_any_common_layer_counts() -> None:
    depth = np.ones((2, 3), dtype=np.float32)
    nudged = depth.copy()
    nudged[1, 2] = np.nextafter(np.float32(1), np.float32(2))
    cell = np.zeros((2, 3), dtype=np.float32)
    figures = compare(flat(1, depth=depth, cell=cell), flat(1, depth=nudged))
    assert figures.layers == ("beauty", "depth")
    assert figures.differing == {"beauty": 0, "depth": 1}
    assert figures.differing_pixels == 1
    assert figures.mse == 0


def test_the_layer_that_shows_the_partition_is_not_among_those_that_are_named() -> None:
    cell = np.zeros((2, 3), dtype=np.float32)
    console = Console(file=io.StringIO(), width=200)
    compare(flat(1, cell=cell), flat(2, cell=cell - 1)).print(console)
    assert "differ in 6 pixels, 100.00% (beauty 6)" in console.file.getvalue()  # type: ignore[attr-defined]


def test_a_pixel_that_differs_in_two_layers_counts_once() -> None:
    one, two = np.ones((2, 3), dtype=np.float32), np.full((2, 3), 2, dtype=np.float32)
    assert compare(flat(1, depth=one), flat(2, depth=two)).differing_pixels == 6


def test_values_that_are_not_finite_are_counted_and_left_out() -> None:
    pixels = flat(2.0).pixels.copy()
    pixels[0, 0] = [np.inf, np.nan, 2]
    figures = compare(Image({"beauty": pixels}), flat(1.0))
    assert (figures.nonfinite_a, figures.nonfinite_b) == (2, 0)
    assert figures.mse == 1
    assert figures.mean_a == (2, 2, 2)


def test_a_region() -> None:
    pixels = flat(1.0, 4, 6).pixels.copy()
    pixels[1:3, 2:5] = 3
    image = Image({"beauty": pixels})
    assert compare(image, flat(1.0, 4, 6), (2, 1, 5, 3)).mse == 4
    assert compare(image, flat(1.0, 4, 6), (0, 0, 6, 1)).bits_equal
    with pytest.raises(ImageError, match="region 0,0,7,1 is empty or not within the image of 6x4"):
        compare(image, image, (0, 0, 7, 1))
    with pytest.raises(ImageError, match="is empty"):
        compare(image, image, (2, 2, 2, 3))


def test_different_sizes() -> None:
    with pytest.raises(ImageError, match="different sizes, 3x2 and 2x3"):
        compare(flat(1, 2, 3), flat(1, 3, 2))
    with pytest.raises(ImageError, match="different sizes"):
        difference_picture(flat(1, 2, 3), flat(1, 3, 2))


def test_json_has_no_infinity() -> None:
    figures = json.loads(compare(flat(0.0), flat(0.0)).to_json())
    assert figures["psnr"] is None
    assert figures["ratio"] == [None, None, None]
    assert figures["bits_equal"] is True


def printed(a: Image, b: Image) -> str:
    console = Console(width=100, record=True, quiet=True)
    compare(a, b).print(console)
    console.quiet = False
    with console.capture() as capture:
        compare(a, b).print(console)
    return capture.get()


def test_the_table_says_which_bits_differ() -> None:
    assert "all equal (beauty)" in printed(flat(1.0), flat(1.0))
    assert "differ in 6 pixels, 100.00% (beauty 6)" in printed(flat(1.0), flat(2.0))
    assert "6 of B, left out" not in printed(flat(1.0), flat(2.0))
    assert "0 values of A, 18 of B, left out above" in printed(flat(1.0), flat(np.nan))


@pytest.mark.parametrize(("limit", "scale"), [(0.9, 1), (1.0, 1), (1.1, 2), (3.0, 5), (6.0, 10), (0.00012, 0.0002)])
def test_scales_are_round(limit: float, scale: float) -> None:
    assert round_scale(np.array([0.0, limit, -limit, np.nan])) == pytest.approx(scale)


def test_no_difference_has_no_scale() -> None:
    assert round_scale(np.zeros((3, 3))) == 0
    assert not heat(np.zeros((3, 3)), 0.0).any()


def test_relative_differences_square_to_rel_mse_on_grey() -> None:
    values = signed_difference(flat(1.5), flat(1.0), relative=True)
    assert (values**2).mean() == pytest.approx(compare(flat(1.5), flat(1.0)).rel_mse)


def test_the_channel_that_differs_most_is_shown_with_its_sign() -> None:
    a, b = flat(1.0, 1, 1).pixels.copy(), flat(1.0, 1, 1)
    a[0, 0] = [1.25, 0.5, 1.0]
    assert signed_difference(Image({"beauty": a}), b, relative=False).tolist() == [[-0.5]]


def test_colours_tell_darker_from_brighter_from_broken() -> None:
    darker, equal, brighter, broken = heat(np.array([-1.0, 0.0, 1.0, np.nan]), 2.0).astype(int)
    assert darker[2] > darker[0] + 50
    assert equal.tolist() == [0, 0, 0]
    assert brighter[0] > brighter[2] + 50
    assert broken.tolist() == [255, 0, 255]


@pytest.mark.parametrize("width", [3, 300])
def test_the_picture_has_the_image_above_the_scale(width: int) -> None:
    pixels = flat(1.0, 20, width).pixels.copy()
    pixels[0, 0] = 2
    picture = difference_picture(Image({"beauty": pixels}), flat(1.0, 20, width), relative=False)
    left = (picture.shape[1] - width) // 2
    assert picture.shape == (54, max(width, 256), 3)
    assert picture[0, left].tolist() == heat(np.array([1.0]), 1.0)[0].tolist()
    assert not picture[1:20, left : left + width].any()
    assert (picture[20:] > 200).any()  # the words of the scale


def test_the_function_is_not_hidden_by_a_module_of_its_name() -> None:
    import wdpm

    assert all(callable(wdpm.compare) for _ in range(3))
