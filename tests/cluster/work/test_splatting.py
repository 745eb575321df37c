"""What pixels are where samples count in several of them: against sums over all samples, written down plainly."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from one_cell import FEW, ready

from wdpm.cluster.task import BucketTask
from wdpm.cluster.work.pixels import splatting as splatting_module
from wdpm.cluster.work.pixels.splatting import Splatting, tiles_of, window_of
from wdpm.cluster.work.pixels.waves import sample_groups
from wdpm.kernels import columns
from wdpm.kernels.camera import add_samples, splats
from wdpm.kernels.camera.pixel_filter import filter_values, reach_of
from wdpm.scenes import cornell_box
from wdpm.scenes.model.scene import FilterKind, PixelFilter

WIDTH, HEIGHT = 9, 7
TENT = PixelFilter(FilterKind.TENT, 1.0)
GAUSSIAN = PixelFilter(FilterKind.GAUSSIAN, 2.0, 0.5)
LANCZOS = PixelFilter(FilterKind.LANCZOS, 3.0)

Array = NDArray[np.float64]


def random_sums(count: int, rng: np.random.Generator) -> dict[str, NDArray[Any]]:
    """Of each sample by itself."""
    names = ("direct", "indirect", "caustic", "volume", "normal", "albedo")
    sums: dict[str, NDArray[Any]] = {name: rng.uniform(0, 1, (count, 3)) for name in names}
    return sums | {"depth": rng.uniform(1, 2, count), "hits": np.ones(count, np.int32)}


def weighted_mean(pixel_filter: PixelFilter, x: Array, y: Array, value: Array, times: Array) -> Array:
    """Of samples anywhere in the image, at every pixel, shape [HEIGHT, WIDTH, 3].

    Args:
        times: of each sample, how much it weighs besides.
    """
    image = np.zeros((HEIGHT, WIDTH, 3))
    for row in range(HEIGHT):
        for column in range(WIDTH):
            along_x = filter_values(pixel_filter, x - (column + 0.5))
            weight = along_x * filter_values(pixel_filter, y - (row + 0.5)) * times
            image[row, column] = (weight[:, None] * value).sum(axis=0) / weight.sum()
    return image


@pytest.mark.parametrize("pixel_filter", [TENT, GAUSSIAN, LANCZOS], ids=lambda each: each.kind.value)
@pytest.mark.parametrize("uneven", [False, True], ids=["even", "uneven"])
def test_pixels_are_means_of_all_samples_that_the_filter_reaches(
    pixel_filter: PixelFilter, uneven: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of pixels that take more samples each counts for less: the picture is not drawn towards them."""
    monkeypatch.setattr(splatting_module, "TILE_SAMPLES", 100)
    scene = cornell_box((WIDTH, HEIGHT))
    worker = ready(replace(scene, camera=replace(scene.camera, filter=pixel_filter)), FEW)
    view, replica = worker.replica.view, worker.replica
    assert view is not None
    window = window_of(BucketTask(0, 0, 0, WIDTH, HEIGHT), view.camera, reach_of(pixel_filter))
    counts = np.full(WIDTH * HEIGHT, 6, np.int32)
    if uneven:
        counts[::3] = 12
    assert np.array_equal(window.pixels(WIDTH), np.arange(WIDTH * HEIGHT))
    groups = tiles_of(sample_groups(np.zeros_like(counts), counts, alike=False))
    assert len(groups) > 3
    splatting, rng = Splatting(replica, view, window, groups), np.random.default_rng(1)
    at, values, share = [], [], []
    for number, group in enumerate(groups):
        rays = {
            "pixel": np.repeat(group.rows.astype(np.int32), group.count),
            "sample": np.tile(np.arange(group.count, dtype=np.int32), len(group.rows)),
        }
        sums = random_sums(len(rays["pixel"]), rng)
        splatting.add(number, rays, columns.upload(add_samples.Sums, sums, "cpu"))
        at.append(places_of(replica, rays) + np.stack(np.divmod(rays["pixel"], WIDTH)[::-1], axis=1) + 0.5)
        values.append(sums["direct"])
        share.append(1.0 / counts[rays["pixel"]])
    x, y = np.concatenate(at).T
    expected = weighted_mean(pixel_filter, x, y, np.concatenate(values), np.concatenate(share))
    found = splatting.pixels()
    np.testing.assert_allclose(found["direct"].reshape(HEIGHT, WIDTH, 3), expected, rtol=2e-4, atol=2e-4)
    assert np.array_equal(found["hits"], counts)


def places_of(replica: Any, rays: dict[str, NDArray[np.int32]]) -> Array:
    """Where samples lie, from the middles of their pixels: by what a tent of radius 1 weighs on both sides of it.

    That images are right where edges lie, tests/kernels/camera/test_pixel_filters.py tells.
    """
    ones = np.ones(len(rays["pixel"]), np.float32)
    splatted = columns.upload(splats.Splatted, {**rays, "caustic_for": ones, "volume_for": ones}, "cpu")
    tent, along = splats.FilterTable(), wp.empty(3 * len(ones), dtype=wp.vec2d, device="cpu")
    tent.values, tent.radius, tent.reach = wp.array([1.0, 0.0], dtype=wp.float32, device="cpu"), 1.0, 1
    replica.launcher(
        splats.rows_of_samples,
        len(ones),
        camera=replica.camera,
        sums=columns.zeros(add_samples.Sums, len(ones), "cpu"),
        splatted=splatted,
        table=tent,
        rows_out=wp.empty(splats.PARTS * len(ones), dtype=splats.row8, device="cpu"),
        weight_out=along,
    )
    weights = along.numpy().reshape(-1, 3, 2).astype(np.float64)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-6)
    found: Array = weights[:, 2] - weights[:, 0]
    assert 0.4 < np.abs(found).max() <= 0.5
    return found


def test_a_bucket_needs_the_pixels_about_it_as_far_as_there_are_any() -> None:
    camera = replace(cornell_box((WIDTH, HEIGHT)).camera, filter=GAUSSIAN)
    inside = window_of(BucketTask(0, 3, 2, 5, 4), camera, 2)
    assert (inside.x0, inside.y0, inside.x1, inside.y1) == (1, 0, 7, 6)
    corner = window_of(BucketTask(0, 6, 4, WIDTH, HEIGHT), camera, 2)
    assert (corner.x0, corner.y0, corner.x1, corner.y1) == (4, 2, WIDTH, HEIGHT)
    numbers = corner.pixels(WIDTH)
    assert np.array_equal(corner.of_bucket(numbers), [42, 43, 44, 51, 52, 53, 60, 61, 62])
    assert np.array_equal(window_of(BucketTask(0, 3, 2, 5, 4), camera, 0).pixels(WIDTH), [21, 22, 30, 31])
