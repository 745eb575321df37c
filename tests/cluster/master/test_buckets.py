"""How an image is divided into buckets: all of it, large ones first, and again into those that are kept."""

from __future__ import annotations

import numpy as np
from fake_worker import make_view
from hypothesis import given
from hypothesis import strategies as st

from wdpm.cluster.master.buckets import LEAST, Rectangle, buckets, rectangle_of
from wdpm.cluster.task import BucketTask


def counted(tasks: list[BucketTask], width: int, height: int) -> np.ndarray:
    """How many buckets each pixel is in."""
    pixels = np.zeros((height, width), int)
    for task in tasks:
        assert 0 <= task.x0 < task.x1 <= width
        assert 0 <= task.y0 < task.y1 <= height
        pixels[task.y0 : task.y1, task.x0 : task.x1] += 1
    return pixels


def area(task: BucketTask) -> int:
    return (task.x1 - task.x0) * (task.y1 - task.y0)


@given(
    st.integers(1, 300),
    st.integers(1, 300),
    st.sampled_from([7, 32, 48, 64, 100, 128]),
    st.integers(0, 20),
    st.integers(1, 20),
    st.randoms(),
)
def test_every_pixel_is_in_one_bucket(
    width: int, height: int, side: int, at_once: int, before: int, shuffle: object
) -> None:
    """Also where buckets are kept of a render by others, who were more or fewer."""
    view = make_view(width, height, side)
    tasks = buckets(view, at_once, 5)
    assert (counted(tasks, width, height) == 1).all()
    assert [task.number for task in tasks] == list(range(5, 5 + len(tasks)))
    others = [rectangle_of(task) for task in buckets(view, before, 0)]
    kept: list[Rectangle] = [rectangle for rectangle in others if shuffle.random() < 0.5]  # type: ignore[attr-defined]
    again = buckets(view, at_once, 0, kept)
    assert (counted(again, width, height) == 1).all()
    assert set(kept) <= {rectangle_of(task) for task in again}


def test_the_last_ones_are_small() -> None:
    view = make_view(512, 512, 128)
    areas = [area(task) for task in buckets(view, 4, 0)]
    assert areas == sorted(areas, reverse=True)
    assert {areas[0], areas[-1]} == {128**2, LEAST**2}
    assert areas.count(128**2) >= 4
    assert areas.count(LEAST**2) >= 4


def test_who_renders_alone_has_nobody_to_wait_for() -> None:
    assert {area(task) for task in buckets(make_view(512, 512, 128), 1, 0)} == {128**2}


def test_small_buckets_are_not_divided() -> None:
    assert {area(task) for task in buckets(make_view(320, 320, LEAST), 16, 0)} == {LEAST**2}
    assert {area(task) for task in buckets(make_view(330, 330, 33), 16, 0)} == {33**2}


def test_kept_buckets_that_belong_to_no_division_are_left_out() -> None:
    strange = {(1, 1, 5, 5), (0, 0, 500, 500), (-3, 0, 61, 64)}
    tasks = buckets(make_view(128, 128, 64), 1, 0, strange)
    assert (counted(tasks, 128, 128) == 1).all()
    assert not strange & {rectangle_of(task) for task in tasks}
