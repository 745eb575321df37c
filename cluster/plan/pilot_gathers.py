"""Gathers among the photons of the pilot: how densely they lie, and what irradiance they tell."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.work.cell import Cell
from wdpm.cluster.work.overlap_band import along
from wdpm.kernels.photons import photon_map
from wdpm.kernels.photons.gather import gather_kernel
from wdpm.kernels.photons.neighbours import find_neighbours

PILOT_K = 16
"""Neighbours that tell the density at a place: few enough to stay local, enough to be within a quarter."""

RUN = 32
"""Gathers that follow one another, each from the radius of the one before."""

GRAIN = 4
"""Runs that are worth a chunk of their own: a millisecond and more."""

LEAST_WIDTH = 1e-30
"""Of slabs that places are sorted by, which may all coincide."""


class AmongPhotons:
    """Some photons, about any place of which the nearest can be looked for.

    Args:
        cell: the whole scene.
        photons: on surfaces.
    """

    def __init__(self, cell: Cell, photons: Arrays) -> None:
        self._launcher = cell.replica.launcher
        self._count = len(photons["id"])
        at_normal = photons["normal"]  # every photon that fell on this side counts, from wherever it came
        ranks = np.arange(self._count, dtype=np.int64)
        device = self._launcher.device
        self._built = photon_map.build(photons["position"], photons["flux"], at_normal, at_normal, ranks, device)

    def gather(
        self, position: NDArray[np.float32], normal: NDArray[np.float32], extent: float, k: int = PILOT_K
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """As `gather_each`, with the mean of the channels, shape [P]."""
        irradiance, radius = self.gather_each(position, normal, extent, k)
        return irradiance.mean(axis=1), radius

    def gather_each(
        self, position: NDArray[np.float32], normal: NDArray[np.float32], extent: float, k: int = PILOT_K
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Look for the k nearest photons about some places.

        Args:
            position, normal: of the places, shape [P, 3].
            extent: how far to look at most.

        Returns:
            irradiance of each channel of the flux [W x paths / m²], shape [P, 3], and the radius that it is the mean
            over, shape [P].
        """
        device, count = self._launcher.device, len(position)
        order = self._order(position, normal, k)
        facing = wp.array(normal[order], dtype=wp.vec3, device=device)
        irradiance = wp.empty(count, dtype=wp.vec3, device=device)
        radius = wp.empty(count, dtype=wp.float32, device=device)
        self._launcher(
            gather_kernel,
            -(-count // RUN),
            grain=GRAIN,
            photons=self._built,
            position=wp.array(position[order], dtype=wp.vec3, device=device),
            normal=facing,
            shading_normal=facing,
            k=k,
            r_max=extent,
            r_least=0.0,
            run=RUN,
            irradiance_out=irradiance,
            count_out=wp.empty(count, dtype=wp.int32, device=device),
            radius_out=radius,
            truncated_out=wp.empty(count, dtype=wp.bool, device=device),
        )
        found = np.empty((count, 3), np.float32), np.empty(count, np.float32)
        found[0][order], found[1][order] = irradiance.numpy(), radius.numpy()
        return found

    def neighbours(
        self, position: NDArray[np.float32], normal: NDArray[np.float32], extent: float, k: int = PILOT_K
    ) -> NDArray[np.int32]:
        """Which photons the gathers of some places ask: their numbers, or -1 for none, shape [P, k].

        Args:
            As of gather_each.
        """
        device, count = self._launcher.device, len(position)
        order = self._order(position, normal, k)
        rank = wp.empty((count, k), dtype=wp.int32, device=device)
        self._launcher(
            find_neighbours,
            -(-count // RUN),
            grain=GRAIN,
            photons=self._built,
            position=wp.array(position[order], dtype=wp.vec3, device=device),
            normal=wp.array(normal[order], dtype=wp.vec3, device=device),
            k=k,
            r_max=extent,
            run=RUN,
            rank_out=rank,
        )
        found = np.empty((count, k), np.int32)
        found[order] = rank.numpy()
        return found

    def _order(self, position: NDArray[np.float32], normal: NDArray[np.float32], k: int) -> NDArray[np.intp]:
        """Places that face alike and lie beside each other one after another: a search begins with the last radius.

        In the order of pixels they are spread over the whole image, and the density about a place, by which a search
        without a radius begins, is of photons of all sides: of gathers of 50 it took five times as long.
        """
        if not len(position):
            return np.arange(0)
        side = np.abs(normal).argmax(axis=1)
        positive = np.take_along_axis(normal, side[:, None], axis=1)[:, 0] > 0
        # The width of slabs is that of gathers, were the photons spread evenly over a face of the places' box.
        width = float(np.linalg.norm(np.ptp(position, axis=0).astype(np.float64)) * np.sqrt(k / max(self._count, k)))
        return np.lexsort((*along(position, width + LEAST_WIDTH), 2 * side + positive))
