"""Photons and queries as arrays, and the kernels' gathers of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from wdpm.kernels.photons import gather, photon_map
from wdpm.kernels.photons.gather_settings import check_settings

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


F32 = np.float32
Array = npt.NDArray[Any]


@dataclass
class Photons:
    position: Array
    flux: Array
    normal: Array
    direction: Array
    id: Array

    def __getitem__(self, which: Any) -> Photons:
        return Photons(*(column[which] for column in vars(self).values()))

    def build(self) -> Any:
        return photon_map.build(**vars(self))


@dataclass
class Queries:
    position: Array
    normal: Array
    shading: Array


@dataclass
class Results:
    irradiance: Array
    count: Array
    radius: Array
    truncated: Array

    def assert_same_bits(self, other: Results) -> None:
        np.testing.assert_array_equal(self.truncated, other.truncated)
        np.testing.assert_array_equal(self.count, other.count)
        np.testing.assert_array_equal(self.radius.view(np.uint32), other.radius.view(np.uint32))
        # Adding 0 makes -0 equal to 0, which is all that bits tell beyond values: no NaN is let through.
        assert np.isfinite(self.irradiance).all()
        np.testing.assert_array_equal((self.irradiance + 0).view(np.uint32), (other.irradiance + 0).view(np.uint32))


def gather_all(photons: Any, queries: Queries, k: int, r_max: float, run: int = 16, chunks: int = 1) -> Results:
    """Runs gather_kernel, in so many launches, the last first."""
    check_settings(k, r_max)
    count = len(queries.position)
    inputs = [wp.array(column, dtype=wp.vec3, device="cpu") for column in vars(queries).values()]
    outputs = [
        wp.zeros(count, dtype=wp.vec3, device="cpu"),
        wp.zeros(count, dtype=wp.int32, device="cpu"),
        wp.zeros(count, dtype=wp.float32, device="cpu"),
        wp.zeros(count, dtype=wp.bool, device="cpu"),
    ]
    threads = -(-count // run)
    step = max(-(-threads // chunks), 1)
    for offset in reversed(range(0, threads, step)):
        scalars = [k, r_max, 0.0, offset, run]
        dim = min(step, threads - offset)
        wp.launch(gather.gather_kernel, dim=dim, inputs=[photons, *inputs, *scalars, *outputs], device="cpu")
    return Results(*(out.numpy() for out in outputs))
