"""Walls without thickness on a floor that goes on beneath them: felt for, and no light is taken from behind them."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from furnaces import quad, scene, view
from numpy.typing import NDArray

from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.features import Features
from wdpm.kernels.irradiance import at_photons
from wdpm.kernels.photons import photon_map
from wdpm.kernels.photons.in_sight import _feeler_before, gather_in_sight
from wdpm.kernels.photons.walls import FEELERS, LEAST_SHARE, farthest_wall, make_feel_for_walls
from wdpm.kernels.rays import cell_triangles, two_level
from wdpm.kernels.rays.instances import upload_instances
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.scene import Mesh

Array = NDArray[np.float64]

UP = np.array([0.0, 0.0, 1.0])
RADIUS = 0.2
REACH = 0.08
K = 30
LEFT, RIGHT = 20_000, 1000  # photons of flux 1 on either half of the floor, whose area is 2


def felt(wall: Mesh, at: Array, radius: float = RADIUS) -> tuple[Array, Array]:
    """How much room there is about places of the floor, shape [N], and what rays meet, shape [N, FEELERS, 3]."""
    sides = [quad((-1, -1, z), (2, 0, 0), (0, 2, 0)) for z in (-1, 0, 1)]
    flat = flatten(scene([*sides, wall], view((0, 0, 0.5), (0, 1, 0.5), 60), (0.5, 0.5, 0.5)))
    assert np.abs(flat.triangles.positions).max() == 1.0, "the renderer's space is that of the scene"
    instances = upload_instances(flat.triangles.instances, "cpu")
    trees = two_level.build(flat.triangles, instances, flat.extent * PAD_SHARE, "cpu")
    surfaces = cell_triangles.upload(flat.triangles, flat.extent, "cpu", instances)
    places = [wp.array(each, dtype=wp.vec3) for each in (at, np.broadcast_to(UP, at.shape))]
    radii = wp.full(len(at), radius, dtype=wp.float32)
    room, walls = wp.empty(len(at), dtype=wp.float32), wp.empty(len(at) * FEELERS, dtype=wp.vec3)
    feel = make_feel_for_walls(Features())
    wp.launch(feel, len(at), inputs=[trees, surfaces, *places, radii, REACH, 0, room, walls], device="cpu")
    return room.numpy().astype(np.float64), walls.numpy().reshape(-1, FEELERS, 3).astype(np.float64)


def across(angle: float = 0.0) -> Mesh:
    """A sheet that stands on the floor, through its middle, along y if not turned."""
    along = np.array([-np.sin(angle), np.cos(angle), 0.0])
    return quad(-0.9 * along, 1.8 * along, (0, 0, 0.9))


@pytest.mark.parametrize("angle", np.radians([0.0, 11.0, 22.5, 40.0]))
def test_a_straight_wall_is_felt_however_it_stands(angle: float) -> None:
    distance = np.linspace(0.001, 0.99 * RADIUS, 50) * np.tile([1, -1], 25)
    at = distance[:, None] * np.array([np.cos(angle), np.sin(angle), 0.0])
    room, walls = felt(across(angle), at)
    assert (room <= np.abs(distance) * (1 + 1e-5)).all()
    assert (room >= LEAST_SHARE * np.abs(distance) * (1 - 1e-5)).all()
    met = np.abs(walls[:, :, :2]).sum(axis=2) > 0
    assert met.any(axis=1).all()
    off = walls[:, :, 2] / np.maximum(np.hypot(walls[:, :, 0], walls[:, :, 1]), 1e-9)
    assert off[met] == pytest.approx(np.broadcast_to(np.abs(distance)[:, None], off.shape)[met], rel=1e-3)


def test_there_is_room_where_no_wall_is_near_or_what_stands_is_low() -> None:
    at = np.array([[0.5, 0.0, 0.0], [-0.05, 0.0, 0.0]])
    step = quad((0, -0.9, 0), (0, 1.8, 0), (0, 0, 0.1 * RADIUS))
    assert felt(across(), at)[0][0] == np.float32(RADIUS)
    assert (felt(step, at)[0] == np.float32(RADIUS)).all()
    assert felt(across(), at[:1], 0.5 * REACH)[0][0] == np.float32(REACH), "what may be read is to be known of"


def test_nothing_that_rays_meet_is_farther_than_cells_hold_triangles_for() -> None:
    """A wall across a ray's end, and its top at the height of it."""
    far = farthest_wall(RADIUS)
    room, walls = felt(across(), np.array([[0.999 * RADIUS / LEAST_SHARE, 0.0, 0.0]]))
    assert np.hypot(0.999 * RADIUS / LEAST_SHARE, RADIUS / 8) < far
    assert np.abs(walls[0, :, :2]).sum() > 0
    assert room[0] < RADIUS / LEAST_SHARE


@wp.kernel
def tell_feelers(way: wp.array[wp.vec2], feeler_out: wp.array[wp.int32]) -> None:
    i = wp.tid()
    feeler_out[i] = _feeler_before(way[i][0], way[i][1])


def test_a_direction_lies_between_the_feelers_that_are_told() -> None:
    angle = np.concatenate([np.random.default_rng(0).uniform(0, 2 * np.pi, 1000), np.radians(np.arange(0, 360, 90))])
    way = np.column_stack([np.cos(angle), np.sin(angle)]).round(12)
    found = wp.empty(len(angle), dtype=wp.int32)
    wp.launch(tell_feelers, len(angle), inputs=[wp.array(way, dtype=wp.vec2), found], device="cpu")
    np.testing.assert_array_equal(found.numpy(), (angle / (2 * np.pi / FEELERS)).astype(np.int32))


def gathered(at: Array, seeds: int, end: float = 1.0) -> tuple[Array, NDArray[np.bool_]]:
    """Photons a unit of area that are told at places of a floor that a wall divides, shape [seeds, N].

    Of LEFT of them on the one half and RIGHT on the other, of area 2 each. And whether any of the floor is hidden, [N].

    Args:
        end: where the floor ends, along x.
    """
    step = 0.01
    middles = np.arange(-1 + step / 2, 1, step)
    points = np.stack([*np.meshgrid(middles, middles), np.zeros((200, 200))], axis=2).reshape(-1, 3)
    points = points[points[:, 0] < end]
    parts = {"position": points.astype(np.float32), "normal": np.broadcast_to(UP, points.shape).astype(np.float32)}
    surface = photon_map.build_points(photon_map.WholeParts(parts))
    room, walls = felt(across(), at)
    count, told = len(at), []
    own, normals = wp.array(at, dtype=wp.vec3), wp.array(np.broadcast_to(UP, at.shape), dtype=wp.vec3)
    sites, rank = (wp.array(np.arange(count) + first, dtype=wp.int32) for first in (0, LEFT + RIGHT))
    before = wp.full(count, RADIUS, dtype=wp.float32)
    places = [sites, rank, own, normals, normals, wp.array(room, dtype=wp.float32), before]
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        x = np.concatenate([rng.uniform(-1, 0, LEFT), rng.uniform(0, 1, RIGHT), at[:, 0]])
        y = np.concatenate([rng.uniform(-1, 1, LEFT + RIGHT), at[:, 1]])
        position = np.column_stack([x, y, np.zeros(len(x))])
        up = np.broadcast_to(UP, position.shape)
        flux = np.ones_like(position)
        flux[LEFT + RIGHT :] = 0.0  # the places are photons, too
        tree = photon_map.build(position, flux, up, up, np.arange(len(x)))
        search = [K, RADIUS, 2.5 * step, step**2, 1.0, REACH, np.pi, 0]
        outputs = [wp.empty(count, dtype=kind) for kind in (wp.vec3, wp.float32, wp.bool)]
        inputs = [wp.array(walls.reshape(-1, 3), dtype=wp.vec3), tree, surface, *places, *search]
        no_grazing = wp.empty(0, dtype=wp.float32)
        wp.launch(gather_in_sight, count, inputs=inputs, outputs=[*outputs, no_grazing], device="cpu")
        hidden = outputs[2].numpy()
        assert (outputs[1].numpy()[hidden] <= np.float32(RADIUS)).all()
        told.append(outputs[0].numpy()[:, 0].astype(np.float64))
    return np.array(told), hidden


@pytest.mark.parametrize(("side", "expected"), [(-1.0, LEFT / 2), (1.0, RIGHT / 2)])
def test_a_gather_beside_a_wall_tells_what_is_on_its_side(side: float, expected: float) -> None:
    """What is behind it is twenty times as bright, or as dark."""
    at = np.array([[side * (0.002 + 0.006 * i), -0.7 + 0.14 * i, 0.0] for i in range(11)])
    each, hidden = gathered(at, 64)
    told = each.mean(axis=1)
    assert hidden.all()
    error = told.std(ddof=1) / np.sqrt(len(told))
    assert error < 0.03 * expected
    assert told.mean() == pytest.approx(expected, abs=4 * error + 0.01 * expected)


def test_nothing_is_hidden_behind_the_last_wall_of_a_room() -> None:
    """There what was gathered without knowing of walls is kept, and read as far as ever."""
    at = np.array([[-0.01, 0.0, 0.0], [-0.05, 0.3, 0.0]])
    assert not gathered(at, 1, end=0.0)[1].any()


def test_what_may_lie_behind_a_wall_is_not_read() -> None:
    at = np.array([[-0.01, 0.0, 0.0], [-0.5, 0.0, 0.0]])
    room, _ = felt(across(), at)
    up = np.broadcast_to(UP, at.shape)
    points = at_photons.build(at, np.ones((2, 3)), np.zeros(2), up, np.full(2, RADIUS), room, np.arange(2))
    x = np.array([[0.01, 0.0, 0.0], [-0.015, 0.0, 0.0], [-0.45, 0.0, 0.0]])
    inputs = [points, *(wp.array(a, dtype=wp.vec3) for a in (x, np.broadcast_to(UP, x.shape))), REACH, 0]
    outputs = [wp.empty(3, dtype=kind) for kind in (wp.vec3, wp.float32, wp.float32, wp.bool)]
    wp.launch(at_photons.read_irradiance, 3, inputs=inputs, outputs=outputs, device="cpu")
    assert outputs[3].numpy().tolist() == [False, True, True]
