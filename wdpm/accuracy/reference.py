"""What the points of a sweep are compared with: image files, or path tracing of our own in two independent halves."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wdpm.accuracy.error import Truth
from wdpm.cluster.integrators.registry import REFERENCE
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.image import Image, load
from wdpm.progress import Progress
from wdpm.rendering.array_file import read_arrays, write_arrays
from wdpm.scenes.errors import ImageError

STATE = "reference.npz"
HALVES = ("reference-a.exr", "reference-b.exr")

FIRST_BATCH = 4
"""Samples of the batch that tells how many fit into the time."""

MOST_BATCH = 256
BATCHES = 16
"""Batches that the time is to hold, at least: half of them are one half of the reference. More where it is long."""

Render = Callable[[RenderSettings], Image]


@dataclass(frozen=True, eq=False)
class Reference:
    """A truth, and where it is from in words."""

    truth: Truth
    words: str


def read_reference(paths: Sequence[Path], size: tuple[int, int]) -> Reference:
    """Read one image, or two that are independent of each other and tell their own noise.

    Args:
        size: of the renders, (width, height).

    Raises:
        ImageError: missing or broken file, another size, values that are not finite, a black image, two equal ones.
    """
    images = [_read(path, size) for path in paths]
    names = " and ".join(str(path) for path in paths)
    if len(images) == 2 and np.array_equal(images[0], images[1]):
        raise ImageError(
            f"{names}: the two references have equal pixels, and are no independent halves that could tell their own "
            "noise: render one with another --seed, or give only one"
        )
    if len(images) == 1:
        words = f"{names}; its own noise is not known, and counts as bias"
        return Reference(Truth(images[0]), words)
    return Reference(_of_halves(images[0], images[1]), f"the mean of {names}, whose difference tells their noise")


def trace_reference(
    render: Render, settings: RenderSettings, seconds: float, folder: Path, digest: str, progress: Progress
) -> Reference:
    """Path trace the scene in batches for some time; go on from what the folder has.

    Args:
        render: renders settings.
        settings: of the base of the sweep.
        seconds: stop after the batch at whose end they are over; spent at earlier times counts.
        digest: of what the reference is of.

    Raises:
        ImageError: values that are not finite, a black image, or what the folder has is broken.
    """
    state = _State.read(folder / STATE, digest) or _State(digest)
    if state.spent < seconds or state.batches < 2:
        progress.start("reference", max(round(seconds), 1))
        progress.advance(min(round(state.spent), round(seconds)))
    while state.spent < seconds or state.batches < 2:
        told = min(round(state.spent), round(seconds))
        if not state.spp:
            began = time.perf_counter()
            render(_path(settings, FIRST_BATCH, "trial"))
            taken = time.perf_counter() - began
            state.spp = batch_size(taken / FIRST_BATCH, seconds)
        pair = []
        began = time.perf_counter()
        for half in range(2):
            image = render(_path(settings, state.spp, f"batch {state.batches // 2} of half {half}")).pixels
            if not np.isfinite(image).all():
                raise ImageError("the reference that was path traced has values that are not finite; give --reference")
            pair.append(image.astype(np.float64))
        state.add(pair[0], pair[1], time.perf_counter() - began)
        state.write(folder / STATE)
        progress.advance(min(round(state.spent), round(seconds)) - told)
    halves = [(total / (state.batches / 2)).astype(np.float32) for total in (state.a, state.b)]
    for pixels, name in zip(halves, HALVES, strict=True):
        Image({"beauty": pixels}, {"samples": state.spp * state.batches // 2}).save(folder / name)
    # From what the files hold, so that figures can be confirmed from these.
    truth = _of_halves(halves[0].astype(np.float64), halves[1].astype(np.float64))
    if not truth.pixels.any():
        raise ImageError("the reference that was path traced is black: paths find no light; give a --reference")
    words = f"path tracing of our own, {state.spp * state.batches:,} samples in two halves, {state.spent:.0f} s"
    return Reference(truth, words)


def batch_size(seconds_a_sample: float, seconds: float) -> int:
    """Samples of a batch: a power of two, at which the samples of a pixel are spread most evenly."""
    size = FIRST_BATCH
    while size < MOST_BATCH and 2 * size * seconds_a_sample * BATCHES <= seconds:
        size *= 2
    return size


class _State:
    """The sums of the batches so far."""

    def __init__(self, digest: str) -> None:
        self.digest = digest
        self.spp = 0
        self.batches = 0
        self.spent = 0.0
        self.a: NDArray[np.float64] = np.zeros(())
        self.b: NDArray[np.float64] = np.zeros(())

    def add(self, a: NDArray[np.float64], b: NDArray[np.float64], seconds: float) -> None:
        self.a, self.b = self.a + a, self.b + b
        self.batches += 2
        self.spent += seconds

    def write(self, path: Path) -> None:
        """Raises ImageError."""
        header = {"digest": self.digest, "spp": self.spp, "batches": self.batches, "spent": self.spent}
        write_arrays(path, header, {"a": self.a, "b": self.b})

    @classmethod
    def read(cls, path: Path, digest: str) -> _State | None:
        """What was written, if it is of this digest. Raises ImageError if it is broken."""
        if not path.is_file():
            return None
        try:
            header, arrays = read_arrays(path)
            if header["digest"] != digest:
                return None
            state = cls(digest)
            state.spp, state.batches, state.spent = header["spp"], header["batches"], header["spent"]
            state.a, state.b = arrays["a"], arrays["b"]
        except (OSError, ValueError, KeyError) as error:
            raise ImageError(f"{path}: is broken ({error}); delete it and run again to have it traced again") from None
        return state


def traced_settings(settings: RenderSettings) -> RenderSettings:
    """Settings of a reference of our own: path tracing.

    It shows the light of photon maps that are left out, as it must: to leave it out is bias of the renders.
    """
    without = tuple(effect for effect in settings.without if effect not in REFERENCE.algorithm.cannot_leave_out)
    return replace(settings, integrator=REFERENCE, without=without, passes=1, pass_samples=(), band=1.0, inexact=False)


def _path(settings: RenderSettings, spp: int, name: str) -> RenderSettings:
    """Path tracing with random numbers of its own."""
    seed = int.from_bytes(hashlib.sha256(f"reference: {name}".encode()).digest()[:4], "little")
    return replace(traced_settings(settings), spp=spp, seed=seed)


def _of_halves(a: NDArray[np.float64], b: NDArray[np.float64]) -> Truth:
    return Truth((a + b) / 2, (a - b) / 2)


def _read(path: Path, size: tuple[int, int]) -> NDArray[np.float64]:
    image = load(path)
    height, width = image.shape
    if (width, height) != size:
        raise ImageError(
            f"{path}: the reference is {width}x{height}, the renders are {size[0]}x{size[1]}: "
            f"give --size {width}x{height}, or another reference"
        )
    bad = ~np.isfinite(image.pixels).all(axis=2)
    if bad.any():
        y, x = (int(each[0]) for each in np.nonzero(bad))
        raise ImageError(
            f"{path}: the reference has {int(bad.sum())} pixels that are NaN or infinite, the first at {x},{y}: "
            "errors against it would mean nothing; give another"
        )
    if not image.pixels.any():
        raise ImageError(
            f"{path}: the reference is black, every pixel of it: errors against it would only tell how bright the "
            "renders are; give another"
        )
    return image.pixels.astype(np.float64)
