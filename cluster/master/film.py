"""The image as the master puts it together from buckets."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.layers import LAYERS
from wdpm.cluster.task import BucketRendered, BucketTask
from wdpm.scenes.errors import ProtocolError


def spiral(width: int, height: int, bucket: int) -> list[BucketTask]:
    """The buckets of an image, ring by ring from its centre: a person sees first what the picture is about.

    Args:
        width, height: of the image [pixels].
        bucket: side of a bucket [pixels].
    """
    columns, rows = -(-width // bucket), -(-height // bucket)

    def distance(cell: tuple[int, int]) -> tuple[int, float]:
        x, y = 2 * cell[0] + 1 - columns, 2 * cell[1] + 1 - rows
        return max(abs(x), abs(y)), float(np.arctan2(y, x))

    order = sorted(((x, y) for y in range(rows) for x in range(columns)), key=distance)
    return [
        BucketTask(
            index,
            x * bucket,
            y * bucket,
            min((x + 1) * bucket, width),
            min((y + 1) * bucket, height),
        )
        for index, (x, y) in enumerate(order)
    ]


class Film:
    """Layers of an image that fill with buckets.

    Args:
        width, height: of the image [pixels].
        channels: name of layer -> 1 or 3.
    """

    def __init__(self, width: int, height: int, channels: Mapping[str, int] = LAYERS) -> None:
        self.layers: dict[str, NDArray[np.float32]] = {
            name: np.zeros((height, width) if count == 1 else (height, width, count), np.float32)
            for name, count in channels.items()
        }

    def check(self, task: BucketTask, result: BucketRendered) -> None:
        """Raise ProtocolError unless `result` has what `task` calls for: place, layers, types, shapes, and numbers."""
        if (result.x0, result.y0) != (task.x0, task.y0):
            raise ProtocolError(
                f"bucket {task.number} lies at {(task.x0, task.y0)}; its pixels came for {(result.x0, result.y0)}"
            )
        if result.layers.keys() != self.layers.keys():
            raise ProtocolError(
                f"bucket {task.number} has layers {sorted(result.layers)}; expected {sorted(self.layers)}"
            )
        for name, pixels in result.layers.items():
            expected = (task.y1 - task.y0, task.x1 - task.x0, *self.layers[name].shape[2:])
            if pixels.dtype != np.float32 or pixels.shape != expected:
                raise ProtocolError(
                    f"layer {name} of bucket {task.number} is {pixels.dtype} {pixels.shape}; "
                    f"expected float32 {expected}"
                )
            # Slaves count samples that are no numbers and leave them out, so no pixel of theirs is NaN. Infinity may
            # be: the sum of layers that are huge.
            wrong = int(np.isnan(pixels).sum())
            if wrong:
                raise ProtocolError(f"layer {name} of bucket {task.number} has {wrong} values that are NaN")

    def put(self, task: BucketTask, result: BucketRendered) -> None:
        """Copy the pixels of a bucket in; ProtocolError if they do not fit."""
        self.check(task, result)
        for name, pixels in result.layers.items():
            self.layers[name][task.y0 : task.y1, task.x0 : task.x1] = pixels

    def holds(self, task: BucketTask, result: BucketRendered) -> bool:
        """Whether the film has these very bits already."""
        self.check(task, result)
        # 0 and -0 are equal as numbers, so bits are compared.
        return all(
            np.array_equal(
                np.ascontiguousarray(self.layers[name][task.y0 : task.y1, task.x0 : task.x1]).view(np.uint32),
                np.ascontiguousarray(pixels).view(np.uint32),
            )
            for name, pixels in result.layers.items()
        )
