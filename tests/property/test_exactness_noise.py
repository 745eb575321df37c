"""Samples that go by the noise that a trial saw: the same bits on any cluster, and the mean of as many everywhere."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import wdpm
from wdpm.cluster import allotment
from wdpm.cluster.allotment import NO_ALLOTMENT
from wdpm.cluster.render_settings import Integrator, RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.rendering import prepare
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import cornell_box

pytestmark = pytest.mark.usefixtures("small_pilot", "always_shared_out")

SCENE = cornell_box((48, 40))
AUTO = RenderSettings(integrator=Integrator.AUTO, spp=4)


@pytest.fixture(scope="module")
def always_shared_out() -> Iterator[None]:
    """Samples of a small and smooth scene, too, go by noise."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(allotment, "UNSEEN_NOISE", 0.0)
        patch.setattr(allotment, "LEAST_WORTH", math.inf)
        yield


@pytest.fixture(scope="module")
def alone(request: pytest.FixtureRequest) -> Image:
    """Rendered in one cell."""
    for name in ("small_pilot", "always_shared_out"):
        request.getfixturevalue(name)
    image = render_in_process(SCENE, AUTO, workers=1)
    assert any("samples a pixel, by the noise" in line for line in image.metadata["report"]["chose"])
    return image


@pytest.mark.parametrize(
    ("workers", "cells", "settings"),
    [(2, 2, AUTO), (3, 4, replace(AUTO, bucket=5, routing=Routing.MERGE)), (1, 1, replace(AUTO, bucket=13))],
    ids=["forward", "merge, small buckets", "buckets across blocks"],
)
def test_any_cluster_gives_the_same_bits(workers: int, cells: int, settings: RenderSettings, alone: Image) -> None:
    image = render_in_process(SCENE, settings, workers=workers, cells=cells, shuffle=random.Random(cells))
    assert image.digest() == alone.digest()


def test_processes_and_sockets_give_the_same_bits() -> None:
    with wdpm.Cluster.local(slaves=2, threads=1) as cluster:
        together = cluster.render(SCENE, AUTO)
    assert together.digest() == wdpm.render(SCENE, AUTO).digest()


def test_the_mean_is_that_of_as_many_samples_everywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    def mean() -> tuple[float, float]:
        sums = [
            float(render_in_process(SCENE, replace(AUTO, seed=seed), workers=1).layers["beauty"].mean())
            for seed in range(6)
        ]
        return float(np.mean(sums)), float(np.std(sums, ddof=1) / np.sqrt(len(sums)))

    by_noise, error = mean()
    monkeypatch.setattr(prepare, "allotment_by_noise", lambda *_: NO_ALLOTMENT)
    even, other = mean()
    assert abs(by_noise - even) < 4.0 * np.hypot(error, other)
