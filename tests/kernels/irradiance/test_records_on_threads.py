"""What is worked out of records between rounds has the same bits in any number of threads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.kernels.irradiance import record_agreement, record_clamp, record_smoothing
from wdpm.kernels.irradiance.record_agreement import agreeing
from wdpm.kernels.irradiance.record_clamp import clamped
from wdpm.kernels.irradiance.record_smoothing import smoothed
from wdpm.kernels.launch import Launcher

COUNT = 400


def records() -> dict[str, NDArray[Any]]:
    """So many within reach of each other that each chunk of a launch has a say in what those of others become."""
    rng = np.random.default_rng(3)
    return {
        "number": np.arange(COUNT, dtype=np.int64),
        "position": (rng.random((COUNT, 3)) * [1, 1, 0.01]).astype(np.float32),
        "normal": np.tile(np.float32([0, 0, 1]), (COUNT, 1)),
        "radius": rng.uniform(0.05, 0.3, COUNT).astype(np.float32),
        "irradiance": rng.uniform(0.5, 1.0, (COUNT, 3)).astype(np.float32),
        "rotation": rng.normal(0.0, 0.1, (COUNT, 3, 3)).astype(np.float32),
        "translation": rng.normal(0.0, 1.0, (COUNT, 3, 3)).astype(np.float32),
        "grazing": rng.uniform(0.0, 0.5, COUNT).astype(np.float32),
        "error": rng.uniform(0.01, 0.2, COUNT).astype(np.float32),
    }


@pytest.mark.parametrize("threads", [2, 7])
def test_threads_change_no_bit(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (record_agreement, record_clamp, record_smoothing):
        monkeypatch.setattr(module, "GRAIN", 16)
    made, launcher = records(), Launcher("cpu", threads)
    assert len(launcher.chunks(COUNT, 16)) > threads
    whole = {name: column for name, column in made.items() if name != "error"}
    alone = agreeing(whole, 0.1)
    assert (alone < made["radius"]).sum() > COUNT / 4
    np.testing.assert_array_equal(agreeing(whole, 0.1, launcher), alone)
    reach = clamped(made["position"], made["radius"])
    assert (reach < made["radius"]).any()
    np.testing.assert_array_equal(clamped(made["position"], made["radius"], launcher), reach)
    smooth = smoothed(made)
    assert (smooth["irradiance"] != made["irradiance"]).any()
    for name, column in smoothed(made, launcher).items():
        np.testing.assert_array_equal(column, smooth[name], err_msg=name)
    launcher.stop_threads()
