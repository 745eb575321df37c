"""Weights of a bucket's samples, where the filter that places them is negative (kernels/camera/filter_weights.py)."""

from __future__ import annotations

from typing import Self

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels.camera import filter_weights
from wdpm.kernels.camera.pixel_filter import filter_signs, is_signed, placed_by, sharpening


class SampleWeights:
    """What the samples of some pixels weigh, the mean sign of each pixel computed once.

    Args:
        pixels: int32.
        samples: of each, those of passes before included.
    """

    def __init__(self, replica: Replica, view: View, pixels: NDArray[np.int32], samples: int) -> None:
        self._replica = replica
        placing = placed_by(view.camera.filter)
        self._sharpening = sharpening(placing)
        device = replica.launcher.device
        self._signs = wp.array(filter_signs(placing), dtype=wp.float32, device=device)
        sums = wp.empty(len(pixels), dtype=wp.float64, device=device)
        replica.launcher(
            filter_weights.sum_signs,
            len(pixels),
            camera=replica.camera,
            signs=self._signs,
            pixels=wp.array(pixels, dtype=wp.int32, device=device),
            samples=samples,
            sum_out=sums,
        )
        self._mean_sign = sums.numpy() / samples

    @classmethod
    def if_needed(cls, replica: Replica, view: View, pixels: NDArray[np.int32], samples: int) -> Self | None:
        """None with a filter under which all samples weigh the same."""
        return cls(replica, view, pixels, samples) if is_signed(placed_by(view.camera.filter)) else None

    def weights(self, rays: Arrays) -> NDArray[np.float32]:
        """Of each sample of a wave: camera rays, ordered by pixel as the bucket's pixels are."""
        device, count = self._replica.launcher.device, len(rays["pixel"])
        weights = wp.empty(count, dtype=wp.float32, device=device)
        mean_sign = np.repeat(self._mean_sign, count // len(self._mean_sign))
        self._replica.launcher(
            filter_weights.weigh_samples,
            count,
            camera=self._replica.camera,
            signs=self._signs,
            pixel=wp.array(rays["pixel"], dtype=wp.int32, device=device),
            sample=wp.array(rays["sample"], dtype=wp.int32, device=device),
            mean_sign=wp.array(mean_sign, dtype=wp.float64, device=device),
            sharpening=self._sharpening,
            weight_out=weights,
        )
        return np.asarray(weights.numpy())

    def weigh(self, rays: Arrays, slots: Arrays, parts: Arrays, light_samples: int) -> tuple[Arrays, Arrays]:
        """The slots and the later parts of a wave, times their samples' weights; depth stays as it is.

        Args:
            parts: as cluster.work.bucket_home orders them, `begin` saying whose they are.
        """
        weight = self.weights(rays)
        weighed = {name: slots[name] * weight[:, None] for name in ("emission", "indirect", "normal", "albedo")}
        weighed["direct"] = slots["direct"] * np.repeat(weight, light_samples)[:, None]
        of_parts = np.repeat(weight, np.diff(parts["begin"]))
        return {**slots, **weighed}, {**parts, "radiance": parts["radiance"] * of_parts[:, None]}
