"""White furnaces: where all surfaces glow with Le and reflect rho, radiance is Le / (1 - rho), whatever is inside.

Light once reflected off what is seen is `direct`: Le + rho Le. All other is `indirect`: Le rho² / (1 - rho).

This holds for any geometry in a closed room, so it is the test of the measured area of gathers, too: at edges, in
corners and on strips much narrower than a gather the light is the same as in the middle of a wall.
"""

from __future__ import annotations

import numpy as np
import pytest
from furnaces import Array, box, hollow_sphere, rendered, scene, view
from numpy.typing import ArrayLike

from wdpm.scenes.model.scene import Mesh

LE = 1.0
GLOW = (LE, LE, LE)
RHO = 0.5
GREY = (RHO, RHO, RHO)
INDIRECT = LE * RHO**2 / (1 - RHO)

PHOTONS = 200_000
# The total flux of the map is that of N paths, each with 1 / (1 - rho) = 2 landings on average, one of them stored.
# Their number a path is geometric with a variance of rho / (1 - rho)² = 2, so the density is off by sqrt(2 / N), N =
# 200,000: 0.3 %. A view that shows a share s of the surface sees s N photons or a few k; its mean is off by 1 /
# sqrt(s N) or so: 1 % at s = 0.05. Four standard deviations and the count of surface points (stratified, 8 % a gather
# at worst, averaged over hundreds of independent places: 0.5 %, and 0.3 % for the bias of one over a count) make 3 %.
TOLERANCE = 0.03


def indirect(meshes: list[Mesh], eye: ArrayLike, target: ArrayLike, fov: float, k: int = 50) -> tuple[float, float]:
    """Mean indirect radiance of a view, and the largest gather radius."""
    image = rendered(scene(meshes, view(eye, target, fov, 16), GREY), photons=PHOTONS, k=k, spp=4)
    assert (image.layers["depth"] > 0).all()
    return float(image.layers["indirect"].mean(dtype=np.float64)), image.metadata["report"]["settings"]["gather_radius"]


@pytest.mark.parametrize("smooth", [False, True])
def test_a_sphere(smooth: bool) -> None:
    image = rendered(
        scene([hollow_sphere(smooth, GLOW)], view((0.1, 0.2, 0), (1, 0, 0), 90, 16), GREY),
        photons=PHOTONS,
        spp=16,
        light_samples=4,
    )
    # In a sphere the integrand of direct light, cos cos / d², is the same everywhere: only the facets (128 around)
    # vary.
    np.testing.assert_allclose(image.layers["direct"].mean(), LE + RHO * LE, rtol=5e-3)
    np.testing.assert_allclose(image.layers["indirect"].mean(), INDIRECT, rtol=0.02)
    np.testing.assert_allclose(image.pixels.mean(), LE / (1 - RHO), rtol=0.01)
    # No place is dark: a gather of 50 photons has a deviation of 14 %, and 16 samples of a pixel see the same photons.
    assert image.layers["indirect"].min() > INDIRECT * 0.5


@pytest.mark.parametrize("rho", [0.2, 0.8])
def test_a_cube_of_another_albedo(rho: float) -> None:
    image = rendered(
        scene([box((1, 1, 1), inside=True, emission=GLOW)], view((-0.5, 0.3, -0.6), (1, 0, 0.2), 60, 16), (rho,) * 3),
        photons=PHOTONS,
        spp=16,
        light_samples=4,
    )
    # Direct light of a wall by samples of all walls: cos cos / d² has the mean pi / 24 and, away from edges, values
    # up to some 1 / 0.1; 16,384 samples leave about 1 %.
    np.testing.assert_allclose(image.layers["direct"].mean(), LE + rho * LE, rtol=0.02)
    np.testing.assert_allclose(image.layers["indirect"].mean(), LE * rho**2 / (1 - rho), rtol=TOLERANCE)
    np.testing.assert_allclose(image.pixels.mean(), LE / (1 - rho), rtol=0.02)


ROOM = box((1, 1, 1), inside=True, emission=GLOW)


def test_the_middle_of_a_wall() -> None:
    seen, _ = indirect([ROOM], (-0.5, 0, 0), (1, 0, 0), 60)  # 3 of 24 of the room's surface
    assert seen == pytest.approx(INDIRECT, rel=TOLERANCE)


@pytest.mark.parametrize(
    "places",
    [
        [(1, y, z) for y in (-1, 1) for z in (-0.5, 0, 0.5)],
        [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)],
    ],
    ids=["edges", "corners"],
)
def test_edges_and_corners_are_as_bright_as_walls(places: list[tuple[float, float, float]]) -> None:
    seen = []
    for place in places:
        value, radius = indirect([ROOM], (0, 0, 0), place, 3, k=200)
        assert radius > 2 * np.tan(np.radians(1.5)) * np.linalg.norm(place)  # all of the view is near the edge
        seen.append(value)
    # Each view tells from the 200 photons nearest to the edge on each of its two or three sides: 2,400 of six edges
    # and 4,800 of eight corners. Photons of one path land alike (a factor of sqrt(2)): 2.9 % and 2 %; four of those.
    # A disc in place of the measured area would make edges half as bright, and corners a quarter.
    sides = 3 if len(places) == 8 else 2
    assert np.mean(seen) == pytest.approx(INDIRECT, rel=4 * np.sqrt(2 / (200 * sides * len(places))))


def test_a_narrow_strip_is_as_bright_as_a_wall() -> None:
    """A bar 0.01 across: gathers on its faces reach far beyond them; a disc would make them several times too dark."""
    half = 0.005
    bar = box((half, half, 0.8), emission=GLOW)
    seen: list[float] = []
    for shift in np.linspace(-0.6, 0.6, 9):
        # Look at one face from close by; all pixels lie on it.
        eye: Array = np.array([0.4, 0.0, shift])
        value, radius = indirect([ROOM, bar], eye, (half, 0, shift), 1.2)
        assert radius > 2 * half
        seen.append(value)
    # Nine places share some 50 photons each: 1 / sqrt(450) = 5 % for the mean; a disc instead of the strip's area
    # would give at most 2 * half * 2 r / (pi r²) of it, with r the radius that a strip needs for 50 photons.
    assert np.mean(seen) == pytest.approx(INDIRECT, rel=0.15)


def test_a_box_in_the_room_changes_nothing() -> None:
    block = box((0.2, 0.3, 0.25), (0.1, -0.7, 0.2), emission=GLOW)
    seen, _ = indirect([ROOM, block], (-0.6, -0.2, -0.7), (0.1, -0.6, 0.2), 50)
    assert seen == pytest.approx(INDIRECT, rel=TOLERANCE)
