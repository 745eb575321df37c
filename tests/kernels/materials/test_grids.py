"""Rays through grids: optical lengths and free paths against formulas and sums over small steps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import ArrayLike, NDArray

from wdpm.kernels.materials import grids
from wdpm.kernels.materials.grid_walks import lattice_ray, walk
from wdpm.kernels.materials.grids import Grids, color_at
from wdpm.scenes.flat.grids import tabulate_grids
from wdpm.scenes.model.textures import Wrap
from wdpm.scenes.model.transforms import rotation, scaling, translation
from wdpm.scenes.model.volumes import Volume

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Wide = NDArray[np.float64]
ENDLESS = np.inf
STEPS = 2500
UNIT = np.eye(4)
TURNED = translation((0.3, -0.2, 0.5)) @ rotation((1.0, 2.0, 0.5), 35.0) @ scaling((2.0, 1.0, 0.5))


@wp.kernel
def walk_kernel(
    table: Grids,
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    end: wp.array[wp.float64],
    wanted: wp.array[wp.float64],
    t_out: wp.array[wp.float64],
    passed_out: wp.array[wp.float64],
    arrived_out: wp.array[wp.int32],
):
    i = wp.tid()
    ray = lattice_ray(table, 0, origin[i], direction[i])
    w = walk(table, ray, wp.float64(0.0), end[i], wanted[i])
    t_out[i] = w.t
    passed_out[i] = w.passed
    arrived_out[i] = w.arrived


@wp.kernel
def color_kernel(table: Grids, position: wp.array[wp.vec3], color_out: wp.array[wp.vec3]):
    color_out[wp.tid()] = color_at(table, 0, position[wp.tid()])


def volume(values: ArrayLike, to_world: ArrayLike = UNIT, **chosen: Any) -> Volume:
    array = np.asarray(values, np.float32)
    return Volume("test", array if array.ndim == 4 else array[..., None], np.asarray(to_world), **chosen)


def walked(
    what: Volume, origin: ArrayLike, direction: ArrayLike, end: ArrayLike = ENDLESS, wanted: ArrayLike = ENDLESS
) -> tuple[Wide, Wide, NDArray[np.bool_]]:
    """Where walks end, what they passed, and whether that is what they were to pass."""
    origins = np.atleast_2d(np.asarray(origin, np.float32))
    count = len(origins)
    ways = np.atleast_2d(np.asarray(direction, np.float64))
    ways = np.broadcast_to(ways / np.linalg.norm(ways, axis=1)[:, None], (count, 3)).astype(np.float32)
    numbers = [wp.array(np.broadcast_to(np.asarray(x, np.float64), count), dtype=wp.float64) for x in (end, wanted)]
    inputs = [
        grids.upload(tabulate_grids([what]), "cpu"),
        wp.array(origins, dtype=wp.vec3, device="cpu"),
        wp.array(ways, dtype=wp.vec3, device="cpu"),
        *numbers,
    ]
    out = [wp.zeros(count, dtype=kind, device="cpu") for kind in (wp.float64, wp.float64, wp.int32)]
    wp.launch(walk_kernel, dim=count, inputs=inputs, outputs=out, device="cpu")
    t, passed, arrived = (each.numpy() for each in out)
    return t, passed, arrived == 1


def random_rays(seed: int, count: int = 160) -> tuple[Wide, Wide]:
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    direction[:20] = np.eye(3)[rng.integers(3, size=20)] * rng.choice([-1.0, 1.0], (20, 1))  # along the axes
    direction[20:30, 2] = 0.0
    return rng.uniform(-0.4, 1.4, (count, 3)), direction / np.linalg.norm(direction, axis=1)[:, None]


def by_small_steps(what: Volume, origin: Wide, direction: Wide, reach: float = 3.0, steps: int = STEPS) -> Wide:
    """Optical lengths by the midpoint rule and a look-up of its own."""
    origin, direction = (x.astype(np.float32).astype(np.float64) for x in (origin, direction))
    t = (np.arange(steps) + 0.5) / steps * reach
    at = origin[:, None] + t[None, :, None] * direction[:, None]
    inverse = np.linalg.inv(what.to_world)
    cube = at @ inverse[:3, :3].T + inverse[:3, 3]
    inside = ((cube >= 0) & (cube <= 1)).all(axis=2)
    values = looked_up(what, np.clip(cube, 0.0, 1.0))
    return np.asarray((values * inside).sum(axis=1) * reach / steps)


def looked_up(what: Volume, cube: Wide) -> Wide:
    """The first channel at points of the unit cube."""
    values = what.values[..., 0].astype(np.float64)
    sides = np.array(values.shape[::-1])
    if what.nearest:
        x, y, z = np.moveaxis(np.minimum((cube * sides).astype(int), sides - 1), -1, 0)
        return np.asarray(values[z, y, x])
    q = cube * (sides - 1) if what.at_corners else cube * sides - 0.5
    base = np.floor(q).astype(int)
    total = np.zeros(q.shape[:-1])
    for corner in np.ndindex(2, 2, 2):
        share = np.where(corner, q - base, 1 - (q - base)).prod(axis=-1)
        place = [wrapped(base[..., axis] + corner[axis], sides[axis], what.wrap) for axis in range(3)]
        total += share * values[place[2], place[1], place[0]]
    return total


def wrapped(index: NDArray[np.int64], side: int, wrap: Wrap) -> NDArray[np.int64]:
    if wrap is Wrap.CLAMP:
        return np.clip(index, 0, side - 1)
    if wrap is Wrap.REPEAT:
        return index % side
    return np.where(index < 0, -1 - index, np.where(index >= side, 2 * side - 1 - index, index))


def noise(seed: int, shape: tuple[int, int, int] = (20, 17, 33)) -> Wide:
    """Random values with an empty slab and a slab of one value in them."""
    values = np.random.default_rng(seed).random(shape)
    values[: shape[0] // 3] = 0.0
    values[-(shape[0] // 3) :] = 0.75
    return values


@pytest.mark.parametrize(
    "chosen",
    [{}, {"nearest": True}, {"at_corners": True}, {"wrap": Wrap.REPEAT}, {"wrap": Wrap.MIRROR}],
    ids=["trilinear", "nearest", "at corners", "repeat", "mirror"],
)
@pytest.mark.parametrize("to_world", [np.eye(4), TURNED], ids=["unit cube", "turned"])
def test_optical_lengths_are_sums_over_small_steps(chosen: dict[str, Any], to_world: Wide) -> None:
    what = volume(noise(1), to_world, **chosen)
    origin, direction = random_rays(2)
    _, passed, _ = walked(what, origin, direction)
    assert (passed > 0.1).sum() > 20
    # A step at a face of the box, or of a voxel of its own value, is cut up to half a step wrongly.
    np.testing.assert_allclose(passed, by_small_steps(what, origin, direction), atol=2.0 * 3.0 / STEPS)


def test_a_ramp_is_integrated_exactly() -> None:
    """Density x along a diagonal, with values at the corners: a straight line's integral, in any number of voxels."""
    for count in (2, 3, 8, 9, 40):
        x = np.linspace(0.0, 1.0, count)
        ramp = volume(np.broadcast_to(x, (3, 5, count)), at_corners=True)
        start, end = np.array([0.1, 0.2, 0.05]), np.array([0.9, 0.7, 0.95])
        length = float(np.linalg.norm(end - start))
        _, passed, _ = walked(ramp, start, end - start, end=length)
        np.testing.assert_allclose(passed, length * (0.1 + 0.9) / 2, rtol=3e-7)


def test_a_cubic_along_a_diagonal_is_integrated_exactly() -> None:
    """One cell of corners 0 but one: density x y z, which along the diagonal is a cubic, of integral 1 / 4."""
    values = np.zeros((2, 2, 2))
    values[1, 1, 1] = 1.0
    _, passed, _ = walked(volume(values, at_corners=True), (0, 0, 0), (1, 1, 1))
    np.testing.assert_allclose(passed, np.sqrt(3.0) / 4, rtol=1e-6)


@pytest.mark.parametrize("nearest", [False, True])
def test_walks_end_where_they_have_passed_what_they_were_to(nearest: bool) -> None:
    what = volume(noise(3), TURNED, nearest=nearest)
    origin, direction = random_rays(4)
    _, whole, _ = walked(what, origin, direction)
    crossing = whole > 0.0
    wanted = np.where(crossing, whole * np.random.default_rng(5).random(len(whole)), 1.0)
    t, _, arrived = walked(what, origin, direction, wanted=wanted)
    assert (arrived == crossing).all()
    _, again, _ = walked(what, origin, direction, end=t)
    np.testing.assert_allclose(again[crossing], wanted[crossing], rtol=1e-9)
    beyond = walked(what, origin, direction, wanted=whole * (1 + 1e-9) + 1e-12)[2]
    assert not beyond.any()


def test_values_over_twelve_orders_of_magnitude() -> None:
    rng = np.random.default_rng(6)
    what = volume(10.0 ** rng.uniform(-6, 6, (9, 9, 9)), nearest=True)
    origin, direction = random_rays(7)
    _, whole, _ = walked(what, origin, direction)
    np.testing.assert_allclose(whole, by_small_steps(what, origin, direction), atol=1e6 * 3.0 / STEPS * 3)
    crossing = whole > 0.0
    for share in (1e-6, 0.5, 1.0 - 1e-9):
        t, _, arrived = walked(what, origin, direction, wanted=np.where(crossing, whole * share, 1.0))
        assert (arrived == crossing).all()
        _, again, _ = walked(what, origin, direction, end=t)
        np.testing.assert_allclose(again[crossing], whole[crossing] * share, rtol=1e-6, atol=1e-8)


def test_nothing_is_passed_where_nothing_is() -> None:
    origin, direction = random_rays(8)
    _, passed, arrived = walked(volume(np.zeros((20, 3, 9))), origin, direction, wanted=1e-30)
    assert not passed.any()
    assert not arrived.any()
    beside = walked(volume(np.ones((4, 4, 4))), [(2.0, 0.5, 0.5)], [(0.0, 0.0, 1.0)])
    assert beside[1] == 0.0
    np.testing.assert_array_equal(walked(volume(np.ones((4, 4, 4))), (0.5, 0.5, 0.5), (1, 0, 0), end=0.0)[1], 0.0)


def test_thin_shells_are_not_missed() -> None:
    """One layer of voxels out of 200, whatever the angle."""
    values = np.zeros((200, 2, 2))
    values[77] = 1000.0
    origin = np.tile([(0.5, 0.5, -1.0)], (50, 1))
    direction = np.stack([np.linspace(0.0, 0.3, 50), np.zeros(50), np.ones(50)], axis=1)
    _, passed, _ = walked(volume(values, nearest=True), origin, direction)
    inside = np.abs(direction[:, 0] / direction[:, 2] * 1.39) <= 0.5
    expected = np.where(inside, 1000.0 / 200 * np.linalg.norm(direction, axis=1), 0.0)
    np.testing.assert_allclose(passed, expected, rtol=1e-5)


def test_one_voxel_and_flat_grids() -> None:
    for shape in ((1, 1, 1), (1, 4, 4), (4, 1, 1)):
        for chosen in ({}, {"nearest": True}):
            _, passed, _ = walked(volume(np.full(shape, 2.0), **chosen), (0.3, 0.4, -1), (0, 0, 1))
            np.testing.assert_allclose(passed, 2.0, rtol=1e-6)


def test_colours_are_those_of_the_nearest_place_of_the_box() -> None:
    values = np.random.default_rng(9).random((3, 4, 5, 3))
    what = volume(values, nearest=True)
    position = np.array([(0.5, 0.1, 0.9), (-3.0, 0.1, 0.9), (0.99, 7.0, 0.0)], np.float32)
    out = wp.zeros(3, dtype=wp.vec3, device="cpu")
    inputs = [grids.upload(tabulate_grids([what]), "cpu"), wp.array(position, dtype=wp.vec3, device="cpu")]
    wp.launch(color_kernel, dim=3, inputs=inputs, outputs=[out], device="cpu")
    expected = np.float32([values[2, 0, 2], values[2, 0, 0], values[0, 3, 4]])
    np.testing.assert_allclose(out.numpy(), expected, rtol=1e-6)


def colors_at(what: Volume, position: ArrayLike) -> Wide:
    """Shape [positions, 3]."""
    places = np.asarray(position, np.float32)
    out = wp.zeros(len(places), dtype=wp.vec3, device="cpu")
    inputs = [grids.upload(tabulate_grids([what]), "cpu"), wp.array(places, dtype=wp.vec3, device="cpu")]
    wp.launch(color_kernel, dim=len(places), inputs=inputs, outputs=[out], device="cpu")
    return np.asarray(out.numpy(), np.float64)


@pytest.mark.parametrize("nearest", [False, True])
@pytest.mark.parametrize("wrap", list(Wrap))
def test_colours_go_on_beyond_the_box_as_their_wrap_says(wrap: Wrap, nearest: bool) -> None:
    rng = np.random.default_rng(3)
    what = volume(rng.uniform(size=(3, 4, 5, 3)), wrap=wrap, nearest=nearest)
    beyond = rng.uniform(-2.4, 3.4, (400, 3)).round(3) + 1e-4  # on no face of the box, and of no voxel
    turns = np.floor(beyond)
    inside = {
        Wrap.CLAMP: np.clip(beyond, 0.0, 1.0),
        Wrap.REPEAT: beyond - turns,
        Wrap.MIRROR: np.where(turns % 2 == 0, beyond - turns, 1.0 - (beyond - turns)),
    }[wrap]
    np.testing.assert_allclose(colors_at(what, beyond), colors_at(what, inside), atol=1e-5)


def test_colours_beyond_all_bounds_are_some_of_the_grid() -> None:
    what = volume(np.random.default_rng(4).uniform(0.25, 0.5, (2, 2, 2, 3)), wrap=Wrap.REPEAT)
    found = colors_at(what, [[np.inf, 0.5, 0.5], [-np.inf, 0.1, 1e38], [3e38, -3e38, 0.2]])
    assert found.min() >= 0.25
    assert found.max() <= 0.5
