"""The error of path tracing falls as its samples grow in number, over three decades, and to nothing."""

from __future__ import annotations

import numpy as np
from furnaces import Array, rendered

from wdpm.cluster.render_settings import Integrator
from wdpm.scenes import cornell_box

SAMPLES = (1, 4, 16, 64, 256, 1024)
SEEDS = 4
REFERENCE_SAMPLES = 1 << 15


def pixels(spp: int, seed: int) -> Array:
    image = rendered(cornell_box((6, 6)), integrator=Integrator.PATH, spp=spp, seed=seed, all_effects=True)
    return image.pixels.astype(np.float64)


def test_error_falls_with_the_root_of_the_number_of_samples() -> None:
    """A slope of -1/2 on log-log paper, or steeper: samples are stratified in each dimension. Measured: -0.86."""
    reference = pixels(REFERENCE_SAMPLES, 1000)
    errors = [np.sqrt(np.mean([(pixels(spp, seed) - reference) ** 2 for seed in range(SEEDS)])) for spp in SAMPLES]
    slope = np.polyfit(np.log(SAMPLES), np.log(errors), 1)[0]
    assert -1.0 < slope < -0.48, (slope, errors)
    # A bias would end the fall: sixteen times as many samples must leave a quarter, all the way.
    for i in range(len(SAMPLES) - 2):
        assert errors[i + 2] < 1.3 * errors[i] / 4, errors
