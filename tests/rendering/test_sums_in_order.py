"""Sums in a fixed order: of the parts of a sample, and of the samples of a pixel, down to the last bit of a double."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from one_cell import FEW, ready

from wdpm.cluster.batch import Batch, Kind
from wdpm.cluster.task import BucketTask
from wdpm.cluster.work.bucket_home import BucketHome
from wdpm.cluster.work.guards import Guards
from wdpm.kernels import columns
from wdpm.kernels.camera.add_samples import Parts, Slots, Sums, add_samples
from wdpm.scenes import cornell_box

LIGHT_SAMPLES = 2
SAMPLES = 64
PIXELS = 5


def awkward(rng: np.random.Generator, *shape: int) -> NDArray[np.float32]:
    """Numbers whose sum in double depends on the order in which they are added."""
    return (10.0 ** rng.uniform(-8, 8, shape)).astype(np.float32)


@pytest.mark.parametrize("pieces", [2, 3, 7])
def test_parts_are_added_in_the_order_of_their_places(pieces: int) -> None:
    """Whatever the batches that they come in, and in which order."""
    worker = ready(cornell_box((4, 4)), FEW)
    view = worker.replica.view
    assert view is not None
    rng = np.random.default_rng(pieces)
    slots = 4 * FEW.spp
    slot = np.repeat(np.arange(slots, dtype=np.int32), 40)
    place = np.tile(np.arange(100, 140, dtype=np.int32), slots)
    radiance = awkward(rng, len(slot), 3)
    sums = []
    for shuffled in (False, True):
        home = BucketHome(BucketTask(0, 0, 0, 2, 2), 0, worker.replica, view, Guards(worker.replica))
        (camera,) = home.begin()
        order = rng.permutation(len(slot)) if shuffled else np.arange(len(slot))
        left = camera.credit
        for number, rows in enumerate(np.array_split(order, pieces)):
            credit = left // 2 if number < pieces - 1 else left
            left -= credit
            arrays = {"slot": slot[rows], "place": place[rows], "radiance": radiance[rows]}
            assert list(home.receive(Batch.of_task(Kind.LIT, 0, 0, 0, credit, arrays))) == []
        sums.append(home.sums())
    for name in ("direct", "indirect", "caustic", "volume"):
        np.testing.assert_array_equal(sums[0][name], sums[1][name])
    assert sums[0]["direct"].any()


def _added(values: dict[str, NDArray[np.float32]], waves: int) -> dict[str, NDArray[np.float64]]:
    """The sums of all pixels after so many waves of as many samples each."""
    sums = columns.zeros(Sums, PIXELS, "cpu")
    count = SAMPLES // waves
    for wave in range(waves):
        chosen = {
            name: value.reshape(PIXELS, SAMPLES, -1)[:, wave * count : (wave + 1) * count].reshape(-1, *value.shape[1:])
            for name, value in values.items()
        }
        chosen["direct"] = chosen["direct"].reshape(-1, 3)
        slots = columns.upload(Slots, chosen, "cpu")
        parts = columns.upload(
            Parts,
            {
                "begin": np.zeros(PIXELS * count + 1, np.int32),
                "layer": np.zeros(0, np.int32),
                "radiance": np.zeros((0, 3), np.float32),
            },
            "cpu",
        )
        wp.launch(add_samples, PIXELS, inputs=[slots, parts, count, LIGHT_SAMPLES, 0, sums], device="cpu")
    names = ("direct", "indirect", "normal", "albedo", "depth")
    return columns.download(sums, names)


def test_sums_go_on_where_the_last_wave_ended() -> None:
    """A sample is added to all that came before it in its pixel, whichever wave it is in."""
    rng = np.random.default_rng(1)
    total = PIXELS * SAMPLES
    values = {name: awkward(rng, total, 3) for name in ("emission", "indirect", "normal", "albedo")}
    values["depth"] = awkward(rng, total)
    values["direct"] = awkward(rng, total, LIGHT_SAMPLES, 3)
    once = _added(values, 1)
    for waves in (2, 8, SAMPLES):
        again = _added(values, waves)
        for name, sums in once.items():
            np.testing.assert_array_equal(again[name], sums)


def test_images_of_several_samples_that_are_rendered_at_once_are_those_of_one_after_another() -> None:
    worker = ready(cornell_box((6, 4)), FEW)
    view, task = worker.replica.view, BucketTask(0, 1, 0, 6, 4)
    assert view is not None
    sets = [range(0, 2), range(2, 4), range(7, 10)]
    (together,) = worker.start(task, sets).results
    apart = [worker.start(task, [samples]).results[0] for samples in sets]
    for name, layer in together.layers.items():
        assert layer.shape[:2] == (3 * 4, 5)
        np.testing.assert_array_equal(layer, np.concatenate([each.layers[name] for each in apart]))
    assert not np.array_equal(apart[0].layers["beauty"], apart[1].layers["beauty"])
