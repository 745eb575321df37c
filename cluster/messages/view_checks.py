"""Checks of Views that came over the wire, and of the samples that they ask for."""

from __future__ import annotations

from wdpm.cluster.allotment import OUTLINE_TIMES, Allotment, LampOutlines, blocks_of
from wdpm.cluster.messages.demands import indices, require
from wdpm.cluster.world import View
from wdpm.kernels.limits import MAX_K, MOST_CAUSTIC_SHARE, RAY_SAMPLES


def check_view(view: View, where: str) -> None:
    counts = (view.spp, view.light_samples, view.k, view.bucket, view.volume_samples)
    require(min(counts) >= 1 and max(counts) < 2**31, where, f"spp, light_samples, k, bucket are {counts}")
    require(min(view.k, view.caustic_k) >= 1 and max(view.k, view.caustic_k) <= MAX_K, where, f"k is {view.k}")
    share = view.caustic_share
    require(1 <= share <= MOST_CAUSTIC_SHARE and share & (share - 1) == 0, where, f"caustic_share is {share}")
    last = (view.first_sample + view.spp) * view.outlines.times
    require(view.first_sample >= 0 and last < 2**31, where, f"samples {view.first_sample} to {last - 1}")
    require(0 <= view.seed < 2**32, where, f"seed {view.seed}")
    require(view.max_depth is None or view.max_depth >= 1, where, f"max_depth {view.max_depth}")
    blocks, shape = blocks_of(view.camera.width, view.camera.height), view.allotment.first.shape
    require(not len(view.allotment) or shape == blocks, where, f"samples of {shape} blocks; the image has {blocks}")
    indices(view.outlines.pixels, 0, view.camera.width * view.camera.height, f"{where}.outlines.pixels")


def check_allotment(allotment: Allotment, where: str) -> None:
    first, count = allotment.first, allotment.count
    require(first.ndim == 2 and first.shape == count.shape, where, f"{first.shape} and {count.shape} blocks")
    indices(first, 0, RAY_SAMPLES, f"{where}.first")
    indices(count, 0, RAY_SAMPLES, f"{where}.count")


def check_lamp_outlines(outlines: LampOutlines, where: str) -> None:
    require(1 <= outlines.times <= OUTLINE_TIMES, where, f"{outlines.times} times the samples")
