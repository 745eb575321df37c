"""Adaptive sampling: which parts of an image the samples of the next pass go to, by what the passes before it tell.

Every pass takes as many samples as without, shared out by what one more of them is worth. The mean of a block is off by

    V = P / passes + Q / samples

where Q is noise that any sample lessens, and P that of photons and irradiance records, which all samples of a pass
share. The passes so far tell V, and of the light that comes by samples alone Q. So the next sample of a block takes
V_P / (passes + 1) + V_Q (1 - samples / (samples + 1)) away if it is the first in this pass, and the second term if not;
samples go where that is most, until as many as a pass has are given away.

Errors are relative to the light of the pixel, as in relMSE, and bounded, or one bright sample would draw all others.

What a block seems to be off by is told by the eight blocks around it, not by its own samples. If those decided how many
more it gets, a block that was hit by rare light would be given more until that is diluted, and one that was not would
stay as dark as it is: the image would be too dark (docs/passes.md has by how much). The geometric mean of that and of
the whole image's error is believed: few samples tell little, and without it the squared error was 3 % larger on average
of six scenes. In the first LEAST_PASSES, and once in each four passes from there on, every block has samples.

All of it is sums in a fixed order and single operations, whose bits no machine decides: which samples a pass takes is a
function of the passes before it, as the exactness contract wants (docs/exactness.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.allotment import BLOCK, NO_ALLOTMENT, Allotment, blocks_of, spread
from wdpm.images.comparison import RELATIVE_FLOOR
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.rendering.error_layers import Batches, ErrorEstimate, same_shape, weight_like
from wdpm.rendering.pass_plan import PassPlan
from wdpm.rendering.prepare import Prepared

Values = NDArray[np.float64]
Blocks = NDArray[np.int32]

FIRST = 2
"""Passes that tell a variance; they are alike everywhere."""

LEAST_PASSES = 4
"""So many passes have samples of every block: two for each of both fits of the bias (error_layers)."""

WINDOW = 4
LAST_OF_WINDOWS = (3, 6)
"""A block that has had no samples in a window of so many passes has some in this one of it, of each two windows: once
an odd pass and once an even one, as the estimates compare those."""

AGAIN = 1.125
"""After so many times the passes as the last time, noise is looked at again: over a large image that takes as long as a
cheap pass does."""

MOST_TIMES = 8
"""As many times the samples that a pass has on average, a block gets at most."""

STEPS = 8
"""Portions in which samples are shared out, of the average."""

MOST_RELATIVE = 4.0
"""Of a pixel's relative squared error. With 1 daylight through blinds gained nothing; with 20 a few pixels with rare
bright samples drew those of all others."""


class AdaptiveSamples:
    """Takes in pass after pass, and says which samples the next one takes.

    Args:
        prepared: the scene, as a PassRenderer has it.

    Attributes:
        samples: that each block has had, int32, shape [rows, columns].
    """

    def __init__(self, prepared: Prepared) -> None:
        camera, world = prepared.session.view.camera, prepared.session.world
        self._size = camera.width, camera.height
        self._by_pass = _by_pass(prepared)
        self._beams = prepared.session.view.volume_samples if world.volume_map.paths else None
        shape = blocks_of(*self._size)
        self.samples: Blocks = np.zeros(shape, np.int32)
        self._passes: Blocks = np.zeros(shape, np.int32)
        self._last: Blocks = np.full(shape, -1, np.int32)
        self._sampled = Batches((camera.height, camera.width, 3))
        self._weight: Values = np.zeros(())
        self._by_sample: Values = np.zeros(shape)  # squared error of one sample, and of one pass
        self._by_one_pass: Values = np.zeros(shape)
        self._looked = 0  # after so many passes

    def add(self, plan: PassPlan, allotment: Allotment, layers: Mapping[str, NDArray[np.float32]]) -> None:
        """Take in a pass."""
        count = allotment.count if len(allotment) else np.full_like(self.samples, plan.spp)
        self.samples += count
        self._passes += count > 0
        self._last[count > 0] = plan.number
        light = layers["beauty"].astype(np.float64)
        for name in self._by_pass:
            if name in layers:
                light -= layers[name]
        weight = weight_of(plan, allotment, *self._size)
        self._weight = np.asarray(self._weight + weight)
        self._sampled.add(light, weight)

    def next(self, plan: PassPlan, error: ErrorEstimate) -> Allotment:
        """The samples of the next pass.

        Args:
            error: of the passes that were taken in.
        """
        if plan.number < FIRST:
            return NO_ALLOTMENT
        if plan.number >= AGAIN * self._looked:
            self._look(error)
            self._looked = plan.number
        # Where only some samples look for light in media, a run of `spp` of them has as many as it should.
        whole = self._beams is not None and plan.spp > self._beams
        step = plan.spp if whole else max(1, plan.spp // STEPS)
        gain = self._gains(step, MOST_TIMES * plan.spp // step)
        gain[0][self._must(plan.number)] = math.inf
        count = np.int32(step) * _best(gain, self._pixels(), step, plan.spp * self._size[0] * self._size[1])
        if (self.samples == plan.first_sample).all() and (count == plan.spp).all():
            return NO_ALLOTMENT
        return Allotment(self.samples.copy(), count)

    def _must(self, number: int) -> NDArray[np.bool_]:
        """Which blocks have samples in a pass whatever they bring."""
        if number < LEAST_PASSES:
            return np.ones(self.samples.shape, np.bool_)
        if number % (2 * WINDOW) not in LAST_OF_WINDOWS:
            return np.zeros(self.samples.shape, np.bool_)
        return self._last < number // WINDOW * WINDOW

    def _look(self, error: ErrorEstimate) -> None:
        """See how noisy each block is."""
        variance = error.variance()
        weight = 1.0 / (np.maximum(error.mean**2 - variance, 0.0) + RELATIVE_FLOOR)
        both, sampled = (
            _around(self._means(_channels(each * weight)))
            for each in (variance, np.minimum(self._sampled.variance(self._weight), variance))
        )
        share = np.divide(sampled, both, out=np.ones_like(both), where=both > 0)
        mean = math.fsum((both * self._pixels()).flat) / (self._size[0] * self._size[1])
        both = np.sqrt(both * mean)
        self._by_sample = both * share * self.samples
        self._by_one_pass = both * (1.0 - share) * self._passes

    def _gains(self, step: int, most: int) -> Values:
        """What a sample of each portion takes off a block's error, shape [most, rows, columns]."""
        had = self.samples + step * np.arange(most)[:, None, None]
        gain = self._by_sample / (had * (had + float(step)))
        gain[0] += self._by_one_pass / (self._passes * (self._passes + 1.0) * step)
        return np.asarray(gain)

    def _means(self, values: Values) -> Values:
        """Of the pixels of each block."""
        rows, columns = self.samples.shape
        padded = np.zeros((rows * BLOCK, columns * BLOCK))
        padded[: values.shape[0], : values.shape[1]] = values
        squares = padded.reshape(rows, BLOCK, columns, BLOCK)
        total = np.zeros((rows, columns))
        for y in range(BLOCK):
            for x in range(BLOCK):
                total += squares[:, y, :, x]
        return total / self._pixels()

    def _pixels(self) -> NDArray[np.int64]:
        """Of each block: those along the lower and the right edge may have fewer."""
        rows, columns = self.samples.shape
        heights = np.minimum(BLOCK, self._size[1] - BLOCK * np.arange(rows))
        widths = np.minimum(BLOCK, self._size[0] - BLOCK * np.arange(columns))
        return heights[:, None] * widths[None, :]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of its state, by name."""
        batches = {f"batches.{name}": array for name, array in self._sampled.arrays().items()}
        noise = {"by sample": self._by_sample, "by pass": self._by_one_pass, "looked": np.array(self._looked)}
        blocks = {"samples": self.samples, "passes": self._passes, "last": self._last}
        return batches | noise | blocks | {"weight": self._weight}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what `arrays` gave. Raises KeyError or ValueError if that is of another image."""
        prefix = "batches."
        self._sampled.restore({n.removeprefix(prefix): a for n, a in state.items() if n.startswith(prefix)})
        self.samples, self._passes, self._last = (
            same_shape(state[name], self.samples) for name in ("samples", "passes", "last")
        )
        self._by_sample, self._by_one_pass = (
            same_shape(state[name], self._by_sample) for name in ("by sample", "by pass")
        )
        self._looked = int(state["looked"])
        self._weight = weight_like(state["weight"], np.empty((*self._size[::-1], 3)))


def weight_of(plan: PassPlan, allotment: Allotment, width: int, height: int) -> Values:
    """Samples of a pass, of each pixel: one number, or shape [height, width, 1]."""
    if not len(allotment):
        return np.asarray(plan.spp, np.float64)
    return np.asarray(spread(allotment.count, width, height)[..., None], np.float64)


def _by_pass(prepared: Prepared) -> tuple[str, ...]:
    """Layers whose noise is that of photons or records, which the samples of a pass share."""
    view = prepared.session.view
    own = view.diffuse_light is DiffuseLight.PHOTON_MAP or view.cache.rounds > 0
    return ("indirect", "caustic", "volume") if own else ("caustic", "volume")


def _channels(values: Values) -> Values:
    """The mean of the channels, at most MOST_RELATIVE; 0 where it is no number."""
    mean = (values[..., 0] + values[..., 1] + values[..., 2]) / 3.0
    return np.where(np.isfinite(mean), np.minimum(mean, MOST_RELATIVE), 0.0)


def _around(blocks: Values) -> Values:
    """The mean of the eight blocks around each, the nearer ones counting twice; beyond an edge are those along it."""
    rows, columns = blocks.shape
    padded = np.pad(blocks, 1, mode="reflect" if min(rows, columns) > 1 else "edge")
    near = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    far = padded[:-2, :-2] + padded[:-2, 2:] + padded[2:, :-2] + padded[2:, 2:]
    return np.asarray((2.0 * near + far) / 12.0)


def _best(gain: Values, pixels: NDArray[np.int64], step: int, budget: int) -> Blocks:
    """How many portions each block gets, the best first, for so many samples in all."""
    order = np.argsort(-gain.reshape(-1), kind="stable")
    cost = step * np.broadcast_to(pixels, gain.shape).reshape(-1)[order]
    taken = np.zeros(gain.size, np.bool_)
    taken[order[np.cumsum(cost) <= budget]] = True
    return np.asarray(taken.reshape(gain.shape).sum(axis=0), np.int32)
