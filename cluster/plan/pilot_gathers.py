"""Gathers among the photons of the pilot: how densely they lie, and what irradiance they tell."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.work.cell import Cell
from wdpm.kernels.photons import photon_map
from wdpm.kernels.photons.gather import gather_kernel

PILOT_K = 16
"""Neighbours that tell the density at a place: few enough to stay local, enough to be within a quarter."""


def gather_among(
    cell: Cell,
    photons: Arrays,
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
    extent: float,
    k: int = PILOT_K,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Look for the k nearest of some photons about some places.

    Args:
        photons: on surfaces.
        position, normal: of the places, shape [P, 3].
        extent: how far to look at most.

    Returns:
        irradiance [W x paths / m²], mean of RGB, and the radius that it is the mean over, shape [P] each.
    """
    launcher = cell.replica.launcher
    device, count = launcher.device, len(position)
    at_normal = photons["normal"]  # every photon that fell on this side counts, from wherever it came
    built = photon_map.build(
        photons["position"],
        photons["flux"],
        at_normal,
        at_normal,
        np.arange(len(at_normal), dtype=np.int64),
        device=device,
    )
    facing = wp.array(normal, dtype=wp.vec3, device=device)
    irradiance = wp.empty(count, dtype=wp.vec3, device=device)
    radius = wp.empty(count, dtype=wp.float32, device=device)
    launcher(
        gather_kernel,
        count,
        photons=built,
        position=wp.array(position, dtype=wp.vec3, device=device),
        normal=facing,
        shading_normal=facing,
        k=k,
        r_max=extent,
        run=1,
        irradiance_out=irradiance,
        count_out=wp.empty(count, dtype=wp.int32, device=device),
        radius_out=radius,
        truncated_out=wp.empty(count, dtype=wp.bool, device=device),
    )
    return irradiance.numpy().mean(axis=1), radius.numpy()
