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
from wdpm.kernels import blocks, columns
from wdpm.kernels.camera import splats
from wdpm.kernels.camera.pixel_filter import reach_of, splat_table
from wdpm.scenes.model.scene import Camera

TILE_SAMPLES: Final = 1 << 13
"""Of pixels whose samples are added up together, about: what they hold for others stays in a core's cache meanwhile."""


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


def tiles_of(groups: list[SampleGroup]) -> list[SampleGroup]:
    """Groups of pixels in parts, of some TILE_SAMPLES samples each."""
    parts = []
    for group in groups:
        at_once = max(1, TILE_SAMPLES // group.count)
        for start in range(0, len(group.rows), at_once):
            some = slice(start, start + at_once)
            parts.append(SampleGroup(group.rows[some], group.first[some], group.count))
    return parts


class Splatting:
    """What the samples of a bucket's window come to.

    Samples are added pixel by pixel: all of a tile's, then those of the next.

    Args:
        tiles: of its pixels, in which each takes as many samples (tiles_of).
    """

    def __init__(self, replica: Replica, view: View, window: Window, tiles: list[SampleGroup]) -> None:
        self._replica = replica
        self._view = view
        self._window = window
        self._tiles = tiles
        device = replica.launcher.device
        self._table = splats.FilterTable()
        self._table.values = wp.array(splat_table(view.camera.filter), dtype=wp.float32, device=device)
        self._table.radius = view.camera.filter.radius
        self._table.reach = reach_of(view.camera.filter)
        self._side = 2 * self._table.reach + 1
        task, self._bucket = window.task, splats.Bucket()
        self._bucket.x, self._bucket.y = task.x0, task.y0
        self._bucket.width, self._bucket.height = task.x1 - task.x0, task.y1 - task.y0
        self._bucket.image_width = view.camera.width
        self._pixels = wp.zeros(
            self._bucket.width * self._bucket.height * splats.PARTS, dtype=splats.row8, device=device
        )
        self._depth = np.zeros(window.shape[0] * window.shape[1])
        self._hits = np.zeros(len(self._depth), np.int32)
        # What the pixels of the tile hold that is on its way, and how many samples each of them has taken.
        most = max((len(tile.rows) for tile in tiles), default=0)
        self._held = wp.empty(most * self._side**2 * splats.PARTS, dtype=splats.row8, device=device)
        self._taken = 0

    def add(self, tile: int, rays: Arrays, sums: Any) -> None:
        """Add samples to what the pixels of a tile hold, and that to the bucket once these have all theirs.

        Args:
            rays: pixel and number of each sample, as many of each pixel, one pixel after another.
            sums: of each of them by itself (kernels.camera.add_samples.Sums).
        """
        launcher, total = self._replica.launcher, len(rays["pixel"])
        pixels, count = len(self._tiles[tile].rows), self._tiles[tile].count
        if not self._taken:
            self._held.zero_()
        arrays = {**rays, **self._stand_for(rays["sample"])}
        splatted = columns.upload(splats.Splatted, arrays, launcher.device, written=())
        rows = wp.empty(total * splats.PARTS, dtype=splats.row8, device=launcher.device)
        weight = wp.empty(total * self._side, dtype=wp.vec2d, device=launcher.device)
        launcher(
            splats.rows_of_samples,
            total,
            camera=self._replica.camera,
            sums=sums,
            splatted=splatted,
            table=self._table,
            rows_out=rows,
            weight_out=weight,
        )
        launcher(
            splats.splat_samples,
            pixels,
            rows=rows,
            weight=weight,
            samples=total // pixels,
            reach=self._table.reach,
            splats_out=self._held,
        )
        self._add_own(self._tiles[tile].rows, total // pixels, sums)
        self._taken += total // pixels
        if self._taken == count:
            self._taken = 0
            self._scatter(np.ascontiguousarray(rays["pixel"][:: total // pixels]), count)

    def _add_own(self, rows: NDArray[np.intp], samples: int, sums: Any) -> None:
        """Add depths and hits, which count in the samples' own pixel alone, in the order of samples."""
        own = columns.download(sums, ("depth", "hits"))
        for depth, hits in zip(own["depth"].reshape(-1, samples).T, own["hits"].reshape(-1, samples).T, strict=True):
            self._depth[rows] += depth
            self._hits[rows] += hits

    def _scatter(self, pixels: NDArray[np.int32], samples: int) -> None:
        """Add what pixels hold to the bucket's: in one thread on the CPU, part by part where threads are many."""
        launcher = self._replica.launcher
        shares = 1 if blocks.shares_memory(launcher.device) else splats.PARTS
        launcher(
            splats.scatter_splats,
            shares,
            splats=self._held,
            pixels=columns.array_over(pixels, wp.int32, launcher.device),
            samples=samples,
            reach=self._table.reach,
            bucket=self._bucket,
            shares=shares,
            pixels_out=self._pixels,
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

    def pixels(self) -> dict[str, NDArray[Any]]:
        """The bucket's pixels, as means (kernels.camera.add_samples.Sums), but for depth, a sum over their hits."""
        table = self._pixels.numpy().reshape(-1, splats.PARTS * 8)
        weights = {"caustic": splats.CAUSTIC_WEIGHT, "volume": splats.VOLUME_WEIGHT}
        found = {"depth": self._window.of_bucket(self._depth), "hits": self._window.of_bucket(self._hits)}
        for number, name in enumerate(splats.COLORS):
            weight = table[:, weights.get(name, splats.WEIGHT), None]
            sums = table[:, 3 * number : 3 * number + 3]
            found[name] = np.divide(sums, weight, out=np.zeros_like(sums), where=weight != 0)
        return found
