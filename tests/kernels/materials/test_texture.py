"""Texture lookup against plain numpy and Mitsuba, for every kind of texture, wrap mode and interpolation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from texture_lookup import Array, looked_up, values

from wdpm.kernels.features import Features
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Interpolation, Texture, VertexColors, Wrap

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


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


TO_UV = np.array([[2.0, 0.5, 0.1], [-0.25, 3.0, 0.7], [0.0, 0.0, 1.0]])
LUMINANCE = np.array([0.212671, 0.715160, 0.072169])


def test_a_checkerboard_is_mitsubas() -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    board = Checkerboard("board", (0.1, 0.2, 0.3), (0.9, 0.8, 0.7), TO_UV)
    to_uv = np.eye(4)
    to_uv[:2, :2], to_uv[:2, 3] = TO_UV[:2, :2], TO_UV[:2, 2]
    plugin = {"type": "checkerboard", "to_uv": mi.ScalarTransform4f(to_uv)}
    for name, colour in (("color0", board.color0), ("color1", board.color1)):
        plugin[name] = {"type": "rgb", "value": list(colour)}
    theirs = mi.load_dict(plugin)
    uv = np.random.default_rng(20).uniform(-3, 3, (400, 2)).astype(np.float32)
    colour, slope = values([board], np.zeros(400, np.int32), uv)
    wanted = []
    for point in uv:
        si = mi.SurfaceInteraction3f()
        si.uv = mi.Point2f(point)
        wanted.append(np.array(theirs.eval(si)))
    np.testing.assert_allclose(colour, wanted, rtol=1e-6)
    assert 0.4 < np.mean(colour[:, 0] < 0.5) < 0.6
    assert not slope.any()


def test_borders_of_a_checkerboard() -> None:
    """The middle belongs to the first half of a repeat, its end to the next one."""
    board = Checkerboard("board", (1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    first_half = np.float32([0.0, 0.25, 0.5, 1.0, 1.5, -1.0, -0.5])
    second_half = np.float32([0.75, np.nextafter(np.float32(0.5), np.float32(1.0)), -0.25, 1.75])
    for u, same in ((first_half, 1.0), (second_half, 0.0)):
        uv = np.column_stack([u, np.full_like(u, 0.25)])
        for order in (uv, uv[:, ::-1].copy()):
            colour, _ = values([board], np.zeros(len(u), np.int32), order)
            np.testing.assert_array_equal(colour, same)


def test_vertex_colours_are_scaled() -> None:
    colour = np.random.default_rng(21).uniform(0, 1, (50, 3)).astype(np.float32)
    textures: list[Texture] = [VertexColors("paint"), VertexColors("light", 2.5)]
    for image, scale in ((0, 1.0), (1, 2.5)):
        found, slope = values(textures, np.full(50, image, np.int32), np.zeros((50, 2), np.float32), colour)
        np.testing.assert_array_equal(found, colour * np.float32(scale))
        assert not slope.any()


@pytest.mark.parametrize("wrap", list(Wrap))
def test_slope_is_that_of_the_looked_up_luminance(wrap: Wrap) -> None:
    bitmap = Bitmap("noise", noise(22, 5, 7), wrap, Interpolation.BILINEAR, TO_UV)
    uv = np.random.default_rng(23).uniform(-1, 2, (1000, 2)).astype(np.float32)
    _, slope = values([bitmap], np.zeros(len(uv), np.int32), uv)
    step = 1e-5
    wanted = np.empty((len(uv), 2))
    for axis in (0, 1):
        ends = [luminance_in_double(bitmap, uv + sign * step * np.eye(2)[axis]) for sign in (1.0, -1.0)]
        wanted[:, axis] = (ends[0] - ends[1]) / (2 * step)
    # Away from the lines through texel centres, where the slope jumps.
    mapped = np.column_stack([uv, np.ones(len(uv))]) @ TO_UV.T
    place = mapped[:, :2] * [7, 5] - 0.5
    clear = (np.abs(place - np.round(place)) > 1e-3).all(axis=1)
    assert clear.mean() > 0.9
    np.testing.assert_allclose(slope[clear], wanted[clear], atol=2e-4 * np.abs(wanted).max())
    if wrap is not Wrap.CLAMP:
        assert np.median(np.abs(slope)) > 1.0


def luminance_in_double(bitmap: Bitmap, uv: Array) -> Array:
    """As `expected`, for uv in double."""
    height, width, _ = bitmap.pixels.shape
    u, v, _ = (np.column_stack([uv, np.ones(len(uv))]) @ np.asarray(bitmap.to_uv).T).T
    x, y = u * width - 0.5, (1 - v) * height - 0.5
    c, r = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    total = np.zeros(len(uv))
    for column, across in ((c, 1 - (x - c)), (c + 1, x - c)):
        for row, down in ((r, 1 - (y - r)), (r + 1, y - r)):
            rows, columns = wrapped(row, height, bitmap.wrap), wrapped(column, width, bitmap.wrap)
            total += across * down * (bitmap.pixels[rows, columns].astype(np.float64) @ LUMINANCE)
    return total


def test_an_image_without_interpolation_has_no_slope() -> None:
    bitmap = Bitmap("noise", noise(24, 4, 4), interpolation=Interpolation.NEAREST)
    uv = np.random.default_rng(25).uniform(0, 1, (100, 2)).astype(np.float32)
    assert not values([bitmap], np.zeros(100, np.int32), uv)[1].any()


def test_specialised_lookup_gives_the_same_bits() -> None:
    """Textures of all kinds in one table; each kind looked up by a kernel for it alone, and by one for all."""
    rng = np.random.default_rng(26)
    textures: list[Texture] = [
        Bitmap("noise", noise(27, 6, 3), Wrap.MIRROR, Interpolation.BILINEAR, TO_UV),
        Checkerboard("board", to_uv=TO_UV),
        VertexColors("paint", 0.5),
    ]
    uv, colour = rng.uniform(-2, 2, (500, 2)).astype(np.float32), rng.uniform(0, 1, (500, 3)).astype(np.float32)
    for image, kind in enumerate(("bitmaps", "checkerboards", "vertex_colors")):
        images = np.full(500, image, np.int32)
        every = values(textures, images, uv, colour)
        alone = values(textures, images, uv, colour, Features(**{kind: True}))
        for one, other in zip(every, alone, strict=True):
            np.testing.assert_array_equal(one.view(np.uint32), other.view(np.uint32))
        assert len(np.unique(every[0], axis=0)) > 1


def test_tinted_images_are_multiplied_by_the_colours_of_vertices() -> None:
    bitmap = Bitmap("noise", noise(9, 4, 5))
    rng = np.random.default_rng(10)
    uv = rng.uniform(0, 1, (200, 2)).astype(np.float32)
    colour = rng.uniform(0, 1, (200, 3)).astype(np.float32)
    images = np.zeros(200, np.int32)
    plain, _ = values([bitmap], images, uv, colour)
    tinted, _ = values([replace(bitmap, tinted=True)], images, uv, colour)
    np.testing.assert_array_equal(tinted, plain * colour)
