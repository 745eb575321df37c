"""A small share of the traversal fuzzers, and that they notice what they are for. `make fuzz` runs them at length."""

from __future__ import annotations

from dataclasses import replace

import fuzz_routing
import fuzz_traversal
import fuzz_watertight
import numpy as np
import pytest
from fuzz_referee import sure_meeting
from fuzz_shapes import KINDS, ball
from hypothesis import given, settings
from hypothesis import strategies as st

from wdpm.kernels.rays.triangle import NO_HIT

F32 = np.float32
seeds = st.integers(0, 2**32 - 1)
kinds = st.lists(st.sampled_from(sorted(KINDS)), min_size=1, max_size=3).map(tuple)


@settings(max_examples=150)
@given(seeds, kinds, st.booleans())
def test_nearest_and_any_hits(seed: int, kinds: tuple[str, ...], grown: bool) -> None:
    """Also in boxes that are not grown: there a hit that rounds out of its triangle's box depends on the tree."""
    case = fuzz_traversal.make_case(seed, kinds, rays=512)
    if not grown:
        case = replace(case, pad=0.0)
    assert fuzz_traversal.judge(case, fuzz_traversal.trace(case)) == []


def test_nearest_and_any_hits_from_far_away() -> None:
    """10,000 extents away, where the pad does not cover the slab arithmetic."""
    rng = np.random.default_rng(3)
    triangles = (ball(8) * [1.0, 0.7, 1.3]).astype(F32)
    origin = rng.normal(size=(1000, 3))
    origin = (20_000 * origin / np.linalg.norm(origin, axis=1, keepdims=True)).astype(F32)
    direction = triangles[rng.integers(0, len(triangles), len(origin))].mean(axis=1) - origin
    case = fuzz_traversal.Case(triangles, np.arange(len(triangles), dtype=np.int32), origin, direction, 2.0**-17)
    assert fuzz_traversal.judge(case, fuzz_traversal.trace(case)) == []


@settings(max_examples=15)
@given(seeds)
def test_closed_meshes_leak_nothing(seed: int) -> None:
    assert fuzz_watertight.run_case(seed)[1] == []


@settings(max_examples=30)
@given(seeds)
def test_no_cell_is_missed(seed: int) -> None:
    assert fuzz_routing.run_case(seed)[1] == []


@pytest.fixture(scope="module")
def sound() -> tuple[fuzz_traversal.Case, fuzz_traversal.Traced]:
    """A case without failures that has hits."""
    case = fuzz_traversal.make_case(1, ("anywhere",), rays=512)
    case = replace(case, pad=1e-5)
    traced = fuzz_traversal.trace(case)
    assert fuzz_traversal.judge(case, traced) == []
    assert (traced.found["prim"] >= 0).sum() > 100
    return case, traced


def test_a_missed_hit_is_noticed(sound: tuple[fuzz_traversal.Case, fuzz_traversal.Traced]) -> None:
    """By the tree's twin if the tree alone loses it, and by the independent oracle if both do."""
    case, traced = sound
    lost = traced.found.copy()
    rows = np.flatnonzero(np.isfinite(traced.sure))[:5]
    lost["t"][rows], lost["prim"][rows] = NO_HIT, -1
    alone = fuzz_traversal.judge(case, replace(traced, found=lost))
    assert sum("disagree" in failure.message for failure in alone) >= 5
    both = fuzz_traversal.judge(case, replace(traced, found=lost, plain=lost))
    assert sum(failure.message.startswith("missed") for failure in both) == 5


def test_an_invented_hit_is_noticed(sound: tuple[fuzz_traversal.Case, fuzz_traversal.Traced]) -> None:
    case, traced = sound
    moved = traced.found.copy()
    distance = np.where(moved["prim"] >= 0, moved["t"], 0) * np.linalg.norm(case.direction, axis=1)
    rows = np.argsort(distance)[-5:]
    moved["t"][rows] *= F32(0.9999)
    failures = fuzz_traversal.judge(case, replace(traced, found=moved, plain=moved))
    assert sum(failure.message.startswith("invented") for failure in failures) == 5


def test_a_wrong_shadow_is_noticed(sound: tuple[fuzz_traversal.Case, fuzz_traversal.Traced]) -> None:
    case, traced = sound
    blocked = traced.blocked.copy()
    blocked[3, 2] ^= True
    failures = fuzz_traversal.judge(case, replace(traced, blocked=blocked))
    assert [failure.message for failure in failures] == ["any_hit disagrees with closest_hit"]


def test_a_hole_is_noticed() -> None:
    """Without one of its triangles a ball leaks, and only there."""
    rng = np.random.default_rng(0)
    triangles = ball(4).astype(F32)
    origin = np.zeros((4096, 3), F32)
    direction = rng.normal(size=(4096, 3)).astype(F32)
    assert fuzz_watertight.leaks(triangles, origin, direction, 0.0) == []
    leaks = fuzz_watertight.leaks(triangles[1:], origin, direction, 0.0)
    assert 0 < len(leaks) < 4096 / 50
    assert all(sure_meeting(triangles[0], leak.data["origin"], leak.data["direction"]) for leak in leaks)


def test_a_cell_that_lacks_a_triangle_is_noticed() -> None:
    case = next(case for case in map(fuzz_routing.make_case, range(50)) if case.tree.cells == 16)
    walked = fuzz_routing.walk(case)
    assert fuzz_routing.judge(case, walked) == []
    prim = np.bincount(walked.whole["prim"][walked.whole["prim"] >= 0]).argmax()
    rows = [case.held[case.begin[cell] : case.begin[cell + 1]] for cell in range(16)]
    rows = [held[held != prim] for held in rows]
    lacking = replace(
        case,
        begin=np.cumsum([0, *map(len, rows)]).astype(np.int32),
        held=np.concatenate(rows).astype(np.int32),
    )
    messages = {failure.message for failure in fuzz_routing.judge(lacking, fuzz_routing.walk(lacking))}
    assert "the cells on the way and one cell disagree" in messages
    assert "the cell that owns the hit does not hold its triangle" in messages


def test_a_cell_left_out_is_noticed() -> None:
    case = next(case for case in map(fuzz_routing.make_case, range(50)) if case.tree.cells == 16)
    walked = fuzz_routing.walk(case)
    owner = np.bincount(walked.owner[walked.owner >= 0]).argmax()
    walked.visited &= ~(np.uint64(1) << np.uint64(owner))
    messages = {failure.message for failure in fuzz_routing.judge(case, walked)}
    assert messages == {
        "a cell is visited twice, or the way has no end",
        "the cell that owns the hit is not on the way",
    }


def test_the_referee_knows_a_simple_meeting() -> None:
    triangle = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], F32)
    origin, down = np.array([0.25, 0.25, 2], F32), np.array([0, 0, -4], F32)
    meeting = sure_meeting(triangle, origin, down)
    assert meeting is not None
    assert meeting.t == 0.5
    assert sure_meeting(triangle, origin, -down) is None  # behind
    assert sure_meeting(triangle, np.array([0.5, 0.5, 2], F32), down) is None  # on an edge: either answer is right
    assert sure_meeting(triangle, np.array([0.6, 0.6, 2], F32), down) is None  # beside
