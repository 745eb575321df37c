"""The image as the page shows it: the mean of what has come so far, pixel by pixel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.display import Bucket, Frame, Layers
from wdpm.images.channels import PARTITION_LAYER

NO_CELL = -1.0
"""Of pixels that nobody has shaded yet."""


@dataclass(frozen=True)
class Rectangle:
    """Pixels x0 <= x < x1, y0 <= y < y1."""

    x0: int
    y0: int
    x1: int
    y1: int


class Picture:
    """Layers that fill with buckets; passes are averaged as their buckets come.

    This mean is for looking at, in single precision and in the order in which buckets came. The image that is written
    is PassAverage's. One thread writes; others may read at any time, and see a bucket half there.

    Attributes:
        now: what there is: a number that is another for each image, and its layers: float32, shape [height, width, 3]
            or [height, width]; none before the first frame. Read both at once.
        spp: samples a pixel of the frames that are complete.
    """

    def __init__(self, layers: Layers | None = None) -> None:
        self.now: tuple[int, dict[str, NDArray[np.float32]]] = (0, dict(layers or {}))
        self.spp = 0
        self._frame: Frame | None = None

    @property
    def layers(self) -> dict[str, NDArray[np.float32]]:
        """Those that there are."""
        return self.now[1]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]; 0 before the first frame."""
        for layer in self.layers.values():
            return layer.shape[1], layer.shape[0]
        return 0, 0

    def begin(self, frame: Frame) -> bool:
        """A frame begins. Tells whether it is another image, rather than the next pass of the same."""
        before, self._frame = self._frame, frame
        if before is not None and _goes_on(before, frame):
            self.spp += before.spp
            return False
        self.spp = 0
        shape = (frame.height, frame.width)
        layers = {
            name: np.zeros(shape if count == 1 else (*shape, count), np.float32)
            for name, count in frame.channels.items()
        }
        if PARTITION_LAYER in layers:
            layers[PARTITION_LAYER].fill(NO_CELL)
        self.now = (self.now[0] + 1, layers)
        return True

    def put(self, bucket: Bucket) -> Rectangle:
        """Take in pixels; where they are."""
        if self._frame is None:
            raise AssertionError("a bucket came before its frame")
        height, width = next(iter(bucket.layers.values())).shape[:2]
        place = Rectangle(bucket.x0, bucket.y0, bucket.x0 + width, bucket.y0 + height)
        share = self._share(place)
        for name, pixels in bucket.layers.items():
            shown = self.layers[name][place.y0 : place.y1, place.x0 : place.x1]
            if self.spp == 0:
                shown[:] = pixels
            elif name != PARTITION_LAYER:
                shown += (pixels - shown) * (share if pixels.ndim == 2 else share[..., None])
        return place

    def _share(self, place: Rectangle) -> NDArray[np.float32]:
        """Of all samples so far, those of this frame, pixel by pixel; one number where that is the same everywhere."""
        frame = self._frame
        assert frame is not None
        if not len(frame.allotment):
            return np.full((1, 1), frame.spp / (self.spp + frame.spp), np.float32)
        first, count = frame.allotment.of_pixels(place.x0, place.y0, place.x1, place.y1)
        return (count / np.maximum(first + count, 1)).astype(np.float32)

    def replace(self, layers: Mapping[str, NDArray[np.float32]]) -> None:
        """Take the exact mean in place of its own; may bring new layers."""
        self.now = (self.now[0], {**self.layers, **layers})


def _goes_on(before: Frame, frame: Frame) -> bool:
    same = (before.width, before.height, dict(before.channels)) == (frame.width, frame.height, dict(frame.channels))
    return same and frame.first_sample == before.first_sample + before.spp
