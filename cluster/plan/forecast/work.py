"""How much a render computes where, and how many of its rays go from where to where, in seconds of one core, about.

Cells are cut by it (top_tree): so that slaves have equal work, and few rays go from one to another.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.plan.copies import PHOTON_BYTES
from wdpm.cluster.plan.forecast.sight import Sight
from wdpm.cluster.world import View, World

Places = NDArray[np.float32]

PHOTON_S = 3.3e-6
"""Of a stored photon: its path, its tree, irradiance at it, or the gathers that find it. Measured in the Cornell box,
as the next two."""

SAMPLE_S = 2.4e-6
"""Of a camera sample: its ray, its first surface, direct light there."""

GATHER_S = 1.7e-6
"""Of a gather ray of a record, half of it where it sets out and half where it arrives."""

GATHER_RAYS = 1.0
"""Gather rays a camera sample, about: those of records are from 0.5 to 2."""


@dataclass(frozen=True, eq=False)
class Work:
    """What is expected of a render.

    Attributes:
        place: where something is computed, float32, shape [N, 3].
        seconds: that it takes, shape [N].
        start, end: of rays that are a sample of all, float32, shape [R, 3].
        ray_s: that each of those stands for, if it went from one slave to another.
        triangle_bytes, photon_bytes: of memory that a triangle and a photon of those which planes are weighed by stand
            for.
    """

    place: Places
    seconds: NDArray[np.float64]
    start: Places
    end: Places
    ray_s: float
    triangle_bytes: float = 0.0
    photon_bytes: float = 0.0

    def before(self, axis: int, planes: Places) -> NDArray[np.float64]:
        """Seconds of what lies below each of some planes across an axis, shape [planes]."""
        order = np.argsort(self.place[:, axis])
        until = np.concatenate([[0.0], np.cumsum(self.seconds[order])])
        below: NDArray[np.float64] = until[self.place[order, axis].searchsorted(planes)]
        return below

    def crossing(self, axis: int, planes: Places) -> NDArray[np.float64]:
        """Seconds of rays that go through each of some planes across an axis, shape [planes]."""
        ends = np.sort([self.start[:, axis], self.end[:, axis]], axis=0)
        begun, over = np.sort(ends[0]).searchsorted(planes), np.sort(ends[1]).searchsorted(planes)
        rays: NDArray[np.float64] = (begun - over).astype(np.float64) * self.ray_s
        return rays

    def divided(self, axis: int, plane: np.float32) -> tuple[Work, Work]:
        """What lies on both sides of a plane; rays are cut at it."""
        below = self.place[:, axis] < plane
        sides = []
        for side, chosen in ((-1.0, below), (1.0, ~below)):
            start, end = _cut(self.start, self.end, axis, plane, side)
            sides.append(replace(self, place=self.place[chosen], seconds=self.seconds[chosen], start=start, end=end))
        return sides[0], sides[1]


def _cut(start: Places, end: Places, axis: int, plane: np.float32, side: float) -> tuple[Places, Places]:
    """The parts of some rays that lie on one side of a plane across an axis: below it (-1) or above (1)."""
    begins, ends = (start[:, axis] - plane) * side, (end[:, axis] - plane) * side
    touches = (begins > 0) | (ends > 0)
    start, end, begins, ends = start[touches], end[touches], begins[touches], ends[touches]
    crosses = (begins > 0) != (ends > 0)
    share = np.divide(begins, begins - ends, out=np.zeros_like(begins), where=crosses)[:, None]
    there = start + share * (end - start)
    from_there, to_there = (crosses & (begins <= 0))[:, None], (crosses & (ends <= 0))[:, None]
    return np.where(from_there, there, start), np.where(to_there, there, end)


_NOWHERE = np.empty((0, 3), np.float32)

NO_WORK = Work(_NOWHERE, np.empty(0), _NOWHERE, _NOWHERE, 0.0)
"""Where nothing is known of it: cells are cut by what they hold alone."""


def work_of(sight: Sight, photons: Places, world: World, view: View, stored: int, triangle_bytes: float) -> Work:
    """What a view asks for.

    Args:
        photons: places of a sample of them.
        stored: photons that the render will store.
        triangle_bytes: as Work has them.
    """
    seen, onward = sight.position[sight.seen], sight.seen & sight.next_seen
    samples = view.camera.width * view.camera.height * view.spp
    start, end = sight.position[onward], sight.next_position[onward]
    every = max(sight.seen.size, 1)
    gather_s = samples * GATHER_RAYS * GATHER_S / every if world.global_map.paths or view.cache.rounds else 0.0
    parts = (
        (photons, stored * PHOTON_S / max(len(photons), 1)),
        (seen, samples * SAMPLE_S / every),
        (start, gather_s / 2.0),
        (end, gather_s / 2.0),
    )
    seconds = np.concatenate([np.full(len(places), each) for places, each in parts])
    place = np.concatenate([places for places, _ in parts])
    return Work(place, seconds, start, end, gather_s, triangle_bytes, PHOTON_BYTES * stored / max(len(photons), 1))
