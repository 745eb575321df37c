"""Russian roulette of photons."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from wdpm.kernels.photons.flight import Photon
from wdpm.kernels.photons.paths import Arrival, survival_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def survival_kernel(
    flux: wp.array[wp.vec3], scattered: wp.array[wp.vec3], scatters: wp.int32, survival_out: wp.array[wp.float32]
) -> None:
    p = Photon()
    p.flux = flux[0]
    a = Arrival()
    a.scattered = scattered[0]
    a.scatters = scatters
    survival_out[0] = survival_of(p, a)


@pytest.mark.parametrize(
    ("flux", "scattered", "scatters", "survival"),
    [
        ((4.0, 2.0, 1.0), (1.0, 2.0, 0.5), 1, 0.5),
        ((1.0, 1.0, 1.0), (2.0, 2.0, 2.0), 1, 1.0),
        ((4.0, 2.0, 1.0), (4.0, 2.0, 1.0), 0, 1.0),
        ((np.inf, 1.0, 1.0), (np.inf, 1.0, 1.0), 1, 0.0),
        ((1.0, 1.0, 1.0), (np.inf, 1.0, 1.0), 1, 0.0),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1, 0.0),
    ],
)
def test_a_photon_survives_by_what_is_scattered_of_it(
    flux: tuple[float, ...], scattered: tuple[float, ...], scatters: int, survival: float
) -> None:
    """Of light that single precision cannot hold, nothing goes on: it would be followed for 65,535 bounces."""
    arrays = [wp.array([vector], dtype=wp.vec3, device="cpu") for vector in (flux, scattered)]
    out = wp.empty(1, dtype=wp.float32, device="cpu")
    wp.launch(survival_kernel, 1, [*arrays, scatters, out], device="cpu")
    assert out.numpy()[0] == survival
