"""Samples of a bucket that count in several pixels, by a filter that reaches beyond each one's own.

A bucket renders the pixels about it as well, as far as their samples reach into it; its neighbours do so too. So no
pixel depends on what another bucket brings, or when.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.task import BucketTask
from wdpm.cluster.work.beams import chosen_samples
from wdpm.cluster.work.pixels.waves import SampleGroup
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera import add_samples, splats
from wdpm.kernels.camera.pixel_filter import reach_of, splat_table
from wdpm.scenes.model.scene import Camera

_MEANS: Final = ("direct", "indirect", "caustic", "volume", "normal", "albedo")
_HELD: Final = (*_MEANS, "weight", "caustic_weight", "volume_weight", "depth", "hits")
"""Of kernels.camera.splats.Splats."""


@dataclass(frozen=True)
class Window:
    """The pixels x0 <= x < x1, y0 <= y < y1, whose samples a bucket needs.

    Attributes:
        reach: of the filter: the bucket's own pixels are so many further in, but at the image's edges.
    """

    task: BucketTask
    x0: int
    y0: int
    x1: int
    y1: int
    reach: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.y1 - self.y0, self.x1 - self.x0

    def pixels(self, width: int) -> NDArray[np.int32]:
        """Their numbers in an image so wide, row by row."""
        x = np.arange(self.x0, self.x1, dtype=np.int32)
        y = np.arange(self.y0, self.y1, dtype=np.int32)
        return (y[:, None] * np.int32(width) + x[None, :]).reshape(-1)

    def of_bucket(self, values: NDArray[Any]) -> NDArray[Any]:
        """Of values of all, those of the bucket's own pixels, row by row."""
        if not self.reach:
            return values
        task, rows = self.task, values.reshape(*self.shape, *values.shape[1:])
        own = rows[task.y0 - self.y0 : task.y1 - self.y0, task.x0 - self.x0 : task.x1 - self.x0]
        return own.reshape(-1, *values.shape[1:])


def window_of(task: BucketTask, camera: Camera, reach: int) -> Window:
    """A bucket and the pixels about it, as far as the image goes."""
    return Window(
        task,
        max(task.x0 - reach, 0),
        max(task.y0 - reach, 0),
        min(task.x1 + reach, camera.width),
        min(task.y1 + reach, camera.height),
        reach,
    )


class Splatting:
    """What the samples of a bucket's window come to.

    Args:
        groups: of its pixels.
    """

    def __init__(self, replica: Replica, view: View, window: Window, groups: list[SampleGroup]) -> None:
        self._replica = replica
        self._view = view
        self._window = window
        self._groups = groups
        device = replica.launcher.device
        self._table = splats.FilterTable()
        self._table.values = wp.array(splat_table(view.camera.filter), dtype=wp.float32, device=device)
        self._table.radius = view.camera.filter.radius
        self._table.reach = reach_of(view.camera.filter)
        self._side = 2 * self._table.reach + 1
        self._splats = [self._zeros(len(group.rows)) for group in groups]

    def _zeros(self, pixels: int) -> Any:
        device = self._replica.launcher.device
        made = columns.zeros(splats.Splats, pixels * self._side**2, device)
        made.depth = wp.zeros(pixels, dtype=wp.float64, device=device)
        made.hits = wp.zeros(pixels, dtype=wp.int32, device=device)
        return made

    def add(self, group: int, rays: Arrays, sums: Any) -> None:
        """Add samples to what the pixels of a group hold.

        Args:
            rays: pixel and number of each sample, as many of each pixel, one pixel after another.
            sums: of each of them by itself (kernels.camera.add_samples.Sums).
        """
        launcher, total = self._replica.launcher, len(rays["pixel"])
        pixels = len(self._groups[group].rows)
        arrays = {**rays, **self._stand_for(rays["sample"])}
        splatted = columns.upload(splats.Splatted, arrays, launcher.device, written=())
        along = wp.empty(total * self._side, dtype=wp.vec2, device=launcher.device)
        launcher(
            splats.weigh_samples,
            total,
            camera=self._replica.camera,
            splatted=splatted,
            table=self._table,
            weight_out=along,
        )
        launcher(
            splats.splat_samples,
            pixels,
            sums=sums,
            splatted=splatted,
            along=along,
            samples=total // pixels,
            reach=self._table.reach,
            splats_out=self._splats[group],
        )

    def _stand_for(self, sample: NDArray[np.int32]) -> Arrays:
        """Of each sample, how many it looks for caustics for, and how many for light in media."""
        run, asks = self._view.caustic_turn
        caustic = np.where(sample % run < asks, np.float32(run / asks), np.float32(0.0))
        volume = np.ones(len(sample), np.float32)
        if self._replica.world.volume_map.paths:
            chosen, share = chosen_samples(self._view, sample)
            volume = np.where(chosen, share, np.float32(0.0))
        return {"caustic_for": caustic, "volume_for": volume}

    def pixels(self, samples: NDArray[np.int32]) -> dict[str, NDArray[Any]]:
        """The bucket's pixels, as means (kernels.camera.add_samples.Sums), but for depth, a sum over their hits.

        Args:
            samples: that each pixel of the window has taken.
        """
        task, window, launcher = self._window.task, self._window, self._replica.launcher
        there = splats.Window()
        there.left, there.top = task.x0 - window.x0, task.y0 - window.y0
        there.width = task.x1 - task.x0
        there.whole_height, there.whole_width = window.shape
        count = (task.x1 - task.x0) * (task.y1 - task.y0)
        means = columns.zeros(add_samples.Sums, count, launcher.device)
        launcher(
            splats.gather_splats,
            count,
            splats=self._of_window(),
            samples=wp.array(samples, dtype=wp.int32, device=launcher.device),
            reach=self._table.reach,
            window=there,
            pixels_out=means,
        )
        return columns.download(means, (*_MEANS, "depth", "hits"))

    def _of_window(self) -> Any:
        """What all pixels of the window hold, row by row."""
        rows, columns_ = self._window.shape
        if len(self._groups) == 1 and len(self._groups[0].rows) == rows * columns_:
            return self._splats[0]
        device = self._replica.launcher.device
        whole = columns.download(self._zeros(rows * columns_), _HELD)
        for group, held in zip(self._groups, self._splats, strict=True):
            for name, column in columns.download(held, _HELD).items():
                by_pixel = whole[name].reshape(rows * columns_, -1)
                by_pixel[group.rows] = column.reshape(len(group.rows), -1)
        return columns.upload(splats.Splats, whole, device, written=())
