"""The nearest point that carries irradiance: against brute force bit for bit, whatever else is in the tree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import warp as wp
from awkward_places import AXES, COUNTS, F32, KINDS, SEEDS, Array, dot, make_ids, make_positions, make_queries
from hypothesis import given, settings
from hypothesis import strategies as st

from wdpm.kernels.constants import FLATTENING, NORMAL_COS
from wdpm.kernels.irradiance import at_photons
from wdpm.scenes.errors import SettingsError, WdpmError

examples = settings(max_examples=60, deadline=None, derandomize=True)


FREE = 1e9
"""Room about points that no wall is near."""


@dataclass
class Points:
    position: Array
    value: Array
    grazing: Array
    normal: Array
    radius: Array
    id: Array

    def __getitem__(self, which: Any) -> Points:
        return Points(*(column[which] for column in vars(self).values()))

    def build(self) -> Any:
        return at_photons.build(**vars(self), room=np.full(len(self.id), FREE, F32))


@dataclass
class Answers:
    value: Array
    grazing: Array
    radius: Array
    found: Array

    def assert_same_bits(self, other: Answers) -> None:
        np.testing.assert_array_equal(self.found, other.found)
        np.testing.assert_array_equal(self.value.view(np.uint32), other.value.view(np.uint32))
        np.testing.assert_array_equal(self.grazing.view(np.uint32), other.grazing.view(np.uint32))
        np.testing.assert_array_equal(self.radius.view(np.uint32), other.radius.view(np.uint32))


def read(points: Any, x: Array, n: Array, reach: float, chunk: int = 1 << 30) -> Answers:
    """Runs read_irradiance, in launches of so many queries, the last first; outputs hold rubbish before."""
    count = len(x)
    inputs = [wp.array(column, dtype=wp.vec3, device="cpu") for column in (x, n)]
    value = wp.full(count, wp.vec3(7.0), dtype=wp.vec3, device="cpu")
    grazing, radius = (wp.full(count, 7.0, dtype=wp.float32, device="cpu") for _ in range(2))
    found = wp.full(count, True, dtype=wp.bool, device="cpu")
    outputs = [value, grazing, radius, found]
    for offset in reversed(range(0, count, chunk)):
        dim = min(chunk, count - offset)
        arguments = [points, *inputs, reach, offset, *outputs]
        wp.launch(at_photons.read_irradiance, dim=dim, inputs=arguments, device="cpu")
    return Answers(*(out.numpy() for out in outputs))


def brute_force(points: Points, x: Array, n: Array, reach: float) -> Answers:
    answers = Answers(np.zeros((len(x), 3), F32), *np.zeros((2, len(x)), F32), np.zeros(len(x), bool))
    for q in range(len(x)):
        d = points.position - x[q]
        height = dot(d, n[q])
        distance2 = dot(d, d) + F32(FLATTENING**2 - 1) * (height * height)
        passes = (dot(points.normal, n[q]) > F32(NORMAL_COS)) & (distance2 <= F32(reach) * F32(reach))
        rows = np.flatnonzero(passes)
        if len(rows):
            best = rows[np.lexsort((points.id[rows], distance2[rows]))[0]]
            answers.value[q], answers.radius[q] = points.value[best], points.radius[best]
            answers.grazing[q] = points.grazing[best]
            answers.found[q] = True
    return answers


def make_case(seed: int, kind: str, count: int, query_count: int = 40) -> tuple[Points, Array, Array]:
    rng = np.random.default_rng(seed)
    position = make_positions(rng, kind, count)
    normal = AXES[rng.choice([0, 1, 2, 2, 2, 5], count)] + F32(0.2) * rng.standard_normal((count, 3)).astype(F32)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    ids = make_ids(rng, count)
    # Each point has another value, so that the value tells which was found.
    value = np.stack([np.arange(count), ids % 1009, np.ones(count)], axis=1).astype(F32)
    grazing, radius = rng.random(count).astype(F32), 1 + rng.random(count).astype(F32)
    points = Points(position, value, grazing, normal, radius, ids)
    x = make_queries(rng, kind, position, query_count)
    return points, x, AXES[rng.choice([2, 2, 5, 1], query_count)]


REACHES = st.sampled_from([1e-12, 1e-4, 0.01, 0.125, 0.3, 1.0, 1e4, 1e15])


@examples
@given(SEEDS, KINDS, COUNTS, REACHES)
def test_equals_brute_force(seed: int, kind: str, count: int, reach: float) -> None:
    points, x, n = make_case(seed, kind, count)
    read(points.build(), x, n, reach).assert_same_bits(brute_force(points, x, n, reach))


@examples
@given(SEEDS, KINDS, COUNTS, REACHES, st.integers(1, 50))
def test_order_of_points_and_chunks_of_queries_do_not_matter(
    seed: int, kind: str, count: int, reach: float, chunk: int
) -> None:
    points, x, n = make_case(seed, kind, count)
    shuffled = points[np.random.default_rng(seed).permutation(count)]
    read(shuffled.build(), x, n, reach, chunk).assert_same_bits(read(points.build(), x, n, reach))


@examples
@given(SEEDS, KINDS, st.integers(1, 3000), st.sampled_from([0.02, 0.1, 0.5]), st.floats(0, 1))
def test_points_out_of_reach_do_not_matter(seed: int, kind: str, count: int, reach: float, share: float) -> None:
    """A cell has the points within reach of its queries, and any number of others."""
    points, x, n = make_case(seed, kind, count)
    middle = x[:, 0] < 0.5 + (4096 if kind == "far off" else 0)
    whole = read(points.build(), x, n, reach)
    for inside in (middle, ~middle):
        gap = np.linalg.norm(points.position[:, None].astype(float) - x[inside], axis=-1)
        near = gap.min(axis=1, initial=np.inf) <= reach * 1.0001
        part = points[near | (np.random.default_rng(seed).random(count) < share)]
        mine = Answers(*(column[inside] for column in vars(whole).values()))
        read(part.build(), x[inside], n[inside], reach).assert_same_bits(mine)


def read_one(position: list[list[float]], normal: list[list[float]], ids: list[int], reach: float) -> Answers:
    """What a query at the origin that looks up finds; values are 0, 1, 2 ... in the order given."""
    count = len(ids)
    value = np.arange(count, dtype=F32)[:, None] * np.ones((1, 3), F32)
    radius = np.full(count, 0.5, F32)
    places = np.array(position).reshape(-1, 3), value, radius, np.array(normal).reshape(-1, 3)
    tree = at_photons.build(*places, radius, np.full(count, FREE, F32), np.array(ids, np.int64))
    return read(tree, np.zeros((1, 3), F32), AXES[2:3], reach)


UP, DOWN, SIDE = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]


def test_nothing_is_found_in_an_empty_tree() -> None:
    answer = read_one([], [], [], 1e6)
    assert not answer.found[0]
    assert answer.radius[0] == 0
    assert not answer.value.any()


def test_reach_includes_its_end() -> None:
    """The distance² of the point and the square of the reach are both 0.0625, exactly."""
    assert read_one([[0.25, 0, 0]], [UP], [3], 0.25).found[0]
    assert not read_one([[0.25, 0, 0]], [UP], [3], float(np.nextafter(F32(0.25), F32(0)))).found[0]


def test_the_least_id_wins_in_one_place() -> None:
    same = [[0.25, 0.0, 0.0]] * 20
    ids = [100 - i for i in range(20)]
    assert read_one(same, [UP] * 20, ids, 1.0).value[0, 0] == 19


def test_the_other_side_of_a_wall_and_a_corner_are_not_read() -> None:
    answer = read_one([[0, 0, 0], [0, 0, 0], [0.5, 0, 0]], [DOWN, SIDE, UP], [0, 1, 2], 1.0)
    assert answer.value[0, 0] == 2


def test_a_floor_above_counts_as_further_away() -> None:
    above, beside = [0, 0, 0.1], [0.1 * FLATTENING * 0.9, 0, 0]
    assert read_one([above, beside], [UP, UP], [0, 1], 2.0).value[0, 0] == 1


def test_the_radius_of_the_estimate_is_kept() -> None:
    assert read_one([[0, 0, 0]], [UP], [7], 1.0).radius[0] == 0.5


@pytest.mark.parametrize("step", [1, 8, 2**20])
def test_a_share_is_picked_whatever_ids_have_in_common(step: int) -> None:
    """Within six standard deviations of a binomial count, in every eighth of the ids."""
    ids = np.arange(80_000, dtype=np.int64) * step
    for share in (0.05, 0.25, 0.5):
        picked = at_photons.chosen(ids, share).reshape(8, -1)
        spread = np.sqrt(picked.shape[1] * share * (1 - share))
        assert np.abs(picked.sum(axis=1) - picked.shape[1] * share).max() < 6 * spread


@examples
@given(st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1, unique=True), st.floats(1e-3, 1), st.floats(1e-3, 1))
def test_a_photon_is_picked_by_its_id_alone(ids: list[int], share: float, other: float) -> None:
    column = np.array(ids, np.int64)
    picked = at_photons.chosen(column, share)
    np.testing.assert_array_equal(picked[::-1], at_photons.chosen(column[::-1], share))
    np.testing.assert_array_equal(picked[:1], at_photons.chosen(column[:1], share))
    fewer, more = (at_photons.chosen(column, s) for s in sorted([share, other]))
    assert not (fewer & ~more).any()
    assert at_photons.chosen(column, 1.0).all()


@pytest.mark.parametrize("share", [0.0, -0.5, 1.5, float("nan")])
def test_a_share_out_of_range_is_an_error(share: float) -> None:
    with pytest.raises(SettingsError, match="share of photons"):
        at_photons.chosen(np.arange(3, dtype=np.int64), share)


def test_bad_points_are_errors() -> None:
    ones = np.ones((3, 3), F32)
    with pytest.raises(WdpmError, match="photon id 5 comes twice"):
        at_photons.build(ones, ones, np.ones(3), ones, np.ones(3), np.ones(3), np.array([5, 5, 6]))
    with pytest.raises(WdpmError, match=r"shape \(2, 3\), expected \(3, 3\)"):
        at_photons.build(ones, ones, np.ones(2), ones, np.ones(2), np.ones(2), np.array([4, 5, 6]))
    with pytest.raises(WdpmError, match=r"room of shape \(2,\) beside radii of shape \(3,\)"):
        at_photons.build(ones, ones, np.ones(3), ones, np.ones(3), np.ones(2), np.array([4, 5, 6]))
    with pytest.raises(WdpmError, match=r"grazing of shape \(2,\) beside radii of shape \(3,\)"):
        at_photons.build(ones, ones, np.ones(2), ones, np.ones(3), np.ones(3), np.array([4, 5, 6]))
