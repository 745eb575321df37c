"""Where a task's results come together: fixed slots, added in a fixed order once all credit is back.

A home never waits and never polls. It starts its task with some credit; every batch that follows carries a share, and
returns it at its end. When all of it is home, nothing of the task is left in flight anywhere (Mattern 1989).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays, Batch, Kind, by_destination, concatenate, take, take_some
from wdpm.cluster.layers import layers_of
from wdpm.cluster.render_settings import Routing
from wdpm.cluster.rows import in_order, put_rows, take_rows
from wdpm.cluster.runs import Runs
from wdpm.cluster.task import BucketRendered, BucketTask
from wdpm.cluster.work import parts
from wdpm.cluster.work.cell import Cell
from wdpm.cluster.work.guards import BEAMS_CLAMPED, VOLUME, Guards
from wdpm.cluster.work.misses import first_cells, missed_light, no_hits
from wdpm.cluster.work.pixels.sample_weights import SampleWeights
from wdpm.cluster.work.pixels.splatting import Splatting, Window, tiles_of, window_of
from wdpm.cluster.work.pixels.waves import Piece, sample_groups, waves
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.work.whole.launches import NO_COUNTS
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera import add_samples
from wdpm.kernels.camera.pixel_filter import is_signed, placed_by, reach_of
from wdpm.kernels.camera.rays import Rays
from wdpm.kernels.ray_fields import HIT
from wdpm.scenes.errors import ProtocolError

WAVE_SAMPLES = 1 << 16
"""Samples of a bucket that are under way at once: bounds memory, changes no bit."""

_SUMMED: Final = ("direct", "indirect", "caustic", "normal", "albedo", "depth", "hits")
"""Of Kind.PIXELS, those that are sums of a pixel (kernels.camera.add_samples.Sums)."""

_ALIKE: Final = np.zeros(0, np.float32)
"""Weights of samples that all weigh 1."""


class BucketHome:
    """A bucket: all samples of its pixels, in waves, and of those about it that count in it too (splatting).

    Args:
        guards: of camera samples whose fate is settled at home.
        samples: which of each pixel's samples: for each range an image, one below the other, in which each counts in
            its own pixel alone; none for all that the view has, in one.
        scene: the only cell, where it can follow samples from the camera to their ends at once.
    """

    def __init__(
        self,
        task: BucketTask,
        number: int,
        replica: Replica,
        view: View,
        guards: Guards,
        samples: Sequence[range] = (),
        scene: Cell | None = None,
    ) -> None:
        self.task = task
        self._scene = scene
        self._number = number
        self._replica = replica
        self._view = view
        self._guards = guards
        images = max(1, len(samples))
        self._shape = (images * (task.y1 - task.y0), task.x1 - task.x0)
        self._window = window_of(task, view.camera, 0 if samples else reach_of(view.camera.filter))
        pixels = self._window.pixels(view.camera.width)
        self._pixels = np.tile(pixels, images)
        first, self._counts = _samples_of(self._window, view, pixels, samples)
        self._groups = sample_groups(first, self._counts, alike=is_signed(placed_by(view.camera.filter)))
        if self._window.reach:
            self._groups = tiles_of(self._groups)
        self._splatting = Splatting(replica, view, self._window, self._groups) if self._window.reach else None
        self._weights = [self._weights_of(number) for number in range(len(self._groups))]
        self._waves = deque(waves(self._groups, WAVE_SAMPLES))
        self._wave: list[Piece] = []
        device = replica.launcher.device
        summed = [] if self._splatting is not None else self._groups
        self._sums = [columns.zeros(add_samples.Sums, len(group.rows), device) for group in summed]
        self._nothing: dict[int, Any] = {}  # sums of no samples, by how many there are of them
        self._cell = np.full(len(self._pixels), -1, np.int32)
        self._credit = 0
        self._slots: dict[str, NDArray[Any]] = {}
        self._pixel_sums: list[Arrays] = []
        self._rays: Arrays = {}
        self._probing = False
        self._later: list[Arrays] = []

    def begin(self) -> Iterator[Batch]:
        """Start the next wave of samples, if there is one."""
        while self._waves and self._trace_whole(self._waves[0]):
            self._waves.popleft()
        if not self._waves:
            return
        self._wave = self._waves.popleft()
        pieces = [self._samples_in(piece) for piece in self._wave]
        total = sum(len(pixel) for pixel, _ in pieces)
        self._pixel_sums = []
        rays: dict[str, NDArray[Any]] = {
            "slot": np.arange(total, dtype=np.int32),
            "pixel": np.concatenate([pixel for pixel, _ in pieces]),
            "sample": np.concatenate([sample for _, sample in pieces]),
        }
        self._rays = rays
        self._slots = _empty_slots(total, self._view.light_samples)
        if self._view.routing is Routing.MERGE:
            yield from self._begin_merge(rays)
        else:
            yield from self._begin_forward({**rays, "together": self._together()})

    def _trace_whole(self, wave: Sequence[Piece]) -> bool:
        """Add a wave's samples at once, if that can be: nothing of it is under way then."""
        if self._scene is None:
            return False
        if self._splatting is not None:
            return self._trace_each(wave, self._scene, self._splatting)
        sums, cell, counts = list(self._sums), self._cell.copy(), NO_COUNTS
        for piece in wave:
            group, weights = self._groups[piece.group], self._weights[piece.group]
            pixels: dict[str, NDArray[Any]] = {
                "pixel": self._pixels[group.rows],
                "first": group.first,
                "weight": _ALIKE,
            }
            if weights is not None:
                pixel, sample = self._samples_in(piece)
                pixels["weight"] = weights.weights({"pixel": pixel, "sample": sample})
            traced = self._scene.trace_whole(pixels, piece.start, piece.stop - piece.start, sums[piece.group])
            if traced is None:
                return False
            sums[piece.group] = traced.sums
            counts = counts + traced.counts
            if piece.start == 0:
                cell[group.rows] = np.where(traced.hit, self._scene.number, -1)
        self._sums, self._cell = sums, cell
        self._scene.count_whole(counts)
        return True

    def _trace_each(self, wave: Sequence[Piece], scene: Cell, splatting: Splatting) -> bool:
        """As `_trace_whole`, each sample by itself, since it counts in several pixels."""
        pieces, counts = [], NO_COUNTS
        for piece in wave:
            pixel, sample = self._samples_in(piece)
            pixels: dict[str, NDArray[Any]] = {"pixel": pixel, "first": sample, "weight": _ALIKE}
            if len(pixel) not in self._nothing:
                self._nothing[len(pixel)] = columns.zeros(add_samples.Sums, len(pixel), self._replica.launcher.device)
            traced = scene.trace_whole(pixels, 0, 1, self._nothing[len(pixel)])
            if traced is None:
                return False
            counts = counts + traced.counts
            pieces.append((piece, {"pixel": pixel, "sample": sample}, traced))
        for piece, rays, traced in pieces:
            splatting.add(piece.group, rays, traced.sums)
            if piece.start == 0:
                first = traced.hit[:: piece.stop - piece.start]
                self._cell[self._groups[piece.group].rows] = np.where(first, scene.number, -1)
        scene.count_whole(counts)
        return True

    def _weights_of(self, number: int) -> SampleWeights | None:
        """Of the samples of a group, all of whose pixels end at the same sample where they do not weigh the same."""
        group = self._groups[number]
        return SampleWeights.if_needed(
            self._replica, self._view, self._pixels[group.rows], int(group.first[0]) + group.count
        )

    def _samples_in(self, piece: Piece) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Pixel and number of each sample, ordered by pixel."""
        group = self._groups[piece.group]
        sample = np.add.outer(group.first, np.arange(piece.start, piece.stop, dtype=np.int32))
        pixel: NDArray[np.int32] = np.repeat(self._pixels[group.rows], piece.stop - piece.start)
        return pixel, sample.reshape(-1)

    def _together(self) -> NDArray[np.int32]:
        """Of each sample of the wave, how many of its pixel may come home as one sum: START of kernels.ray_fields.

        All that a pixel has so far, where they weigh the same: its sum is theirs.
        """
        together = [np.zeros(0, np.int32)]
        for piece in self._wave:
            each = np.zeros((len(self._groups[piece.group].rows), piece.stop - piece.start), np.int32)
            if self._comes_as_sums(piece):
                each[:, 0] = piece.stop
            together.append(each.reshape(-1))
        return np.concatenate(together)

    def _comes_as_sums(self, piece: Piece) -> bool:
        alike = self._weights[piece.group] is None and self._splatting is None
        return alike and piece.start == 0 and piece.stop > 1

    def _begin_forward(self, start: dict[str, NDArray[Any]]) -> Iterator[Batch]:
        """The rays of a pixel set out together, in the cell that the first of them comes to first."""
        pixel = start["pixel"]
        ahead = np.flatnonzero(np.diff(pixel, prepend=-1))
        some = {**take_some(start, ahead), **no_hits(len(ahead), self._view)}
        rays = columns.upload(Rays, some, self._replica.launcher.device)
        destination = np.repeat(first_cells(self._replica, rays, len(ahead)), np.diff(ahead, append=len(pixel)))
        unit = parts.credit_of_camera_ray(self._view.light_samples)
        self._credit = len(pixel) * unit
        for cell, rows in by_destination(destination, destination >= 0):
            yield self._batch(Kind.START, cell, len(rows) * unit, take(start, rows))

    def _begin_merge(self, rays: dict[str, NDArray[Any]]) -> Iterator[Batch]:
        """Each ray sets out in all cells that it touches; their hits are merged here."""
        replica, device = self._replica, self._replica.launcher.device
        total = len(rays["slot"])
        touched_array = wp.zeros((total, replica.world.top_tree.cells), dtype=wp.uint8, device=device)
        full = columns.upload(Rays, {**rays, **no_hits(total, self._view)}, device)
        kernel, camera = replica.kernels.mark_touched_cells, replica.camera
        replica.launcher(kernel, total, camera=camera, cells=replica.cells, rays=full, touched_out=touched_array)
        touched = touched_array.numpy().astype(bool)
        cells = np.flatnonzero(touched.any(axis=0))
        self._probing = True
        self._credit = len(cells)
        self._rays = {**rays, **no_hits(total, self._view)}
        for cell in cells:
            yield self._batch(Kind.PROBE, int(cell), 1, take(rays, np.flatnonzero(touched[:, cell])))

    def receive(self, batch: Batch) -> Iterator[Batch]:
        """Put what came home into its slots; start the next wave when this one is complete."""
        arrays = batch.arrays
        if "slot" in arrays:
            self._check_slots(batch)
        if batch.kind is Kind.PROBED:
            self._merge(arrays)
        elif batch.kind is Kind.SAMPLES:
            self._fill(arrays, ("emission", "indirect", "depth", "normal", "albedo", "cell"))
        elif batch.kind is Kind.PIXELS:
            self._pixel_sums.append(arrays)
        elif batch.kind is Kind.LIT:
            self._add_parts(arrays)
        elif batch.kind is not Kind.ENDED:
            raise ProtocolError(f"a {batch.kind.value} batch came home to bucket {self.task.number}")
        self._credit -= batch.credit
        if self._credit == 0:
            if self._probing:
                self._probing = False
                yield from self._shade_merged()
            if self._credit == 0:
                self._finish_wave()
                yield from self.begin()

    def _fill(self, arrays: Arrays, names: Iterable[str]) -> None:
        """Put samples into their slots; where all come at once and in order, they are the slots."""
        slot = arrays["slot"]
        whole = len(slot) == len(self._slots["depth"]) and np.array_equal(slot, self._rays["slot"])
        for name in names:
            if whole:
                self._slots[name] = arrays[name]
            else:
                put_rows(self._slots[name], slot, arrays[name])

    def _add_parts(self, arrays: Arrays) -> None:
        """Direct light at the first surface has slots of its own; all other parts wait to be put in order."""
        shots = self._view.light_samples
        place = arrays["place"]
        first = place < shots
        if first.all():
            put_rows(self._slots["direct"], arrays["slot"] * np.int32(shots) + place, arrays["radiance"])
            return
        rows = np.flatnonzero(first)
        whose = arrays["slot"][rows] * np.int32(shots) + place[rows]
        put_rows(self._slots["direct"], whose, take_rows(arrays["radiance"], rows))
        later = take(arrays, np.flatnonzero(~first))
        if self._guards.strict:
            self._demand_finite(later)
        self._later.append(later)

    def _demand_finite(self, lit: Arrays) -> None:
        """Raise GuardError about light that is not finite: of beams, whose samples only the home knows."""
        bad = np.flatnonzero(~np.isfinite(lit["radiance"]).all(axis=1))
        if len(bad):
            slot = lit["slot"][bad]
            whose = {
                "pixel": self._rays["pixel"][slot],
                "sample": self._rays["sample"][slot],
                "bounce": parts.bounce_of(lit["place"][bad], self._view.light_samples),
            }
            clamped = np.isnan(lit["radiance"][bad]).any()
            self._guards.act(BEAMS_CLAMPED if clamped else VOLUME, np.arange(len(bad)), whose)

    def _merge(self, found: Arrays) -> None:
        """Nearest first; of equally near hits the smaller triangle number (exactness contract, item 2).

        Hits of several cells may have come together, so that there are several of a slot.
        """
        order = np.lexsort((found["prim"], found["t"], found["slot"]))
        slot = found["slot"][order]
        best = np.ones(len(slot), np.bool_)
        best[1:] = slot[1:] != slot[:-1]
        found = take_some(found, order[best])
        slot = found["slot"]
        t, prim = self._rays["t"][slot], self._rays["prim"][slot]
        nearer = (prim < 0) | (found["t"] < t) | ((found["t"] == t) & (found["prim"] < prim))
        for name in HIT:
            self._rays[name][slot[nearer]] = found[name][nearer]

    def _shade_merged(self) -> Iterator[Batch]:
        """Send the merged hits to the cells that contain them, and rays that have met nothing to what lies beyond."""
        unit = parts.credit_of_camera_ray(self._view.light_samples)
        hit = self._rays["prim"] >= 0
        self._credit = len(hit) * unit
        for cell, rows in by_destination(self._rays["owner"].astype(np.int32), hit):
            yield self._batch(Kind.SHADE, cell, len(rows) * unit, take(self._rays, rows))
        missed = np.flatnonzero(~hit)
        if len(missed):
            runs = Runs.one(self._number, self.task.number, len(missed), len(missed) * unit)
            yield from missed_light(self._replica, self._guards, runs, -1, self._rays, missed)

    def _finish_wave(self) -> None:
        """Add the wave's samples to the pixels' sums, in the order of their numbers."""
        later = self._parts_in_order()
        start = 0
        for piece in self._wave:
            stop = start + len(self._groups[piece.group].rows) * (piece.stop - piece.start)
            self._add_piece(piece, start, stop, later)
            start = stop
        self._wave, self._later, self._slots, self._rays, self._pixel_sums = [], [], {}, {}, []

    def _add_piece(self, piece: Piece, start: int, stop: int, later: Arrays) -> None:
        """Add the samples in the slots start to stop - 1.

        Args:
            later: the parts of all slots, in order.
        """
        launcher, shots = self._replica.launcher, self._view.light_samples
        group, weights = self._groups[piece.group], self._weights[piece.group]
        count = piece.stop - piece.start
        slots: Arrays = {
            name: column[start * shots : stop * shots] if name == "direct" else column[start:stop]
            for name, column in self._slots.items()
        }
        begin, end = later["begin"][start], later["begin"][stop]
        mine: Arrays = {
            "begin": later["begin"][start : stop + 1] - begin,
            "layer": later["layer"][begin:end],
            "radiance": later["radiance"][begin:end],
        }
        rays = {name: self._rays[name][start:stop] for name in ("pixel", "sample")}
        if weights is not None:
            slots, mine = weights.weigh(rays, slots, mine, shots)
        apart = self._splatting is not None
        sums = columns.zeros(add_samples.Sums, stop - start, launcher.device) if apart else self._sums[piece.group]
        launcher(
            add_samples.add_samples,
            stop - start if apart else len(group.rows),
            slots=columns.upload(add_samples.Slots, slots, launcher.device),
            parts=columns.upload(add_samples.Parts, mine, launcher.device),
            samples=1 if apart else count,
            light_samples=shots,
            sums_out=sums,
        )
        if self._splatting is not None:
            self._splatting.add(piece.group, rays, sums)
        if piece.start == 0:
            self._cell[group.rows] = slots["cell"].reshape(-1, count)[:, 0]
        for arrays in self._pixel_sums:
            self._put_sums(piece, start, stop, arrays)

    def _put_sums(self, piece: Piece, start: int, stop: int, arrays: Arrays) -> None:
        """Have pixels whose samples came as sums be these: nothing else came of them.

        Args:
            start, stop: slots of the piece.
            arrays: Kind.PIXELS.
        """
        mine = np.flatnonzero((arrays["slot"] >= start) & (arrays["slot"] < stop))
        if not len(mine):
            return
        rows, within = np.divmod(arrays["slot"][mine] - start, piece.stop - piece.start)
        if within.any() or not self._comes_as_sums(piece):
            raise ProtocolError(f"a pixels batch for bucket {self.task.number} has sums of other samples than set out")
        sums = columns.download(self._sums[piece.group], (*_SUMMED, "volume"))
        for name in _SUMMED:
            put_rows(sums[name], rows, take_rows(arrays[name], mine))
        self._sums[piece.group] = columns.upload(add_samples.Sums, sums, self._replica.launcher.device)
        self._cell[self._groups[piece.group].rows[rows]] = arrays["cell"][mine]

    def _parts_in_order(self) -> Arrays:
        """All parts beyond the first surface, by slot and place, and where those of each slot begin."""
        together = concatenate(self._later, Kind.LIT)
        order = in_order(together["slot"], together["place"])
        begin = np.zeros(len(self._slots["depth"]) + 1, np.int32)
        np.bincount(together["slot"], minlength=len(begin) - 1).cumsum(dtype=np.int32, out=begin[1:])
        return {
            "begin": begin,
            "layer": parts.layer_of(together["place"], self._view.light_samples).take(order),
            "radiance": take_rows(together["radiance"], order),
        }

    def sums(self) -> dict[str, NDArray[Any]]:
        """What the samples that are in add up to, float64, shape [pixels, 3] or [pixels], and how many of them hit.

        Of pixels, each of which its own samples count in alone.
        """
        names = ("direct", "indirect", "caustic", "volume", "normal", "albedo", "depth", "hits")
        of_groups = [columns.download(sums, names) for sums in self._sums]
        if len(of_groups) == 1 and len(self._groups[0].rows) == len(self._pixels):
            return of_groups[0]
        whole: dict[str, NDArray[Any]] = columns.download(
            columns.zeros(add_samples.Sums, len(self._pixels), self._replica.launcher.device), names
        )
        for group, sums in zip(self._groups, of_groups, strict=True):
            for name in names:
                whole[name][group.rows] = sums[name]
        return whole

    def result(self) -> BucketRendered | None:
        """The bucket's pixels once all samples are in; those that take none are black."""
        if self._credit > 0 or self._waves:
            return None
        if self._splatting is None:
            sums, share = self.sums(), (1.0 / np.maximum(self._counts, 1))[:, None]
        else:
            sums, share = self._splatting.pixels(), np.ones((1, 1))
        hits = np.maximum(sums["hits"], 1)
        flat = {
            "beauty": (((sums["direct"] + sums["indirect"]) + sums["caustic"]) + sums["volume"]) * share,
            "direct": sums["direct"] * share,
            "indirect": sums["indirect"] * share,
            "caustic": sums["caustic"] * share,
            "volume": sums["volume"] * share,
            "depth": sums["depth"] / hits * self._replica.world.unit,
            "normal": sums["normal"] * share,
            "albedo": sums["albedo"] * share,
            "cell": self._window.of_bucket(self._cell),
        }
        layers = {
            name: np.ascontiguousarray(_in_single(layer).reshape(*self._shape, *layer.shape[1:]))
            for name, layer in flat.items()
            if name in layers_of(self._replica.world, self._view)
        }
        return BucketRendered(self.task.number, self.task.x0, self.task.y0, layers)

    def _batch(self, kind: Kind, cell: int, credit: int, arrays: Arrays) -> Batch:
        return Batch.of_task(kind, self.task.number, self._number, cell, credit, arrays)

    def _check_slots(self, batch: Batch) -> None:
        """Slots come over the wire: none may point outside."""
        size, slot = len(self._slots["depth"]), batch.arrays["slot"]
        if len(slot) and (slot.min() < 0 or slot.max() >= size):
            raise ProtocolError(f"a {batch.kind.value} batch has a slot outside 0 .. {size - 1}")
        if batch.kind is Kind.LIT and len(slot) and batch.arrays["place"].min() < 0:
            raise ProtocolError("a lit batch has a place below 0")


def _in_single(layer: NDArray[Any]) -> NDArray[np.float32]:
    """In single precision. A sum of light that is finite may be beyond it, and is the largest number there is then."""
    largest = np.finfo(np.float32).max
    return np.clip(layer, -largest, largest).astype(np.float32)


def _samples_of(
    window: Window, view: View, pixels: NDArray[np.int32], samples: Sequence[range]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Number of the first sample of each pixel, and how many it takes, shape [pixels]: of one image after another."""
    if samples:
        first_of = np.array([each.start for each in samples], np.int32)
        count_of = np.array([len(each) for each in samples], np.int32)
        return np.repeat(first_of, len(pixels)), np.repeat(count_of, len(pixels))
    times = view.outlines.times_of(pixels)
    if not len(view.allotment):
        return times * np.int32(view.first_sample), times * np.int32(view.spp)
    first, count = view.allotment.of_pixels(window.x0, window.y0, window.x1, window.y1)
    return times * first.reshape(-1), times * count.reshape(-1)


def _empty_slots(samples: int, light_samples: int) -> dict[str, NDArray[Any]]:
    return {
        "emission": np.zeros((samples, 3), np.float32),
        "indirect": np.zeros((samples, 3), np.float32),
        "depth": np.full(samples, -1.0, np.float32),
        "normal": np.zeros((samples, 3), np.float32),
        "albedo": np.zeros((samples, 3), np.float32),
        "cell": np.full(samples, -1, np.int32),
        "direct": np.zeros((samples * light_samples, 3), np.float32),
    }
