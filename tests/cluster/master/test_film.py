"""The master's film and the order of buckets."""

from __future__ import annotations

import numpy as np
from fake_worker import make_view, pixels_of
from hypothesis import given
from hypothesis import strategies as st

from wdpm.cluster.master.film import Film, spiral
from wdpm.cluster.task import BucketTask

sides = st.integers(1, 70)


@given(sides, sides, st.integers(1, 40))
def test_buckets_cover_the_image_once(width: int, height: int, bucket: int) -> None:
    seen = np.zeros((height, width), int)
    tasks = spiral(width, height, bucket)
    for task in tasks:
        assert task.x1 - task.x0 <= bucket
        assert task.y1 - task.y0 <= bucket
        seen[task.y0 : task.y1, task.x0 : task.x1] += 1
    assert (seen == 1).all()
    assert [task.number for task in tasks] == list(range(len(tasks)))


def test_the_first_bucket_is_in_the_middle() -> None:
    first = spiral(50, 50, 10)[0]
    assert (first.x0, first.y0, first.x1, first.y1) == (20, 20, 30, 30)


def test_a_film_tells_whether_it_has_the_same_bits() -> None:
    film = Film(8, 8)
    task = BucketTask(0, 2, 2, 6, 6)
    result = pixels_of(task, make_view(8, 8))
    result.layers["depth"][0, 0] = np.float32(0.0)
    film.put(task, result)
    assert film.holds(task, result)
    result.layers["depth"][0, 0] = np.float32(-0.0)
    assert not film.holds(task, result)
    result.layers["depth"][0, 0] = np.float32(0.0)
    result.layers["depth"][0, 1] = np.nextafter(result.layers["depth"][0, 1], np.float32(np.inf))
    assert not film.holds(task, result)
