"""Tables of pixel filters against their formulas, values of Mitsuba 3.9, and edges against their convolution."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from furnaces import quad, rendered, scene
from numpy.typing import NDArray

from wdpm.cluster.render_settings import Integrator
from wdpm.kernels.camera.pixel_filter import (
    FILTER_STEPS,
    exponential,
    filter_quantiles,
    filter_signs,
    filter_values,
    is_signed,
    noise_left,
    placed_by,
    reach_of,
    sharpening,
    sinc,
    splat_table,
)
from wdpm.scenes import cornell_box
from wdpm.scenes.model.scene import Camera, FilterKind, PixelFilter

Array = NDArray[np.float64]

GAUSSIAN = PixelFilter(FilterKind.GAUSSIAN, 2.0, 0.5)
TENT = PixelFilter(FilterKind.TENT, 1.0)
MITCHELL = PixelFilter(FilterKind.MITCHELL, 2.0)
CATMULL_ROM = PixelFilter(FilterKind.MITCHELL, 2.0, b=0.0, c=0.5)
LANCZOS = PixelFilter(FilterKind.LANCZOS, 3.0)
ALL = {
    "box": PixelFilter(),
    "gaussian": GAUSSIAN,
    "tent": TENT,
    "mitchell": MITCHELL,
    "catmullrom": CATMULL_ROM,
    "lanczos": LANCZOS,
}

PLACES = (0.0, 0.25, 0.5, 0.99, 1.2, 1.7, 2.4)
MITSUBA = {
    "tent": (1.0, 0.75, 0.5, 0.01, 0.0, 0.0, 0.0),
    "mitchell": (0.88889, 0.78212, 0.53472, 0.0607, -0.01422, -0.0195, 0.0),
    "catmullrom": (1.0, 0.86719, 0.5625, 0.0052, -0.064, -0.0315, 0.0),
    "lanczos": (1.0, 0.89007, 0.60793, 0.00838, -0.118, -0.08323, 0.0295),
}
"""Their `eval` at those distances, version 3.9.1, to five digits."""


@pytest.mark.parametrize("name", list(MITSUBA))
def test_filters_are_mitsubas(name: str) -> None:
    np.testing.assert_allclose(filter_values(ALL[name], np.array(PLACES)), MITSUBA[name], atol=1e-5)


def test_filters_where_their_pieces_meet() -> None:
    at = np.array([0.0, 1.0, 2.0])
    np.testing.assert_allclose(filter_values(MITCHELL, at), [8 / 9, 1 / 18, 0], atol=1e-15)
    np.testing.assert_allclose(filter_values(CATMULL_ROM, at), [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(filter_values(LANCZOS, np.array([0.5])), [(2 / math.pi) * (3 / math.pi)], atol=1e-15)


def test_sinc_is_exact() -> None:
    x = np.linspace(-5, 5, 1001)
    np.testing.assert_allclose(sinc(x), np.sinc(x), atol=1e-14)
    np.testing.assert_allclose(exponential(-np.abs(x)), np.exp(-np.abs(x)), rtol=1e-14)


@pytest.mark.parametrize("name", ["mitchell", "catmullrom", "lanczos"])
def test_signed_steps_are_the_filter(name: str) -> None:
    """Places in proportion to |f| with f's sign have f's moments: 1, 0, and the second one."""
    found = ALL[name]
    assert is_signed(found)
    table, signs = filter_quantiles(found).astype(np.float64), filter_signs(found).astype(np.float64)
    x = np.linspace(-found.radius, found.radius, 2_000_001)
    f = filter_values(found, x)
    share = np.abs(f).sum() / f.sum()
    assert sharpening(found) == pytest.approx(share**2, rel=1e-4)
    middle = (table[1:] + table[:-1]) / 2
    for power in (0, 1, 2):
        moment = float((signs * middle**power).sum()) / FILTER_STEPS * share
        assert moment == pytest.approx(float((f * x**power).sum() / f.sum()), abs=5e-3)


@pytest.mark.parametrize("name", ["box", "gaussian", "tent"])
def test_filters_without_negative_lobes_weigh_all_samples_alike(name: str) -> None:
    assert not is_signed(ALL[name])
    assert sharpening(ALL[name]) == 1.0


def test_samples_count_as_far_as_the_filter_reaches_unless_that_is_too_far() -> None:
    wide = PixelFilter(FilterKind.LANCZOS, 4.0)
    reaches = {name: reach_of(each) for name, each in ALL.items()}
    assert reaches == {"box": 0, "gaussian": 2, "tent": 1, "mitchell": 2, "catmullrom": 2, "lanczos": 3}
    assert reach_of(wide) == reach_of(PixelFilter(FilterKind.TENT, 0.5)) == 0
    assert placed_by(TENT) == PixelFilter()
    assert placed_by(wide) == wide


def test_what_noise_a_filter_leaves() -> None:
    assert noise_left(TENT) == pytest.approx((2 / 3) ** 2, rel=1e-6)
    assert noise_left(PixelFilter(FilterKind.BOX, 1.0)) == pytest.approx(0.25, rel=1e-6)
    assert noise_left(GAUSSIAN) == pytest.approx(1 / math.pi, rel=5e-3)  # of one that is not cut off
    assert noise_left(PixelFilter()) == noise_left(PixelFilter(FilterKind.LANCZOS, 4.0)) == 1.0


@pytest.mark.parametrize("name", ["gaussian", "tent", "mitchell", "catmullrom", "lanczos"])
def test_filters_between_entries_of_their_tables(name: str) -> None:
    found, x = ALL[name], np.linspace(0.0, ALL[name].radius, 12_345)
    between = np.interp(x, np.linspace(0.0, found.radius, FILTER_STEPS + 1), splat_table(found))
    np.testing.assert_allclose(between, filter_values(found, x), atol=1e-5)


SIZE = 16
CORNER = 0.13, -0.21


def _corner_image(pixel_filter: PixelFilter, spp: int, **chosen: object) -> Array:
    """A glowing quarter of the plane on black, by parallel rays; 1 where it is."""
    to_world = np.diag([-1.0, 1.0, -1.0, 1.0])
    to_world[2, 3] = 5.0
    camera = Camera(to_world, 90.0, SIZE, SIZE, 1e-2, 100.0, filter=pixel_filter, orthographic=True)
    plane = quad((*CORNER, 0.0), (9, 0, 0), (0, 9, 0), emission=(1.0, 1.0, 1.0))
    image = rendered(scene([plane], camera, (0.0, 0.0, 0.0)), spp=spp, photons=0, max_depth=1, **chosen)
    return image.layers["beauty"][..., 0].astype(np.float64)


def _convolved(pixel_filter: PixelFilter) -> Array:
    """The same, by the integral of the filter over what it covers of the quarter."""
    x = np.linspace(-pixel_filter.radius, pixel_filter.radius, 100_001)
    f = filter_values(pixel_filter, x) / filter_values(pixel_filter, x).sum()
    centres = np.arange(SIZE) + 0.5
    along_x = [f[x + centre >= (CORNER[0] + 1) / 2 * SIZE].sum() for centre in centres]
    along_y = [f[x + centre <= (1 - CORNER[1]) / 2 * SIZE].sum() for centre in centres]
    return np.outer(along_y, along_x)


@pytest.mark.parametrize("name", list(ALL))
def test_edges_are_convolved_with_the_filter(name: str) -> None:
    """256 samples a pixel: without stratification, c x 0.5 / 16 at the edge; it is far less, and averages out."""
    error = _corner_image(ALL[name], 256) - _convolved(ALL[name])
    edge = _convolved(ALL[name])
    at_edge = (np.abs(edge) > 1e-3) & (np.abs(edge - 1) > 1e-3)
    assert np.abs(error).max() < 0.06
    assert abs(float(error[at_edge].mean())) < 0.004


def test_an_even_surface_is_even_whatever_the_signs() -> None:
    inside = _corner_image(LANCZOS, 3)[:4, -4:]
    np.testing.assert_allclose(inside, 1.0, rtol=1e-6)


@pytest.mark.parametrize("name", ["tent", "gaussian"])
def test_noise_is_what_the_filter_leaves_of_it(name: str) -> None:
    """Paths in a room, one sample of each pixel: four seeds against those of a box, where nothing has an edge."""
    room = cornell_box((24, 24))

    def noise(pixel_filter: PixelFilter) -> float:
        seen = replace(room, camera=replace(room.camera, filter=pixel_filter, fov_x=8.0))
        chosen = {"spp": 1, "integrator": Integrator.PATH, "light_samples": 1, "max_depth": 3}
        images = [rendered(seen, photons=0, seed=seed, **chosen).layers["indirect"] for seed in range(4)]
        return float(np.var(np.asarray(images, np.float64)[:, 4:-4, 4:-4], axis=0, ddof=1).mean())

    assert noise(ALL[name]) / noise(PixelFilter()) == pytest.approx(noise_left(ALL[name]), rel=0.25)


def test_passes_of_few_samples_make_the_same_edge() -> None:
    error = _corner_image(MITCHELL, 128, passes=32) - _convolved(MITCHELL)
    assert abs(float(error.mean())) < 0.004
    assert float(np.sqrt((error**2).mean())) < 0.02
