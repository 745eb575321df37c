"""Two independent path-traced images of fewer pixels: noisy, but without bias. They tell how biased another image is.

Their pixels are larger, not fewer of the same size: the blur of photon maps reaches over many pixels, and so many
samples tell more of a mean that is shared by many pixels.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.integrators.registry import REFERENCE
from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.goal import Metric
from wdpm.rendering.pass_plan import PassPlan
from wdpm.rendering.passes import PassRenderer
from wdpm.scenes.model.scene import Scene

Values = NDArray[np.float64]
MakeRenderer = Callable[[Scene, RenderSettings], PassRenderer]

COARSEST = 4
"""Pixels of the image along a side of a reference's pixel, at most."""

LEAST_SIDE = 48
"""Pixels of a reference along its shorter side, if the image has as many: what is blurred within one is not seen."""

FIRST_SPP = 4
"""Of each half of the first image. With half as many, rare bright paths were missed: a dim room was thought biased."""

REFERENCE_SHARE = 1 / 6
"""Of the error asked for: the reference's own uncertainty."""

MOST_SPP = 512
"""Samples of a reference's pixel. So many would be a good image already."""


@dataclass(frozen=True, eq=False)
class ReferencePair:
    """Two images of the same scene, of different seeds.

    Attributes:
        a, b: float64, shape [height / factor, width / factor, 3].
        factor: pixels of the image along a side of theirs.
        spp: samples of a pixel of each.
    """

    a: Values
    b: Values
    factor: int
    spp: int

    def any_of(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether any pixel of the image that a pixel of the reference covers is in the mask."""
        height, width = self.a.shape[:2]
        return np.asarray(mask.reshape(height, self.factor, width, self.factor).any(axis=(1, 3)))

    def finer(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """A mask of the reference's pixels, for those of the image."""
        return np.repeat(np.repeat(mask, self.factor, axis=0), self.factor, axis=1)


def has_reference(settings: RenderSettings) -> bool:
    """Whether paths show the same light: they cannot leave out what comes by a photon map."""
    return not REFERENCE.algorithm.cannot_leave_out.intersection(settings.without)


def coarser(image: Values, factor: int) -> Values:
    """Means over squares of `factor` by `factor` pixels."""
    height, width, channels = image.shape
    squares = image.reshape(height // factor, factor, width // factor, factor, channels)
    mean: Values = squares.mean(axis=(1, 3), dtype=np.float64)
    return mean


def factor_for(width: int, height: int) -> int:
    """The largest that divides both sides and leaves enough of them."""
    fitting = [factor for factor in (COARSEST, 2) if width % factor == 0 == height % factor]
    return next((factor for factor in fitting if min(width, height) >= LEAST_SIDE * factor), 1)


def make_reference_pair(
    scene: Scene,
    settings: RenderSettings,
    metric: Metric,
    wanted: float,
    make: MakeRenderer,
    most_seconds: float = math.inf,
) -> ReferencePair:
    """Render both images of a pair.

    Args:
        scene: its camera gives the size of the image.
        settings: of the image; the references have an integrator and seeds of their own.
        wanted: standard deviation that the mean product of both errors may have, weighted mean squares.
        make: makes the renderer.
        most_seconds: that it may take, but for compiling and its first samples.
    """
    camera = scene.camera
    factor = factor_for(camera.width, camera.height)
    small = replace(scene, camera=replace(camera, width=camera.width // factor, height=camera.height // factor))
    images: list[Values] = []
    spp = 0
    renderer = make(small, path_settings(settings, "a"))
    for name in ("a", "b"):
        if name == "b":
            renderer.see_by(path_settings(settings, name).seed)
        if not spp:
            began = time.perf_counter()
            first = [_beauty(renderer, PassPlan(i, i * FIRST_SPP, FIRST_SPP)) for i in range(2)]
            spp = 2 * FIRST_SPP * math.ceil(_times_more(first[0], first[1], metric, wanted))
            affordable = most_seconds / 2 / (time.perf_counter() - began) * 2 * FIRST_SPP
            spp = max(int(min(spp, MOST_SPP, affordable)), 2 * FIRST_SPP)
            image = (first[0] + first[1]) * (FIRST_SPP / spp)
            left = spp - 2 * FIRST_SPP
        else:
            image, left = np.zeros_like(images[0]), spp
        if left:
            image = image + _beauty(renderer, PassPlan(2, spp - left, left)) * (left / spp)
        images.append(image)
    return ReferencePair(images[0], images[1], factor, spp)


def _beauty(renderer: PassRenderer, plan: PassPlan) -> Values:
    beauty = renderer.render(plan).layers["beauty"].astype(np.float64)
    return np.where(np.isfinite(beauty), beauty, 0.0)


def path_settings(settings: RenderSettings, name: str) -> RenderSettings:
    """Of a path-traced image with random numbers of its own."""
    # Part of the seed, not a name of anything: another word would give other random numbers.
    digest = hashlib.sha256(f"witness {name} of seed {settings.seed}".encode()).digest()
    return replace(settings, integrator=REFERENCE, seed=int.from_bytes(digest[:4], "little"))


def _times_more(one: Values, other: Values, metric: Metric, wanted: float) -> float:
    """As many times more samples than `one` and `other` have together are wanted."""
    weighted = metric.weight((one + other) / 2) * (one - other) ** 2 / 4  # the variance of their mean
    pixels = weighted.mean(axis=2)
    # The spread of a product of two independent errors of that variance; rare samples make it larger than its mean.
    spread = math.sqrt(float((pixels**2).mean()) / pixels.size)
    return max(spread / wanted, 1.0)
