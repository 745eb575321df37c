"""Sampling of direct light: irradiance against formulas and Mitsuba 3, samples against their densities."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from light_rig import (
    KINDS,
    POINT,
    PROJECTOR,
    SPOT,
    SUN,
    Array,
    direct,
    irradiance,
    numbers,
    sky,
    square,
    table_of,
    without_power,
)

from wdpm.kernels.lights.tree import EVEN
from wdpm.scenes.flat.light_table import LightTable
from wdpm.scenes.model.lights import DirectionalLight, Environment, Light, PointLight, ProjectorLight, SpotLight
from wdpm.scenes.model.textures import Bitmap, Interpolation

COUNT = 1 << 15
ORIGIN = (0.0, 0.0, 0.0)
# Standard errors that an estimate may be off by: a probability below 1e-6; seeds are fixed.
ERRORS = 5.0


def square_irradiance(side: float, height: float) -> float:
    """Irradiance under the middle of a square of radiance 1 that faces a plane: a textbook form factor, times pi."""
    a = side / 2 / height
    return 4 * a / math.sqrt(1 + a * a) * math.atan(a / math.sqrt(1 + a * a))


def assert_estimates(found: tuple[Array, Array], expected: Sequence[float] | Array) -> None:
    mean, error = found
    assert np.all(np.abs(mean - expected) <= ERRORS * error + 1e-5 * np.abs(expected)), (mean, error, expected)


def test_a_square() -> None:
    table = table_of([square(2.0, 3.0, (1.0, 2.0, 4.0))])
    ways = direct(table, ORIGIN, COUNT)
    assert_estimates(irradiance(ways), square_irradiance(3.0, 2.0) * np.array([1, 2, 4]))
    np.testing.assert_allclose(ways.end[:, 2], 2.0, atol=1e-5)
    assert ways.end[:, 2].max() < 2.0  # certainly on its lit side
    assert not ways.delta.any()


def grid(side: int) -> Array:
    """The middles of side * side squares that fill the unit square, shape [side * side, 2]."""
    middles = (np.arange(side) + 0.5) / side
    return np.stack(np.meshgrid(middles, middles, indexing="ij"), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize(("first", "second"), [(0, 0), (1, 0), (2, 0), (0, 1), (0, 2), (2, 1)])
def test_a_grid_of_points_is_a_grid_on_a_square(first: int, second: int) -> None:
    """The two triangles of a lamp share the points out without a seam, wherever their corners begin."""
    glow = square(4.0, 3.0)
    corners = glow.corners.copy()
    for half, turn in ((0, first), (1, second)):
        corners[half] = np.roll(corners[half], turn, axis=0)
    ways = direct(table_of([replace(glow, corners=corners)]), ORIGIN, 64, points=grid(8))
    cell = np.floor((ways.end[:, :2] + 1.5) / 3.0 * 8).astype(np.int64)
    np.testing.assert_array_equal(np.bincount(cell[:, 0] * 8 + cell[:, 1], minlength=64), 1)


def test_stratified_points_are_stratified_over_several_lamps() -> None:
    """Of two lamps that are alike, each gets half of the points, and its half fills it evenly."""
    lamp = square(2.0, 1.0)
    lamps = [replace(lamp, corners=lamp.corners + np.float32([x, 0, 0])) for x in (-3.0, 3.0)]
    ways = direct(table_of(lamps), ORIGIN, 1024, points=grid(32))
    for light, x in enumerate((-3.0, 3.0)):
        cell = np.floor((ways.end[ways.light == light][:, :2] - [x - 0.5, -0.5]) * 8).astype(np.int64)
        np.testing.assert_array_equal(np.bincount(cell[:, 0] * 8 + cell[:, 1], minlength=64), 8)


@pytest.mark.parametrize("height", [2.0, 0.5, 0.01, 1e-4])
def test_what_a_lamp_close_by_sends_differs_by_the_cosine_alone(height: float) -> None:
    """Its points are even over the solid angle: no sample outshines the others, however close the place is."""
    ways = direct(table_of([square(height, 3.0, (1.0, 2.0, 4.0))]), ORIGIN, COUNT)
    assert_estimates(irradiance(ways), square_irradiance(3.0, height) * np.array([1, 2, 4]))
    a = 1.5
    whole = 4 * math.asin(a * a / (a * a + height * height))  # solid angle of a square above its middle
    np.testing.assert_allclose(1.0 / ways.pdf, whole, rtol=1e-5)


def edge_irradiance(beside: float, below: float) -> float:
    """Irradiance of a wall beside a lamp 2 x 2 that faces down at a right angle to it, its nearest edge in the middle.

    The integral along the edge in closed form, the one away from it by the midpoint rule, in steps of 0.02 %.
    """
    x = beside * np.geomspace(1.0, 1.0 + 2.0 / beside, 1 << 16)
    middle, step = (x[1:] + x[:-1]) / 2, np.diff(x)
    a = np.sqrt(middle**2 + below**2)
    along = 1 / (a**2 * (a**2 + 1)) + np.arctan(1 / a) / a**3
    return float((middle * below * along * step).sum())


@pytest.mark.parametrize("below", [1e-3, 0.03, 1.0])
@pytest.mark.parametrize("beside", [1e-3, 0.1])
def test_a_lamp_lights_the_wall_at_its_edge(beside: float, below: float) -> None:
    """However close the wall is: points by area would have samples 1 / distance² times as bright as others."""
    glow = square(0.0, 2.0)
    lamp = replace(glow, corners=glow.corners - np.float32([1.0, 0.0, 0.0]))
    ways = direct(table_of([lamp]), (beside, 0.0, -below), COUNT)
    lit = ways.pdf > 0
    assert lit.mean() > 0.99
    value = np.maximum(-ways.direction[lit, 0], 0.0) / ways.pdf[lit]
    assert value.max() <= 2 * math.pi
    error = value.std() / math.sqrt(len(value))
    expected = edge_irradiance(beside, below)
    assert error < 0.01 * expected
    assert abs(value.mean() - expected) < ERRORS * error + 2e-3 * expected


def test_a_square_is_dark_from_behind() -> None:
    ways = direct(table_of([square(2.0, 3.0, down=False)]), ORIGIN, 256)
    assert not ways.pdf.any()


def test_a_textured_square() -> None:
    """Left half of radiance (1, 0, 0), right half (0, 3, 0): each is half of the untextured one, by symmetry."""
    texture = Bitmap("halves", np.array([[[1, 0, 0], [0, 3, 0]]], np.float32), interpolation=Interpolation.NEAREST)
    table = table_of([square(2.0, 3.0, texture)], textures=[texture])
    np.testing.assert_allclose(table.power.sum(), math.pi * 9 * (1 + 3) / 3 / 2, rtol=1e-3)
    half = square_irradiance(3.0, 2.0) / 2
    assert_estimates(irradiance(direct(table, ORIGIN, COUNT, [texture])), [half, 3 * half, 0.0])


def test_a_point() -> None:
    ways = direct(table_of(others=[POINT]), ORIGIN, 16)
    np.testing.assert_allclose(irradiance(ways)[0], np.array([1, 2, 3]) * (2 / 3) / 9, rtol=1e-5)
    np.testing.assert_allclose(ways.end, np.broadcast_to([1, 2, 2], (16, 3)), rtol=1e-6)
    np.testing.assert_array_equal(ways.delta, 1)
    np.testing.assert_array_equal(ways.pdf, 1.0)


def test_a_directional() -> None:
    ways = direct(table_of(others=[SUN]), (1.0, 1.0, 0.0), 16)
    np.testing.assert_allclose(irradiance(ways)[0], np.array([1, 0.5, 0.25]) * 0.8, rtol=1e-6)
    np.testing.assert_allclose(ways.direction, np.broadcast_to([-0.6, 0, 0.8], (16, 3)), atol=1e-6)
    assert np.all(np.linalg.norm(ways.end, axis=1) > 2 * 10.0)  # outside of the scene


def test_a_spot_falls_off_as_documented() -> None:
    """Places around the axis: full within the beam, linear in the angle, nothing beyond the cutoff."""
    angles = np.array([0.0, 10.0, 19.9, 22.5, 27.5, 29.9, 30.1, 80.0])
    local = np.stack([np.sin(np.radians(angles)), np.zeros(8), np.cos(np.radians(angles)), np.full(8, 0.5)], axis=1)
    places = (local @ np.asarray(SPOT.to_world).T)[:, :3] * 2  # at distance 2
    ways = direct(table_of(others=[SPOT]), places, 8)
    expected = np.clip((30 - angles) / 10, 0, 1)[:, None] * np.array([4, 5, 6]) / 4
    np.testing.assert_allclose(ways.radiance, expected, rtol=1e-4, atol=1e-6)
    np.testing.assert_array_equal(ways.pdf > 0, angles < 30)


def test_a_squared_spot_falls_off_as_gltf_recommends() -> None:
    """KHR_lights_punctual, Inner and Outer Cone Angles."""
    angles = np.radians([0.0, 19.9, 21.0, 25.0, 29.0, 29.9, 30.1, 80.0])
    local = np.stack([np.sin(angles), np.zeros(8), np.cos(angles), np.full(8, 0.5)], axis=1)
    spot = replace(SPOT, squared=True)
    ways = direct(table_of(others=[spot]), (local @ np.asarray(SPOT.to_world).T)[:, :3] * 2, 8)
    outer, inner = np.cos(np.radians([30.0, 20.0]))
    expected = np.clip((np.cos(angles) - outer) / (inner - outer), 0, 1)[:, None] ** 2 * np.array([4, 5, 6]) / 4
    np.testing.assert_allclose(ways.radiance, expected, rtol=1e-3, atol=1e-6)


def test_a_constant_environment() -> None:
    pixels = np.full((1, 1, 3), [1.0, 2.0, 3.0], np.float32)
    table = table_of(others=[Environment("constant", pixels)])
    assert_estimates(irradiance(direct(table, ORIGIN, COUNT)), math.pi * np.array([1, 2, 3]))


def sphere_grid(rows: int, columns: int) -> tuple[Array, Array]:
    """Directions spread over the sphere, and the solid angle of each."""
    z = 1 - 2 * (np.arange(rows) + 0.5) / rows
    phi = 2 * np.pi * (np.arange(columns) + 0.5) / columns
    r = np.sqrt(1 - z**2)[:, None]
    grid = np.stack([r * np.cos(phi), r * np.sin(phi), np.broadcast_to(z[:, None], (rows, columns))], axis=2)
    return grid.reshape(-1, 3), np.full(rows * columns, 4 * np.pi / (rows * columns))


def map_value(environment: Environment, directions: Array) -> Array:
    """The documented lookup, in double: rows from pole to pole, columns at their middles, bilinear."""
    local = directions @ np.asarray(environment.to_world)[:3, :3]
    height, width = environment.pixels.shape[:2]
    x = np.arctan2(local[:, 0], -local[:, 2]) / (2 * np.pi) * width - 0.5
    y = np.arccos(np.clip(local[:, 1], -1, 1)) / np.pi * (height - 1)
    column, row = np.floor(x).astype(int), np.minimum(np.floor(y).astype(int), height - 2)
    fx, fy = (x - column)[:, None], (y - row)[:, None]
    at = environment.pixels.astype(np.float64)
    top = at[row, column % width] * (1 - fx) + at[row, (column + 1) % width] * fx
    bottom = at[row + 1, column % width] * (1 - fx) + at[row + 1, (column + 1) % width] * fx
    return np.asarray(top * (1 - fy) + bottom * fy)


def test_an_environment_map() -> None:
    environment = sky()
    table = table_of(others=[environment])
    ways = direct(table, ORIGIN, COUNT)
    directions, solid_angle = sphere_grid(1000, 2000)
    value = map_value(environment, directions)
    # A grid of two million: off by less than a thousandth.
    expected = (value * (np.maximum(directions[:, 2], 0) * solid_angle)[:, None]).sum(axis=0)
    mean, error = irradiance(ways)
    assert np.all(np.abs(mean - expected) < ERRORS * error + 1e-3 * expected)
    assert np.all(error < 0.01 * mean)  # importance sampling at work: uniform directions would leave a tenth
    np.testing.assert_allclose(ways.radiance, map_value(environment, ways.direction), rtol=2e-3, atol=1e-3)
    # Flux: pi R² times the integral.
    radius2 = table.scene_radius**2
    flux = math.pi * radius2 * (value.mean(axis=1) * solid_angle).sum()
    np.testing.assert_allclose(table.power.sum(), flux, rtol=1e-3)


def test_environment_samples_agree_with_their_density() -> None:
    """The value and the density of a sampled direction are what the functions of any direction say."""
    ways = direct(table_of(others=[sky()]), ORIGIN, COUNT)
    found = ways.pdf > 0
    assert found.mean() > 0.999
    np.testing.assert_allclose(np.linalg.norm(ways.direction[found], axis=1), 1.0, atol=1e-6)
    # A direction is known to 1e-7, a patch is 0.4 wide, and the brightest texel falls by a factor of 1000 across one.
    np.testing.assert_allclose(ways.environment[found], ways.radiance[found], rtol=1e-3, atol=2e-3)
    close = np.abs(ways.environment_pdf[found] / ways.pdf[found] - 1) < 1e-3
    assert close.mean() > 0.999


def test_environment_directions_have_the_density_that_is_claimed() -> None:
    """Chi-square over 32 x 64 cells of the sphere, the density integrated at 64 points a cell."""
    environment = sky(seed=3)
    table = table_of(others=[environment])
    count = 1 << 16
    ways = direct(table, ORIGIN, count)
    rows, columns, fine = 32, 64, 8
    directions, solid_angle = sphere_grid(rows * fine, columns * fine)
    pdf = direct_density(environment, directions) * solid_angle
    expected = pdf.reshape(rows, fine, columns, fine).sum(axis=(1, 3)).ravel() * count
    np.testing.assert_allclose(expected.sum(), count, rtol=2e-3)
    row = np.clip(((1 - ways.direction[:, 2]) / 2 * rows).astype(int), 0, rows - 1)
    column = np.clip(
        (np.arctan2(ways.direction[:, 1], ways.direction[:, 0]) % (2 * np.pi)) / (2 * np.pi) * columns, 0, columns - 1
    )
    counts = np.bincount(row * columns + column.astype(int), minlength=rows * columns)
    many = expected > 8
    chi2 = ((counts - expected)[many] ** 2 / expected[many]).sum()
    degrees = many.sum()
    assert degrees > 50
    assert (chi2 - degrees) / math.sqrt(2 * degrees) < ERRORS
    few = expected[~many].sum()
    assert abs(counts[~many].sum() - few) < ERRORS * math.sqrt(few)


def direct_density(environment: Environment, directions: Array) -> Array:
    """The density of a direction by its definition: mean radiance, times the row's sine over its own, normalised."""
    height, width = environment.pixels.shape[:2]
    node = environment.pixels.astype(np.float64).mean(axis=2)
    pair = node + np.roll(node, -1, axis=1)
    sine = np.sin((np.arange(height - 1) + 0.5) / (height - 1) * np.pi)
    total = ((pair[:-1] + pair[1:]) / 4 * sine[:, None]).sum()
    theta = np.arccos(np.clip(directions @ np.asarray(environment.to_world)[:3, 1], -1, 1))
    row = np.minimum((theta / np.pi * (height - 1)).astype(int), height - 2)
    mean = map_value(environment, directions).mean(axis=1)
    patch = (np.pi / (height - 1)) * (2 * np.pi / width)
    return np.asarray(mean * sine[row] / total / (patch * np.sin(theta)))


def test_triangle_samples_agree_with_their_density() -> None:
    """pdf_triangle of a sampled point is the pdf of the sample, from anywhere; 0 from behind."""
    table = table_of([square(2.0, 3.0), square(5.0, 1.0)], [POINT])  # both triangles of a square have the same density
    places = numbers(4096, 9, 3) * 5 - 2
    ways = direct(table, places, 4096)
    first = ways.light == 0
    assert first.sum() > 500
    found = first & (ways.pdf > 0)
    np.testing.assert_allclose(ways.triangle_pdf[found], ways.pdf[found], rtol=1e-3)
    behind = first & (places[:, 2] > 2.0)
    assert behind.any()
    np.testing.assert_array_equal(ways.triangle_pdf[behind], 0.0)


def test_all_lights_together() -> None:
    """The irradiance of several lights is the sum of each one's own."""
    others: list[Light] = [POINT, SPOT, SUN, sky()]
    table = table_of([square(4.0, 2.0, (3.0, 3.0, 3.0)), square(5.0, 1.0, (9.0, 0.0, 0.0))], others)
    elements = len(table.power)
    total = np.zeros(3)
    variance = np.zeros(3)
    for chosen in ([0, 1], [2, 3], [4], [5], [6], [7]):
        ways = direct(without_power(table, [e for e in range(elements) if e not in chosen]), ORIGIN, COUNT)
        mean, error = irradiance(ways)
        total += mean
        variance += error**2
    mean, error = irradiance(direct(table, ORIGIN, 4 * COUNT, seed=7))
    assert np.all(np.abs(mean - total) < ERRORS * np.sqrt(error**2 + variance))


def test_a_thousand_lights() -> None:
    rng = np.random.default_rng(5)
    places = rng.uniform([-3, -3, 1], [3, 3, 4], (1000, 3))
    lamps = [PointLight(f"lamp {i}", tuple(p), (1.0 + i % 7, 1.0, 0.0)) for i, p in enumerate(places)]
    table = table_of(others=lamps)
    distance = np.linalg.norm(places, axis=1)
    intensity = np.array([lamp.intensity for lamp in lamps])
    expected = (intensity * (places[:, 2] / distance**3)[:, None]).sum(axis=0)
    ways = direct(table, ORIGIN, 1 << 16)
    assert_estimates(irradiance(ways), expected)
    # A lamp is chosen by what it sends: its estimate is within reach of the mean, not a thousandth of it.
    assert np.all(irradiance(ways)[1][:2] < 0.01 * expected[:2])


@pytest.mark.parametrize("kind", KINDS)
def test_kernels_of_fewer_features_give_the_same_bits(kind: str) -> None:
    others, features = KINDS[kind]
    table = table_of([square(4.0, 2.0)], others)
    places = numbers(2048, 3, 3)
    one, other = direct(table, places, 2048, features=features), direct(table, places, 2048)
    for name in vars(one):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def table_power(power: list[float]) -> LightTable:
    """Points of given powers."""
    return table_of(others=[PointLight(f"{i}", (0, 0, 1), (p, p, p)) for i, p in enumerate(power)])


@pytest.mark.parametrize("power", [[1.0], [1.0, 2.0, 3.0], [0.0, 1.0, 0.0, 0.0, 3.0, 0.0], [1e-6, 1e6], [5.0, 0.0]])
def test_lights_in_one_place_are_chosen_in_proportion_to_power(power: list[float]) -> None:
    """But for the even share of all that shine."""
    shines = np.array(power) > 0
    share = (1.0 - float(EVEN)) * np.array(power) / np.sum(power) + float(EVEN) * shines / shines.sum()
    ways = direct(table_power(power), ORIGIN, 1 << 14)
    counts = np.bincount(ways.light.astype(int), minlength=len(power))
    assert not counts[share == 0].any()
    # Equidistant numbers: a share's interval holds its length over the step, rounded up or down.
    assert np.all(np.abs(counts - share * (1 << 14)) <= 1)
    np.testing.assert_allclose(ways.pdf, share[ways.light.astype(int)], rtol=5e-4)


def test_no_power_at_all_is_nothing() -> None:
    ways = direct(table_power([0.0, 0.0]), ORIGIN, 64)
    assert not ways.pdf.any()
    assert np.isfinite(ways.radiance).all()


def mitsuba_plugin(mi: object, light: Light) -> object:
    """A light as Mitsuba's plugin."""
    matrix = lambda m: mi.ScalarTransform4f(np.asarray(m))  # type: ignore[attr-defined]  # noqa: E731
    rgb = lambda value: {"type": "rgb", "value": list(value)}  # noqa: E731
    match light:
        case PointLight():
            plugin = {"type": "point", "position": list(light.position), "intensity": rgb(light.intensity)}
        case SpotLight():
            plugin = {"type": "spot", "to_world": matrix(light.to_world), "intensity": rgb(light.intensity)}
            plugin |= {"cutoff_angle": light.cutoff_angle, "beam_width": light.beam_width}
            if light.texture is not None:
                # Bottom row first: Mitsuba's images begin with v = 0, wdpm's with v = 1, and the loader turns to_uv.
                image = mi.Bitmap(light.texture.pixels)  # type: ignore[attr-defined]
                plugin["texture"] = {"type": "bitmap", "bitmap": image, "raw": True}
        case ProjectorLight():
            plugin = {"type": "projector", "to_world": matrix(light.to_world), "fov": light.fov}
            shown = np.full((5, 7, 3), light.intensity, np.float32) / np.pi
            if light.texture is not None:
                shown *= light.texture.pixels
            image = mi.Bitmap(shown)  # type: ignore[attr-defined]
            plugin["irradiance"] = {"type": "bitmap", "bitmap": image, "raw": True}
        case DirectionalLight():
            plugin = {"type": "directional", "direction": list(light.direction), "irradiance": rgb(light.irradiance)}
        case Environment():
            image = mi.Bitmap(light.pixels)  # type: ignore[attr-defined]
            plugin = {"type": "envmap", "bitmap": image, "to_world": matrix(light.to_world)}
    return mi.load_dict(plugin)  # type: ignore[attr-defined]


PATTERN = Bitmap("pattern", np.random.default_rng(8).uniform(0.2, 1, (5, 7, 3)).astype(np.float32))


@pytest.mark.parametrize(
    "light",
    [POINT, SPOT, PROJECTOR, SUN, sky(), replace(SPOT, texture=PATTERN), replace(PROJECTOR, texture=PATTERN)],
    ids=["point", "spot", "projector", "sun", "sky", "pattern", "picture"],
)
def test_mitsuba_has_the_same_light(light: Light) -> None:
    """Radiance (of a delta light, irradiance) at many places, or from many directions."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    plugin = mitsuba_plugin(mi, light)
    places = numbers(64, 4, 3) * [1, 1, 0.5]
    ways = direct(table_of(others=[light], textures=[PATTERN]), places, 64, [PATTERN])
    for i in range(64):
        if isinstance(light, Environment):
            seen = mi.SurfaceInteraction3f()
            seen.wi = mi.Vector3f(*(-ways.direction[i]))
            expected = np.array(plugin.eval(seen))
            np.testing.assert_allclose(ways.environment[i], expected, rtol=2e-3, atol=1e-3)
        else:
            at = mi.Interaction3f()
            at.p = mi.Point3f(*places[i])
            if isinstance(light, DirectionalLight):
                plugin.set_scene(mi.load_dict({"type": "scene", "s": {"type": "sphere", "radius": 10.0}}))
            sample, weight = plugin.sample_direction(at, mi.Point2f(0.5, 0.5))
            np.testing.assert_allclose(ways.radiance[i], np.array(weight), rtol=2e-4, atol=1e-5)
            np.testing.assert_allclose(ways.direction[i], np.array(sample.d), atol=1e-5)
