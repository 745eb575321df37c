"""No blotches and no pearls: what differs from seed to seed of a room that one lamp lights by way of its ceiling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnaces import Array, rendered

from wdpm.cluster.master import records as master_records
from wdpm.cluster.plan import view
from wdpm.cluster.render_settings import Indirect
from wdpm.images.blotches import blotches
from wdpm.scenes import cornell_box
from wdpm.scenes.model.scene import Scene

SIDE = 64
SEEDS = 3
DROP = 100.0  # mm
CHOSEN = {"indirect": Indirect.CACHE, "photons": 100_000, "spp": 16}


def uplight() -> Scene:
    """The Cornell box with its lamp turned round, and hung below the ceiling that it lights."""
    what = cornell_box((SIDE, SIDE))
    lamps = [
        replace(mesh, vertices=mesh.vertices - np.array([0.0, DROP, 0.0]), faces=mesh.faces[:, ::-1])
        if mesh.emission is not None
        else mesh
        for mesh in what.meshes
    ]
    return replace(what, meshes=tuple(lamps))


def noise() -> Array:
    """Of indirect light, relative to the mean of all seeds where that is lit, shape [SEEDS, SIDE, SIDE]."""
    pictures = [rendered(uplight(), seed=seed, **CHOSEN) for seed in range(SEEDS)]
    light = np.stack([picture.layers["indirect"].mean(axis=2, dtype=np.float64) for picture in pictures])
    mean = light.mean(axis=0)
    relative = np.where(mean > 0.1 * mean.mean(), light / np.maximum(mean, 1e-9) - 1.0, 0.0)
    return np.asarray(relative * np.sqrt(SEEDS / (SEEDS - 1)))


def wide(relative: Array) -> float:
    """Root mean square of what is wider than blotches.WIDTH pixels."""
    found = [blotches(np.repeat(each[:, :, None], 3, axis=2)) for each in relative]
    return float(np.sqrt(np.mean([each.error**2 for each in found if each is not None])))


def pearls(relative: Array) -> float:
    """Noise of the noisiest pixels but a hundredth."""
    return float(np.quantile(np.abs(relative), 0.99))


@pytest.fixture(scope="module")
def by_default() -> Array:
    return noise()


def test_there_are_no_blotches(by_default: Array, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a few dozen rays a record there are, and the measure sees them."""
    assert wide(by_default) < 0.02
    few = replace(view.CACHE_PLAN, rows=3, columns=10, extra=0.0)
    monkeypatch.setattr(view, "CACHE_PLAN", few)
    assert wide(noise()) > 0.05


def test_there_are_no_pearls(by_default: Array, monkeypatch: pytest.MonkeyPatch) -> None:
    """There are where records are read no further than they were placed by: what none reaches gathers by itself."""
    assert pearls(by_default) < 0.25
    monkeypatch.setattr(master_records, "READ_FURTHER", 1.0)
    assert pearls(noise()) > 0.3
