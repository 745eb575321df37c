"""Direct light against closed forms: Lambert's polygon formula, and the inverse square law."""

from __future__ import annotations

import numpy as np
import pytest
from furnaces import Array, quad, rendered, scene, view
from polygon_light import polygon_irradiance

from wdpm.scenes.model.lights import PointLight

ALBEDO = (0.8, 0.4, 0.1)
RADIANCE = (10.0, 5.0, 1.0)


def test_the_formula_gives_the_textbooks_form_factor() -> None:
    """A patch below the corner of a parallel rectangle a x b at the distance c (Howell, configuration B-3)."""
    a, b, c = 2.0, 3.0, 1.5
    x, y = a / c, b / c
    textbook = (
        x / np.sqrt(1 + x * x) * np.arctan(y / np.sqrt(1 + x * x))
        + y / np.sqrt(1 + y * y) * np.arctan(x / np.sqrt(1 + y * y))
    ) / (2 * np.pi)
    corners = np.array([[0, c, 0], [a, c, 0], [a, c, b], [0, c, b]], float)
    irradiance = polygon_irradiance(corners, np.zeros(3), np.array([0.0, 1, 0]))
    assert irradiance == pytest.approx(np.pi * textbook, rel=1e-12)


# name: corner, u, v of the lamp (it faces u x v)
LAMPS = {
    "parallel": ((-1, 2, -1), (2, 0, 0), (0, 0, 2)),
    "parallel, aside": ((1, 1.5, 0.5), (1, 0, 0), (0, 0, 1.5)),
    "perpendicular": ((-1.5, 0.2, -1), (0, 1.5, 0), (0, 0, 2)),
    "slanted": ((-1, 1.5, -1), (2, 1, 0), (0, 0, 2)),
}


@pytest.mark.parametrize("lamp", list(LAMPS))
@pytest.mark.parametrize("light_samples", [1, 4])
def test_a_rectangle_lights_a_patch(lamp: str, light_samples: int) -> None:
    corner, u, v = (np.array(x, float) for x in LAMPS[lamp])
    if np.cross(u, v) @ (np.zeros(3) - corner) < 0:
        u, v = v, u  # it shall face the patch
    lamp_mesh = quad(corner, u, v, 0, RADIANCE)
    floor = quad((-50, 0, -50), (0, 0, 100), (100, 0, 0))
    # The image shows 1e-3 of floor about the origin: over it the irradiance is linear to 1e-6.
    looking = scene([floor, lamp_mesh], view((0.3, 1.0, -4.0), (0, 0, 0), 0.01), ALBEDO)
    image = rendered(looking, photons=0, spp=256, light_samples=light_samples)
    seen = image.layers["direct"].astype(np.float64).mean(axis=(0, 1))
    polygon = np.array([corner, corner + u, corner + u + v, corner + v])
    exact = (
        np.array(ALBEDO) * np.array(RADIANCE) / np.pi * polygon_irradiance(polygon, np.zeros(3), np.array([0.0, 1, 0]))
    )
    # 64 pixels x 256 samples = 16,384 at least. A sample's integrand cos cos / d² varies over these lamps by less
    # than 100 % (standard deviation over mean, asserted), so the mean of independent ones would be off by 1 / 128 =
    # 0.8 % at most; 256 stratified samples a pixel leave the variation within a stratum, 1/16 across: 16 times less.
    # Six of that: 0.3 %.
    np.testing.assert_allclose(seen, exact, rtol=3e-3)
    assert relative_deviation(polygon) < 1.0
    assert not image.layers["indirect"].any()


def relative_deviation(polygon: Array) -> float:
    """Standard deviation of cos cos / d² over a parallelogram, over its mean."""
    s, t = np.meshgrid(*[(np.arange(64) + 0.5) / 64] * 2)
    u, v = polygon[1] - polygon[0], polygon[3] - polygon[0]
    places = polygon[0] + s.reshape(-1, 1) * u + t.reshape(-1, 1) * v
    distance2 = (places**2).sum(axis=1)
    integrand = places[:, 1] * np.abs(places @ np.cross(u, v)) / distance2**2
    return float(integrand.std() / integrand.mean())


def test_a_lamp_shows_its_radiance_and_only_from_its_front() -> None:
    lamp = quad((-1, 0, -1), (0, 0, 2), (2, 0, 0), 0, RADIANCE)  # faces up
    above = rendered(scene([lamp], view((0, 3, 0.1), (0, 0, 0), 20), (0, 0, 0)), photons=0, spp=1)
    np.testing.assert_array_equal(above.pixels, np.broadcast_to(np.float32(RADIANCE), above.pixels.shape))
    below = rendered(scene([lamp], view((0, -3, 0.1), (0, 0, 0), 20), (0, 0, 0)), photons=0, spp=1)
    assert (below.layers["depth"] > 0).all()
    assert not below.pixels.any()


@pytest.mark.parametrize("distance", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("angle", [0, 40, 80])
def test_a_point_light_falls_off_with_the_square(distance: float, angle: float) -> None:
    a = np.radians(angle)
    place = (distance * np.sin(a), distance * np.cos(a), 0.0)
    floor = quad((-50, 0, -50), (0, 0, 100), (100, 0, 0))
    looking = scene([floor], view((0, 2, -3), (0, 0, 0), 0.001), ALBEDO, (PointLight("p", place, RADIANCE),))
    image = rendered(looking, photons=0, spp=1)
    exact = np.array(ALBEDO) / np.pi * np.array(RADIANCE) * np.cos(a) / distance**2
    # No sampling. The pixels see within 4e-5 of the origin: relative slopes up to 3 / 0.5 plus tan 80° / 0.5 give
    # 7e-4 at a corner, which cancels in the mean; what is left is its square, and the coordinates' rounding, 50 *
    # 2^-24 / 0.5 tan 80°.
    np.testing.assert_allclose(image.layers["direct"].mean(axis=(0, 1), dtype=np.float64), exact, rtol=1e-4)


def test_two_lights_add_up_and_a_blocker_takes_one_away() -> None:
    floor = quad((-5, 0, -5), (0, 0, 10), (10, 0, 0))
    left, right = PointLight("left", (-1, 1, 0), (3, 3, 3)), PointLight("right", (1, 1, 0), (1, 1, 1))
    screen = quad((-0.5, 0.2, -1), (0, 1, 0), (0, 0, 2))  # hides the left light from the origin
    camera = view((0, 2, -3), (0, 0, 0), 0.001)
    one = 1 / np.pi * 0.5 / 2 / np.sqrt(2)  # albedo / pi * cos / d²
    for meshes, exact in (([floor], 4 * one), ([floor, screen], one)):
        image = rendered(scene(meshes, camera, (0.5,) * 3, (left, right)), photons=0, spp=1024, light_samples=1)
        # The lights are chosen 3 : 1 in proportion to their power, so a sample's value is the same for both in the
        # open; with the screen it is a stratified choice with p = 1/4, off by at most 1 in 1024 a pixel.
        np.testing.assert_allclose(image.layers["direct"].mean(), exact, rtol=4e-3)
