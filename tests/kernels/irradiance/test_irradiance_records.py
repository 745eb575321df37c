"""Records of the irradiance cache against irradiance known in closed form, and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels import columns
from wdpm.kernels.irradiance.cache import interpolate
from wdpm.kernels.irradiance.record_tree import build
from wdpm.kernels.irradiance.records import NOT_SHOT, Bounds, MadeRecords, make_records, make_strata, record_directions
from wdpm.scenes.errors import WdpmError

Array = NDArray[np.float64]
Records = dict[str, NDArray[np.float32]]
UP = np.array([0.0, 0.0, 1.0])
INF = float("inf")


def vectors(values: Array) -> wp.array:
    return wp.array(np.ascontiguousarray(values, np.float32).reshape(-1, 3), dtype=wp.vec3, device="cpu")


def floats(values: Array) -> wp.array:
    return wp.array(np.ascontiguousarray(values, np.float32).reshape(-1), dtype=wp.float32, device="cpu")


def unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def shoot(strata: object, normal: Array, shading: Array, first: int = 0, seed: int = 1) -> tuple[Array, Array]:
    """Directions [N, M, 3] and distances [N, M] of N records with the numbers from `first`."""
    count, size = len(normal), strata.rows * strata.columns
    number = wp.array(np.arange(first, first + count), dtype=wp.int64, device="cpu")
    out = [wp.empty(count * size, dtype=t, device="cpu") for t in (wp.vec3, wp.float32)]
    stratum = np.tile(np.arange(size, dtype=np.int32), count)
    columns = (np.repeat(np.arange(count), size), stratum, np.zeros_like(stratum))
    rays = [wp.array(a, dtype=wp.int32, device="cpu") for a in columns]
    inputs = [strata, number, vectors(normal), vectors(shading), wp.uint32(seed), *rays, 0, *out]
    wp.launch(record_directions, count * size, inputs=inputs, device="cpu")
    return out[0].numpy().astype(np.float64).reshape(count, size, 3), out[1].numpy().reshape(count, size)


def make(
    strata: object,
    radiance: Array,
    distance: Array,
    shading: Array,
    reach: float = 1.0,
    clearance: float = 1.0,
    least: float = 1e-4,
    most: float = 1e4,
    chunk: int | None = None,
) -> Records:
    """Records of N * M rays, `chunk` at a time."""
    count = len(shading)
    bounds = Bounds()
    bounds.reach, bounds.clearance = reach, clearance
    bounds.least, bounds.most = (floats(np.full(count, value)) for value in (least, most))
    made = columns.empty(MadeRecords, count, "cpu")
    inputs = [strata, vectors(radiance), floats(distance), vectors(shading), bounds]
    for start in range(0, count, chunk or count):
        size = min(chunk or count, count - start)
        wp.launch(make_records, size, inputs=[*inputs, start, made], device="cpu")
    return columns.download(made, MadeRecords.vars)


def gray(radiance: Array) -> Array:
    return np.repeat(radiance[..., None], 3, axis=-1)


class Rectangle:
    """A rectangle of radiance 1 and nothing else."""

    def __init__(self, corner: list[float], edge1: list[float], edge2: list[float]) -> None:
        self.corner, self.edges = np.array(corner), np.array([edge1, edge2])
        a, b = self.edges
        self.corners = self.corner + np.array([0 * a, a, a + b, b])

    def irradiance(self, position: Array, normal: Array) -> Array:
        """Lambert's formula for polygons above the horizon, shape [N]."""
        to = unit(self.corners[None] - position[:, None])
        total = np.zeros(len(position))
        for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)):
            cross = np.cross(to[:, a], to[:, b])
            sine = np.linalg.norm(cross, axis=1)
            angle = np.arctan2(sine, np.sum(to[:, a] * to[:, b], axis=1))
            total += angle * np.sum(cross * normal, axis=1) / sine
        return np.abs(total) / 2

    def see(self, position: Array, directions: Array) -> tuple[Array, Array]:
        """Radiance and distance along rays [N, M]."""
        a, b = self.edges
        facing = np.cross(a, b)
        distance = ((self.corner - position) @ facing)[:, None] / (directions @ facing)
        at = position[:, None] + distance[..., None] * directions - self.corner
        u, v = at @ a / (a @ a), at @ b / (b @ b)
        hit = (distance > 0) & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
        return gray(hit.astype(np.float64)), np.where(hit, distance, INF)

    def records(self, strata: object, position: Array, normal: Array, first: int = 0, **options: float) -> Records:
        directions, _ = shoot(strata, normal, normal, first)
        return make(strata, *self.see(position, directions), normal, **options)


OVERHEAD = Rectangle([0.5, -0.7, 2.0], [1.0, 0.0, 0.0], [0.0, 1.5, 0.3])
WALL = Rectangle([0.4, -0.6, 0.05], [0.0, 1.5, 0.0], [0.2, 0.0, 0.8])
RECTANGLES = pytest.mark.parametrize("rectangle", [OVERHEAD, WALL], ids=["overhead", "wall"])


def test_rays_lie_in_their_strata() -> None:
    rows, columns, count = 5, 7, 40
    normal = unit(np.random.default_rng(0).normal(size=(count, 3)))
    directions, distance = shoot(make_strata(rows, columns), normal, normal)
    assert (distance == INF).all()
    np.testing.assert_allclose(np.linalg.norm(directions, axis=2), 1.0, atol=1e-6)
    sine2 = 1.0 - np.sum(directions * normal[:, None], axis=2) ** 2
    row = np.repeat(np.arange(rows), columns)
    assert (np.abs(sine2 * rows - row - 0.5) < 0.5 + 1e-4).all()
    up = np.tile(UP, (count, 1))
    directions, _ = shoot(make_strata(rows, columns), up, up)
    phi = np.arctan2(directions[..., 1], directions[..., 0]) % (2 * np.pi)
    column = np.tile(np.arange(columns), rows)
    assert (np.abs(phi * columns / (2 * np.pi) - column - 0.5) < 0.5 + 1e-4).all()


def test_rays_of_one_stratum_are_stratified_among_themselves() -> None:
    """In squares of a fourth: every aligned 16 of a (0, 2)-sequence have one each, however many went before."""
    rows, columns, row, column, count = 5, 7, 2, 3, 32
    turn = np.arange(count, dtype=np.int32)
    same = (np.zeros_like(turn), np.full_like(turn, row * columns + column), turn)
    number = wp.array([77], dtype=wp.int64, device="cpu")
    out = [wp.empty(count, dtype=t, device="cpu") for t in (wp.vec3, wp.float32)]
    rays = [wp.array(a, dtype=wp.int32, device="cpu") for a in same]
    up = vectors(UP)
    inputs = [make_strata(rows, columns), number, up, up, wp.uint32(3), *rays, 0, *out]
    wp.launch(record_directions, count, inputs=inputs, device="cpu")
    x, y, z = out[0].numpy().astype(np.float64).T
    along = (1.0 - z**2) * rows - row
    across = np.arctan2(y, x) % (2 * np.pi) * columns / (2 * np.pi) - column
    for some in (slice(0, 16), slice(16, 32)):
        squares = 4 * (4 * along[some]).astype(int) + (4 * across[some]).astype(int)
        assert sorted(squares) == list(range(16))


def test_rays_are_a_function_of_seed_and_number() -> None:
    up = np.tile(UP, (3, 1))
    strata = make_strata(4, 12)
    directions, _ = shoot(strata, up, up)
    np.testing.assert_array_equal(shoot(strata, up[1:], up[1:], first=1)[0], directions[1:])
    assert (shoot(strata, up, up, seed=2)[0] != directions).any()
    assert (shoot(strata, up, up, first=1 << 32)[0] != directions).any()
    assert (directions[0] != directions[1]).any()


def test_a_constant_sky_has_no_derivatives() -> None:
    strata = make_strata(6, 20)
    normal = unit(np.random.default_rng(1).normal(size=(10, 3)))
    size = strata.rows * strata.columns
    radiance = np.tile([1.0, 2.0, 0.5], (10, size, 1))
    records = make(strata, radiance, np.full((10, size), INF), normal, most=3.0)
    np.testing.assert_allclose(records["irradiance"], np.tile(np.pi * np.array([1, 2, 0.5]), (10, 1)), rtol=1e-6)
    np.testing.assert_allclose(records["rotation"], 0.0, atol=1e-6)
    assert (records["translation"] == 0.0).all()
    assert (records["radius"] == 3.0).all()
    assert (records["nearest"] == INF).all()


def test_linear_radiance_turns_as_it_should() -> None:
    """L = a + b · w: E = pi a + 2/3 pi b · n, and its derivative by n is 2/3 pi b less what lies along n."""
    strata = make_strata(32, 100)
    normal = unit(np.random.default_rng(2).normal(size=(20, 3)))
    directions, distance = shoot(strata, normal, normal)
    b = np.array([0.5, -0.3, 0.4])
    records = make(strata, gray(1.0 + directions @ b), distance, normal)
    np.testing.assert_allclose(records["irradiance"][:, 1], np.pi + 2 / 3 * np.pi * normal @ b, rtol=2e-3)
    across = b - (normal @ b)[:, None] * normal
    np.testing.assert_allclose(records["rotation"][:, 1], 2 / 3 * np.pi * across, atol=0.03)


@RECTANGLES
def test_irradiance_and_derivatives_of_a_rectangle(rectangle: Rectangle) -> None:
    """Means of 20 records against Lambert's formula and its finite differences.

    Edges of light are replaced by steps of strata, which errs by a share of the derivatives that falls with the number
    of strata: from 16 x 48 to 64 x 192 ones by half at least, to 1 to 5 %.
    """
    count, step = 20, 1e-4
    up = unit(np.array([0.1, -0.05, 1.0]))
    position, normal = np.zeros((count, 3)), np.tile(up, (count, 1))
    moves, still = step * np.eye(3), np.tile(up, (3, 1))
    coarse, fine = (rectangle.records(make_strata(rows, 3 * rows), position, normal) for rows in (16, 64))
    value = rectangle.irradiance(position[:1], normal[:1])[0]
    np.testing.assert_allclose(fine["irradiance"].mean(axis=0), value, rtol=5e-3)
    moved = rectangle.irradiance(moves, still) - rectangle.irradiance(-moves, still)
    turned = rectangle.irradiance(0 * moves, unit(still + moves)) - rectangle.irradiance(0 * moves, unit(still - moves))
    for name, difference in (("translation", moved), ("rotation", turned)):
        true = difference / (2 * step)
        true -= (true @ up) * up
        off = [np.linalg.norm(made[name].mean(axis=0)[0] - true) / np.linalg.norm(true) for made in (coarse, fine)]
        assert off[0] < 0.2, name
        assert off[1] < 0.05, name
        assert off[1] < max(0.5 * off[0], 0.01), name


@RECTANGLES
def test_derivatives_make_interpolation_better(rectangle: Rectangle) -> None:
    count, reach = 60, 0.2
    place = np.random.default_rng(8).uniform([-0.4, -0.5], [0.3, 0.5], (count, 2))
    position, normal = np.column_stack([place, np.zeros(count)]), np.tile(UP, (count, 1))
    made = rectangle.records(make_strata(64, 192), position, normal, least=reach, most=reach)
    made |= {"number": np.arange(count), "position": position, "normal": normal}
    at = np.column_stack([np.random.default_rng(4).uniform([-0.4, -0.5], [0.3, 0.5], (2000, 2)), np.zeros(2000)])
    up = np.tile(UP, (2000, 1))
    true = rectangle.irradiance(at, up)

    def error(records: Records) -> float:
        out = [wp.empty(2000, dtype=t, device="cpu") for t in (wp.vec3, wp.float32, wp.float32, wp.int32)]
        wp.launch(interpolate, 2000, inputs=[build(records), vectors(at), vectors(up), 0, *out], device="cpu")
        covered = out[2].numpy() > 0
        assert covered.mean() > 0.9
        return float(np.sqrt(np.mean((out[0].numpy()[covered, 0] / true[covered] - 1) ** 2)))

    plain = error(made | {"translation": np.zeros_like(made["translation"])})
    assert error(made) < 0.25 * plain


def test_what_lies_below_the_surface_is_not_shot_and_does_not_move() -> None:
    strata = make_strata(16, 48)
    normal, shading = UP[None], unit(np.array([[0.5, 0.2, 1.0]]))
    directions, distance = shoot(strata, normal, shading)
    below = directions[..., 2] <= 0
    assert below.any()
    np.testing.assert_array_equal(distance == float(NOT_SHOT), below)
    radiance = gray(np.where(below, 0.0, 1.0))
    records = make(strata, radiance, np.where(below, -1.0, 2.0), shading, reach=0.25)
    assert (records["translation"] == 0.0).all()
    assert records["radius"][0] == np.float32(0.5)
    # Half a sphere of which a tilted surface sees a part: pi (1 + cos) / 2.
    np.testing.assert_allclose(records["irradiance"][0], np.pi * (1 + shading[0, 2]) / 2, rtol=0.01)


def test_radius_follows_distance_gradient_and_bounds() -> None:
    strata = make_strata(8, 24)
    size = strata.rows * strata.columns
    rng = np.random.default_rng(5)
    distance = rng.uniform(1.0, 3.0, (1, size))
    distance[0, size - strata.columns - 1] = 0.75
    distance[0, -1] = 0.5  # in the outermost row
    up, one = UP[None], np.ones((1, size, 3))
    mean = 1.0 / np.mean(1.0 / distance)
    records = make(strata, one, distance, up, reach=0.25)
    np.testing.assert_allclose(records["radius"], 0.25 * mean, rtol=1e-6)
    np.testing.assert_allclose(records["nearest"], 0.75)
    np.testing.assert_allclose(make(strata, one, distance, up, reach=9.0)["radius"], 0.75)
    np.testing.assert_allclose(make(strata, one, distance, up, reach=9.0, clearance=0.5)["radius"], 0.375)
    assert make(strata, one, distance, up, reach=0.25, most=0.125)["radius"] == np.float32(0.125)
    assert make(strata, one, distance, up, reach=0.25, least=1.0)["radius"] == np.float32(1.0)


def test_derivative_of_a_half_lit_dome() -> None:
    """Light in y > 0 at the distance d: its edge, a half circle, gains 2 / d a step along y. At most pi / 2 / R."""
    strata = make_strata(8, 24)
    lit = gray((np.arange(8 * 24) % 24 < 12).astype(np.float64))[None]
    distance = np.full((1, 8 * 24), 0.5)
    records = make(strata, lit, distance, UP[None])
    np.testing.assert_allclose(records["translation"][0], np.tile([0.0, 4.0, 0.0], (3, 1)), atol=1e-5)
    np.testing.assert_allclose(records["radius"], np.pi / 2 / 4, rtol=1e-5)
    records = make(strata, lit, 1e-3 * distance, UP[None], least=0.5)
    np.testing.assert_allclose(records["translation"][0], np.tile([0.0, np.pi, 0.0], (3, 1)), atol=1e-5)


def test_touching_surfaces_give_finite_records() -> None:
    strata = make_strata(4, 12)
    rng = np.random.default_rng(6)
    radiance = rng.uniform(0, 1, (2, 48, 3)) * [[[1.0]], [[1e30]]]
    distance = np.where(rng.uniform(size=(2, 48)) < 0.5, 0.0, INF)
    records = make(strata, radiance, distance, np.tile(UP, (2, 1)), least=1e-3)
    assert (records["radius"] == np.float32(1e-3)).all()
    for name in ("irradiance", "rotation", "translation"):
        assert np.isfinite(records[name]).all(), name
    slope = np.linalg.norm(records["translation"].astype(np.float64), axis=2)
    assert (slope * 1e-3 <= records["irradiance"] * (1 + 1e-5)).all()


def test_a_record_does_not_depend_on_its_company_or_unit() -> None:
    strata = make_strata(6, 18)
    count, size = 9, 108
    rng = np.random.default_rng(7)
    radiance, distance = rng.uniform(0, 1, (count, size, 3)), rng.uniform(0.5, 2, (count, size))
    normal = unit(rng.normal(size=(count, 3)))
    records = make(strata, radiance, distance, normal)
    for name, value in make(strata, radiance, distance, normal, chunk=2).items():
        np.testing.assert_array_equal(value, records[name])
    scaled = make(strata, radiance, 4 * distance, normal, least=4e-4, most=4e4)
    for name, factor in {"irradiance": 1, "rotation": 1, "translation": 0.25, "radius": 4, "nearest": 4}.items():
        np.testing.assert_array_equal(scaled[name], records[name] * np.float32(factor))
    swapped = make(strata, radiance[..., ::-1], distance, normal)
    np.testing.assert_array_equal(swapped["irradiance"][:, ::-1], records["irradiance"])
    np.testing.assert_array_equal(swapped["rotation"][:, ::-1], records["rotation"])


@pytest.mark.parametrize(("rows", "columns"), [(0, 12), (4, 2)])
def test_too_few_strata_are_an_error(rows: int, columns: int) -> None:
    with pytest.raises(WdpmError, match="expected at least 1 row and 3 columns"):
        make_strata(rows, columns)


def test_records_know_how_much_their_light_grazes() -> None:
    """Of even light none more than that; of a ring of light as much as Schlick's weight there."""
    rows, columns = 40, 60
    strata, up = make_strata(rows, columns), UP[None]
    far = np.full((1, rows * columns), 10.0)
    even = make(strata, gray(np.ones((1, rows * columns))), far, up)
    assert even["grazing"][0] == pytest.approx(0.0, abs=1e-6)
    dark = make(strata, gray(np.zeros((1, rows * columns))), far, up)
    assert dark["grazing"][0] == 0.0
    for row in (0, 20, 35, 39):
        ring = np.zeros((1, rows, columns))
        ring[:, row] = 3.0
        cosine = np.sqrt(1.0 - (row + (np.arange(200) + 0.5) / 200) / rows)
        made = make(strata, gray(ring.reshape(1, -1)), far, up)
        expected = np.mean((1.0 - cosine) ** 5) - 1.0 / 21.0
        assert made["grazing"][0] == pytest.approx(expected, abs=1e-4)
