"""Samples of pixels that come home as sums: they are the pixels' as they are, and nothing else may come so."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from one_cell import FEW, ready

from wdpm.cluster.batch import Batch, Kind, zeros
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.task import BucketTask
from wdpm.cluster.work import bucket_home
from wdpm.cluster.work.bucket_home import BucketHome
from wdpm.cluster.work.guards import Guards
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.model.scene import FilterKind, PixelFilter

PIXELS = 4
SIGNED = PixelFilter(FilterKind.LANCZOS, 4.0)
SPLATTED = PixelFilter(FilterKind.TENT, 1.0)


def begun(settings: RenderSettings = FEW, pixel_filter: PixelFilter | None = None) -> tuple[BucketHome, Batch]:
    """A bucket of four pixels, and its camera rays."""
    scene = cornell_box((2, 2))
    if pixel_filter is not None:
        scene = replace(scene, camera=replace(scene.camera, filter=pixel_filter))
    worker = ready(scene, settings)
    assert worker.replica.view is not None
    home = BucketHome(BucketTask(0, 0, 0, 2, 2), 0, worker.replica, worker.replica.view, Guards(worker.replica))
    (rays,) = home.begin()
    return home, rays


def sums_of(slots: list[int], seed: int = 0) -> dict[str, NDArray[Any]]:
    """Kind.PIXELS."""
    arrays, rng = zeros(Kind.PIXELS, len(slots)), np.random.default_rng(seed)
    for column in arrays.values():
        column[...] = rng.uniform(1.0, 3.0, column.shape) if column.dtype.kind == "f" else 1
    return {**arrays, "slot": np.array(slots, np.int32)}


def receive(home: BucketHome, kind: Kind, arrays: dict[str, NDArray[Any]], credit: int) -> None:
    assert list(home.receive(Batch.of_task(kind, 0, 0, 0, credit, arrays))) == []


def test_all_samples_of_a_pixel_may_come_together() -> None:
    _, rays = begun()
    assert rays.arrays["together"].reshape(PIXELS, FEW.spp)[:, 0].tolist() == [FEW.spp] * PIXELS
    assert not rays.arrays["together"].reshape(PIXELS, FEW.spp)[:, 1:].any()


def test_samples_of_later_waves_come_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """To sums that there are already each is added by itself."""
    monkeypatch.setattr(bucket_home, "WAVE_SAMPLES", 2 * PIXELS)
    home, rays = begun(replace(FEW, spp=6))
    assert rays.arrays["together"].reshape(PIXELS, 2)[:, 0].tolist() == [2] * PIXELS
    (later,) = home.receive(Batch.of_task(Kind.ENDED, 0, 0, 0, rays.credit, {}))
    assert not later.arrays["together"].any()


@pytest.mark.parametrize("pixel_filter", [SIGNED, SPLATTED])
def test_samples_that_weigh_differently_come_alone(pixel_filter: PixelFilter) -> None:
    _, rays = begun(pixel_filter=pixel_filter)
    assert not rays.arrays["together"].any()


def test_some_pixels_come_as_sums_and_others_sample_by_sample() -> None:
    home, rays = begun()
    summed = sums_of([2 * FEW.spp, 0])
    receive(home, Kind.PIXELS, summed, 1)
    samples = zeros(Kind.SAMPLES, 2)
    samples["slot"][:] = FEW.spp, FEW.spp + 1
    samples["emission"][:] = [[1.0, 2.0, 3.0], [0.5, 0.25, 0.125]]
    receive(home, Kind.SAMPLES, samples, rays.credit - 1)
    sums = home.sums()
    for name in ("direct", "indirect", "caustic", "normal", "albedo", "depth", "hits"):
        assert np.array_equal(sums[name][[2, 0]], summed[name])
        assert not np.any(sums[name][3])
    assert sums["direct"][1].tolist() == [1.5, 2.25, 3.125]
    result = home.result()
    assert result is not None
    assert result.layers["cell"].reshape(-1).tolist() == [1, 0, 1, -1]


@pytest.mark.parametrize("slot", [1, PIXELS * FEW.spp, -1])
def test_sums_of_other_samples_are_refused(slot: int) -> None:
    home, rays = begun()
    with pytest.raises(ProtocolError, match=r"slot|other samples"):
        receive(home, Kind.PIXELS, sums_of([slot]), rays.credit)


@pytest.mark.parametrize("pixel_filter", [SIGNED, SPLATTED])
def test_sums_of_samples_that_are_to_come_alone_are_refused(pixel_filter: PixelFilter) -> None:
    home, rays = begun(pixel_filter=pixel_filter)
    with pytest.raises(ProtocolError, match="other samples"):
        receive(home, Kind.PIXELS, sums_of([0]), rays.credit)
