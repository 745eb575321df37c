"""Camera paths that one launch follows as far as their cell reaches, where it is one of several.

Vertex by vertex, each step of a path is a launch of its own, and what it found is written down, sorted and read again.
Here a path is followed to its end, or to where it leaves the cell: what leaves it, rays, hits and shadow rays, are
batches as ever, and so is what comes home. The bits are the same, as those of samples that are followed whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.work.whole.launches import Counts, TraceLaunches, sum_of
from wdpm.kernels import columns
from wdpm.kernels.camera import vertices
from wdpm.kernels.limits import RAY_SAMPLES
from wdpm.kernels.whole_samples import indirect_light, leaving

GRAIN = 256
"""Paths below which handing a chunk of them to another thread costs more than it saves."""

FEW_TO_FOLLOW = 1 << 13
"""Rays that come by a cell and are followed in the order in which they came. So few would find little more in the
processor's caches in the order of what they meet, and a launch and a batch that this takes cost more."""

MOST_KEPT = 1 << 16
"""Paths of a chunk whose lists are kept for the next launch: twice as many as come at once as a rule."""

ROOM_VERTICES = 2
"""Vertices of each path that lists have room for, before paths go on in another launch. Pages that nothing is written
to are no memory."""


class FollowedPaths(NamedTuple):
    """What came of paths that were followed.

    Attributes:
        parts: Kind.LIT, and `whose`: the number of the path, ascending.
        shots, paths: Kind.SHADOW and Kind.PATH, `whose` and `onward` (kernels.whole_samples.leaving). Those of camera
            rays that left before they had a vertex have no bounce.
        gathered: Kind.GATHERED, and `whose`: gather rays of records of which nothing has left the cell.
        first, pixels: Kind.SAMPLES, but for the cell, and Kind.PIXELS, and `whose`: of camera rays; else nothing.
        counts: what they did.
    """

    parts: Arrays
    shots: Arrays
    paths: Arrays
    gathered: Arrays
    first: Arrays
    pixels: Arrays
    counts: Counts


class WithinCell:
    """Follows paths in one cell.

    Args:
        cell: its number.
    """

    def __init__(self, cell: int, launches: TraceLaunches) -> None:
        self._cell = cell
        self._launches = launches
        self._lists: dict[int, tuple[dict[str, int], Any]] = {}  # by number of the chunk: their room, and themselves

    def begin_view(self) -> None:
        """Let go of lists of the view before."""
        self._lists.clear()

    @property
    def can_be(self) -> bool:
        """Whether paths can be followed here, with the same bits.

        Where one cell is all, samples are followed from the camera on, or guards are to count what happens. Gathers
        that may leave the overlap band are counted one by one, elsewhere.
        """
        world = self._launches.replica.world
        if world.top_tree.cells == 1 or not self._launches.can_be:
            return False
        return all(plan.band >= plan.radius for plan in world.maps)

    def follow(
        self, paths: Any, count: int, *, first: bool, visits: bool = False, together: NDArray[np.int32] | None = None
    ) -> FollowedPaths | None:
        """Follow paths until they end, or leave the cell.

        Args:
            paths: with final hits in it.
            first: whether these are camera rays (kernels.camera.rays.Rays); else paths that have left a first vertex
                (kernels.camera.paths.Paths).
            visits: whether they are on their way through it instead, with their best hits so far.
            together: which may come home as one sum: kernels.ray_fields.START; None for none.

        Returns:
            what came of them; None where something happened that guards count: then it is to be found vertex by vertex.
        """
        replica, device = self._launches.replica, self._launches.replica.launcher.device
        shots = int(vertices.SHOTS_LATER)
        if first and replica.view is not None:
            shots = replica.view.light_samples
        chunks: list[tuple[int, Any]] = []

        def room_for(start: int, size: int) -> dict[str, Any]:
            rows = {
                "parts": ROOM_VERTICES * size * (shots + leaving.PARTS_A_VERTEX),
                "shots": ROOM_VERTICES * size * shots,
                "paths": size,
                "first": size if first else 0,
                "gathered": 0 if first else size,
                "pixels": 0 if together is None else (size + 1) // 2,
            }
            made = self._lists_for(len(chunks), rows, device)
            chunks.append((start, made))
            return {"leaving_out": made}

        notes = self._launches.launch(
            count,
            GRAIN,
            room_for,
            shots=shots,
            **{"camera_rays" if first else "paths": paths},
            **({} if together is None else {"together": columns.array_over(together, wp.int32, device)}),
            cell=self._cell,
            visits=int(visits),
            start=RAY_SAMPLES,
        )
        counts = sum_of(notes)
        if counts[indirect_light.SPOILT]:
            return None

        def told_of(name: str, number: int) -> Arrays:
            pieces = zip(chunks, notes, strict=True)
            return _joined([_written(getattr(made, name), start, int(each[number])) for (start, made), each in pieces])

        parts, left_shots, left_paths = (told_of(name, number) for name, number in _LISTS.items())
        gathered = {} if first else told_of("gathered", int(indirect_light.RAYS_GATHERED))
        of_first = told_of("first", int(indirect_light.SEEN)) if first else {}
        pixels = {} if together is None else told_of("pixels", int(indirect_light.PIXELS_DONE))
        return FollowedPaths(parts, left_shots, left_paths, gathered, of_first, pixels, counts)

    def _lists_for(self, chunk: int, rows: dict[str, int], device: str) -> Any:
        """Lists with room for so many items at least (kernels.whole_samples.leaving.Leaving), of no particular value.

        Those of the launch before, where they are long enough: what is written there has been copied. Most of a list
        stays empty, but memory that is new costs as much as if it were full: the system clears it by megabytes.

        Args:
            chunk: number of the chunk among those that run at once.
        """
        room, kept = self._lists.get(chunk, ({}, None))
        if kept is not None and all(room[name] >= count for name, count in rows.items()):
            return kept
        if rows["paths"] > MOST_KEPT:
            return columns.empty_nested(leaving.Leaving, rows, device)
        room = {name: max(count, room.get(name, 0)) for name, count in rows.items()}
        self._lists[chunk] = room, columns.empty_nested(leaving.Leaving, room, device)
        return self._lists[chunk][1]


_LISTS = {
    "parts": int(indirect_light.TOLD),
    "shots": int(indirect_light.SHOTS_LEFT),
    "paths": int(indirect_light.PATHS_LEFT),
}
"""Of kernels.whole_samples.leaving.Leaving, those that all have, and what counts their items."""


def _written(items: Any, start: int, count: int) -> Arrays:
    """The items of a list that there are.

    Args:
        start: number of the chunk's first path.
    """
    arrays = {name: column[:count].copy() for name, column in _all_of(items).items()}
    if start:
        arrays["whose"] = arrays["whose"] + np.int32(start)
    return arrays


def _all_of(items: Any) -> Arrays:
    return columns.download(items, items.of_struct.vars)


def _joined(parts: Sequence[Arrays]) -> Arrays:
    """Arrays of several chunks, one after another."""
    if len(parts) == 1:
        return parts[0]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
