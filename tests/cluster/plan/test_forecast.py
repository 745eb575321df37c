"""What a render computes where: cells are cut so that each has its share, and few rays go from one to another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.cluster.plan.forecast.work import NO_WORK, Work
from wdpm.cluster.plan.top_tree import UNEVEN, build_top_tree, cells_of
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.kernels.launch import Launcher
from wdpm.progress import SilentProgress
from wdpm.rendering.in_process import render_in_process
from wdpm.rendering.prepare import Prepared, prepare
from wdpm.scenes import cornell_box

Places = NDArray[np.float32]

SETTINGS = RenderSettings(photons=2000, spp=2, integrator=Integrator.PHOTONS)


def triangles(places: Places) -> Places:
    """A small one at each place."""
    return places[:, None, :] + np.float32([[0, 0, 0], [1e-4, 0, 0], [0, 1e-4, 0]])


def work(places: Places, seconds: float = 1.0, start: Places | None = None, end: Places | None = None) -> Work:
    none = np.empty((0, 3), np.float32)
    rays = (none, none) if start is None or end is None else (start, end)
    return Work(places, np.full(len(places), seconds), *rays, ray_s=1.0, triangle_bytes=450.0, photon_bytes=100.0)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def test_work_below_planes_is_added_up() -> None:
    places = np.float32([[1, 0, 0], [3, 0, 0], [2, 9, 0]])
    known = Work(places, np.array([1.0, 10.0, 100.0]), places, places, 0.0)
    np.testing.assert_array_equal(known.before(0, np.float32([0, 1, 1.5, 2.5, 4])), [0, 0, 1, 101, 111])


def test_rays_are_counted_at_planes_and_cut_at_one() -> None:
    start, end = np.float32([[0, 0, 0], [4, 4, 0], [1, 0, 0]]), np.float32([[4, 0, 0], [2, 0, 0], [1, 0, 8]])
    known = work(start, 1.0, start, end)
    np.testing.assert_array_equal(known.crossing(0, np.float32([0.5, 1.5, 3, 5])), [1, 1, 2, 0])
    below, above = known.divided(0, np.float32(3))
    np.testing.assert_array_equal(below.start, [[0, 0, 0], [3, 2, 0], [1, 0, 0]])
    np.testing.assert_array_equal(below.end, [[3, 0, 0], [2, 0, 0], [1, 0, 8]])
    np.testing.assert_array_equal(above.start, [[3, 0, 0], [4, 4, 0]])
    np.testing.assert_array_equal(above.end, [[4, 0, 0], [3, 2, 0]])
    assert len(below.place) == 2
    assert len(above.place) == 1


@pytest.mark.parametrize("workers", [2, 3, 4, 7, 8])
def test_cells_have_equal_work_where_memory_allows(workers: int, rng: np.random.Generator) -> None:
    """Triangles lie evenly; there is a little more work where x is large."""
    held = rng.random((4000, 3)).astype(np.float32)
    busy = (rng.random((6000, 3)) ** np.float32([0.9, 1, 1])).astype(np.float32)
    levels = (workers - 1).bit_length()
    tree = build_top_tree(triangles(held), held[:100], 0.0, levels, workers, work(busy))
    done = np.bincount(cells_of(busy, tree), minlength=tree.cells)
    assert done.max() * workers / len(busy) < 1.25
    assert (done > 0).sum() == workers


def test_no_cell_holds_much_more_than_its_share_for_the_sake_of_work(rng: np.random.Generator) -> None:
    """All work is in a corner that holds next to nothing."""
    held = rng.random((20_000, 3)).astype(np.float32)
    busy = (0.05 * rng.random((4000, 3))).astype(np.float32)
    tree = build_top_tree(triangles(held), held, 0.0, 2, None, work(busy))
    counts = np.bincount(cells_of(held, tree), minlength=4)
    assert counts.max() / len(held) < 1.1 * UNEVEN / 4
    alone = build_top_tree(triangles(held), held, 0.0, 2)
    of_work = [np.bincount(cells_of(busy, each), minlength=4).max() for each in (tree, alone)]
    assert of_work[0] <= of_work[1]


def test_planes_lie_where_few_rays_go_through(rng: np.random.Generator) -> None:
    """Work is as even along x as along y, but rays go along x."""
    places = rng.random((3000, 3)).astype(np.float32)
    end = places.copy()
    end[:, 0] = rng.random(3000)
    tree = build_top_tree(triangles(places), places, 0.0, 1, None, work(places, 1.0, places, end))
    assert tree.axis[0] != 0
    turned = end[:, [1, 0, 2]], places[:, [1, 0, 2]]
    tree = build_top_tree(triangles(places), places, 0.0, 1, None, work(places, 1.0, *turned))
    assert tree.axis[0] != 1


def test_without_work_planes_are_those_of_what_is_held(rng: np.random.Generator) -> None:
    held = rng.random((1000, 3)).astype(np.float32)
    one, other = (build_top_tree(triangles(held), held, 0.1, 3, None, each) for each in (NO_WORK, work(held[:0])))
    np.testing.assert_array_equal(one.axis, other.axis)
    np.testing.assert_array_equal(one.split, other.split)


def prepared(cells: int, threads: int = 1) -> Prepared:
    return prepare(cornell_box((48, 32)), SETTINGS, cells, Launcher("cpu", threads), SilentProgress(), cells)


def test_pixels_see_the_cells_that_the_image_says() -> None:
    """All but some at edges."""
    session = prepared(4).session
    image = render_in_process(cornell_box((48, 32)), SETTINGS, workers=4, cells=4)
    assert session.sight.shape == (32, 48)
    assert (session.sight == image.layers["cell"]).mean() > 0.9
    assert set(np.unique(session.sight)) >= {0, 1, 2, 3}


def test_the_cells_of_a_scene_are_a_function_of_scene_and_settings() -> None:
    one, other = (prepared(8, threads).session for threads in (1, 3))
    np.testing.assert_array_equal(one.sight, other.sight)
    np.testing.assert_array_equal(one.world.top_tree.split, other.world.top_tree.split)


def test_nobody_looks_where_there_is_one_cell() -> None:
    assert prepared(1).session.sight.shape == (0, 0)


def test_what_is_seen_through_glass_lies_behind_it() -> None:
    """The glass ball of the box is seen through: pixels see as many places as there are."""
    scene = cornell_box((16, 16))
    seen = prepare(scene, replace(SETTINGS, seed=3), 2, Launcher("cpu", 1), SilentProgress(), 2).session.sight
    assert (seen >= 0).mean() > 0.9
