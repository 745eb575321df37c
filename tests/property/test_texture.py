"""Texture lookup against plain numpy, for every wrap mode and interpolation, far inside and far outside."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels import texture
from wdpm.kernels.texture import Textures, lookup
from wdpm.scenes.model import Bitmap, Interpolation, Wrap

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Array = NDArray[np.float64]


@wp.kernel
def lookup_kernel(
    textures: Textures,
    image: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    colour_out: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    colour_out[i] = lookup(textures, image[i], uv[i])


def looked_up(bitmaps: list[Bitmap], image: NDArray[np.int32], uv: NDArray[np.float32]) -> Array:
    colour = wp.empty(len(uv), dtype=wp.vec3, device="cpu")
    inputs = [texture.upload(bitmaps, "cpu"), wp.array(image, dtype=wp.int32, device="cpu")]
    inputs += [wp.array(uv, dtype=wp.vec2, device="cpu"), colour]
    wp.launch(lookup_kernel, len(uv), inputs=inputs, device="cpu")
    return np.asarray(colour.numpy(), np.float64)


def wrapped(index: NDArray[np.int64], size: int, wrap: Wrap) -> NDArray[np.int64]:
    """The textbook's wrap of a texel's column or row."""
    if wrap is Wrap.CLAMP:
        return np.clip(index, 0, size - 1)
    if wrap is Wrap.REPEAT:
        return index % size
    period = index % (2 * size)
    return np.where(period < size, period, 2 * size - 1 - period)


def expected(bitmap: Bitmap, uv: NDArray[np.float32]) -> Array:
    """Bilinear or nearest lookup in double precision, without any reduction of uv."""
    height, width, _ = bitmap.pixels.shape
    mapped = np.column_stack([uv.astype(np.float64), np.ones(len(uv))]) @ np.asarray(bitmap.to_uv, np.float64).T
    x, y = mapped[:, 0] * width, (1.0 - mapped[:, 1]) * height

    def texel(column: Array, row: Array) -> Array:
        columns = wrapped(column.astype(np.int64), width, bitmap.wrap)
        rows = wrapped(row.astype(np.int64), height, bitmap.wrap)
        return bitmap.pixels[rows, columns].astype(np.float64)

    if bitmap.interpolation is Interpolation.NEAREST:
        return texel(np.floor(x), np.floor(y))
    x, y = x - 0.5, y - 0.5
    c, r = np.floor(x), np.floor(y)
    fx, fy = (x - c)[:, None], (y - r)[:, None]
    top = texel(c, r) * (1 - fx) + texel(c + 1, r) * fx
    bottom = texel(c, r + 1) * (1 - fx) + texel(c + 1, r + 1) * fx
    return np.asarray(top * (1 - fy) + bottom * fy)


def noise(seed: int, height: int, width: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(0, 1, (height, width, 3)).astype(np.float32)


def away_from_borders(bitmap: Bitmap, uv: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Where the nearest texel does not hang on the last bits of a coordinate."""
    height, width, _ = bitmap.pixels.shape
    mapped = np.column_stack([uv.astype(np.float64), np.ones(len(uv))]) @ np.asarray(bitmap.to_uv, np.float64).T
    x, y = mapped[:, 0] * width, mapped[:, 1] * height
    # A float32 of size s is off by s 2^-24; three roundings, times the texels across.
    slack = 4e-7 * (1 + np.abs(mapped).max(axis=1)) * max(width, height)
    return (np.abs(x - np.round(x)) > slack) & (np.abs(y - np.round(y)) > slack)


@pytest.mark.parametrize("wrap", list(Wrap))
@pytest.mark.parametrize("size", [(1, 1), (1, 4), (3, 2), (8, 8), (5, 7)])
@pytest.mark.parametrize("reach", [1.0, 3.0, 100.0])
def test_bilinear_lookup(wrap: Wrap, size: tuple[int, int], reach: float) -> None:
    bitmap = Bitmap("noise", noise(1, *size), wrap, Interpolation.BILINEAR)
    uv = np.random.default_rng(2).uniform(-reach, 1 + reach, (2000, 2)).astype(np.float32)
    colour = looked_up([bitmap], np.zeros(len(uv), np.int32), uv)
    # A coordinate is off by a few roundings of its size; the colour by that times the steepest slope, a texel's 1.
    tolerance = 6 * 2.0**-24 * (1 + reach) * max(size) + 1e-6
    np.testing.assert_allclose(colour, expected(bitmap, uv), atol=tolerance)


@pytest.mark.parametrize("wrap", list(Wrap))
@pytest.mark.parametrize("reach", [1.0, 100.0])
def test_nearest_lookup(wrap: Wrap, reach: float) -> None:
    bitmap = Bitmap("noise", noise(3, 5, 6), wrap, Interpolation.NEAREST)
    uv = np.random.default_rng(4).uniform(-reach, 1 + reach, (2000, 2)).astype(np.float32)
    clear = away_from_borders(bitmap, uv)
    assert clear.mean() > 0.95
    colour = looked_up([bitmap], np.zeros(len(uv), np.int32), uv)
    np.testing.assert_array_equal(colour[clear], expected(bitmap, uv)[clear])


def test_texel_centres_are_exact() -> None:
    """At a texel's centre both interpolations give the texel; row 0 is the top, at v = 1."""
    pixels = noise(5, 4, 8)
    row, column = (index.ravel() for index in np.indices((4, 8)))
    uv = np.column_stack([(column + 0.5) / 8, 1 - (row + 0.5) / 4]).astype(np.float32)
    for interpolation in Interpolation:
        bitmap = Bitmap("noise", pixels, Wrap.REPEAT, interpolation)
        for shift in ([0, 0], [3, -2], [-1000, 500]):  # powers of two divide: all sums are exact
            colour = looked_up([bitmap], np.zeros(32, np.int32), uv + np.float32(shift))
            np.testing.assert_array_equal(colour, pixels[row, column])


def test_uv_are_mapped_before_the_lookup() -> None:
    to_uv = np.array([[0.5, -2.0, 0.25], [1.5, 0.75, -3.0], [0.0, 0.0, 1.0]])
    for wrap in Wrap:
        bitmap = Bitmap("noise", noise(6, 4, 4), wrap, Interpolation.BILINEAR, to_uv)
        uv = np.random.default_rng(7).uniform(-2, 2, (500, 2)).astype(np.float32)
        colour = looked_up([bitmap], np.zeros(500, np.int32), uv)
        np.testing.assert_allclose(colour, expected(bitmap, uv), atol=6 * 2.0**-24 * 8 * 4 + 1e-6)


def test_many_textures_share_one_array() -> None:
    rng = np.random.default_rng(8)
    kinds = [(wrap, interpolation) for wrap in Wrap for interpolation in Interpolation]
    bitmaps = [
        Bitmap(str(i), noise(10 + i, int(rng.integers(1, 9)), int(rng.integers(1, 9))), *kinds[i % len(kinds)])
        for i in range(12)
    ]
    image = rng.integers(0, 12, 3000).astype(np.int32)
    uv = rng.uniform(-2, 3, (3000, 2)).astype(np.float32)
    colour = looked_up(bitmaps, image, uv)
    for i, bitmap in enumerate(bitmaps):
        chosen = (image == i) & away_from_borders(bitmap, uv)
        np.testing.assert_allclose(colour[chosen], expected(bitmap, uv[chosen]), atol=2e-5)


@pytest.mark.parametrize("wrap", list(Wrap))
@pytest.mark.parametrize("interpolation", list(Interpolation))
def test_huge_coordinates_stay_in_the_image(wrap: Wrap, interpolation: Interpolation) -> None:
    """Any finite uv gives a colour of the image; one that no float32 tells apart within a repeat, some colour of it."""
    pixels = noise(9, 3, 3)
    bitmap = Bitmap("noise", pixels, wrap, interpolation)
    ends = np.float32([-3e38, -1e10, -1e7, -(2.0**20), -1.0, -1e-30, -0.0, 0.0, 1e-45, 1.0, 2.0**20, 1e7, 1e10, 3e38])
    uv = np.stack(np.meshgrid(ends, ends), axis=2).reshape(-1, 2)
    colour = looked_up([bitmap], np.zeros(len(uv), np.int32), uv)
    assert np.isfinite(colour).all()
    assert colour.min() >= pixels.min() - 1e-6
    assert colour.max() <= pixels.max() + 1e-6
    if wrap is Wrap.CLAMP:
        far = np.abs(uv).min(axis=1) > 1.5
        rows, columns = np.where(uv[far, 1] > 0, 0, 2), np.where(uv[far, 0] > 0, 2, 0)
        np.testing.assert_array_equal(colour[far], pixels[rows, columns])


def test_a_constant_texture_is_constant_everywhere() -> None:
    uv = np.random.default_rng(12).uniform(-50, 50, (2000, 2)).astype(np.float32)
    for wrap in Wrap:
        bitmap = Bitmap("flat", np.full((5, 3, 3), 0.25, np.float32), wrap)
        np.testing.assert_allclose(looked_up([bitmap], np.zeros(2000, np.int32), uv), 0.25, rtol=3e-7)
