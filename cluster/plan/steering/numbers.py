"""The numbers that photon paths set out by, worked out once more: no photon tells them."""

from __future__ import annotations

from typing import Any

import warp as wp

from wdpm.cluster.plan.photon_pilot import PhotonPilot
from wdpm.cluster.plan.steering.tree import Array
from wdpm.cluster.world import START_NUMBERS, Steering
from wdpm.kernels.lights import steering
from wdpm.kernels.photons.emit_photons import numbers_of_paths


def start_numbers(pilot: PhotonPilot, tree: Steering, seed: int, purpose: Any, count: int) -> Array:
    """Those of the first paths of a pass, shape [count, START_NUMBERS].

    Args:
        tree: by which they are steered.
        purpose: of the pass's random numbers (kernels.maths.random).
    """
    launcher = pilot.cell.replica.launcher
    numbers = wp.empty((count, START_NUMBERS), dtype=wp.float64, device=launcher.device)
    launcher(
        numbers_of_paths,
        count,
        steering=steering.upload(**vars(tree), device=launcher.device),
        seed=wp.uint32(seed),
        purpose=purpose,
        numbers_out=numbers,
    )
    of_paths: Array = numbers.numpy()
    return of_paths
