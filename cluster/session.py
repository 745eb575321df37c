"""What a master is asked to render, and what it answers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.kept import NOTHING_KEPT, Kept
from wdpm.cluster.layers import LAYERS
from wdpm.cluster.records import NO_RECORDS, Records
from wdpm.cluster.task import PhotonsTraced
from wdpm.cluster.world import View, World
from wdpm.scenes.flat.arrays import Triangles


@dataclass(frozen=True, eq=False)
class Session:
    """One render.

    Attributes:
        world: what photons depend on.
        view: what the camera adds.
        partition: cell -> the triangles that overlap it. Called for every slave that is to hold the cell and has it not
            from a session before.
        burdens: what each cell weighs, to share cells out among slaves.
        digest: names triangles, cells and the world but for its photon plan; equal digests mean that cells can be
            used again, and photons too where the plan is equal.
        team_size: slaves that have room for the whole scene among them: so many make a team (master.teams) ...
        room: ... of those that have room for so much, besides their process [bytes].
        retrace: trace the photons again even if the cluster has them.
        layers: name of layer -> channels.
        records: irradiance records that are there already; none are made then.
        kept: what of it an interrupted render has done, for a view with buckets of the same side.
        places: of a sample of the photons, float32, shape [P, 3]: how they lie in space.
        sight: the cell that pixels of a grid over the image see first, -1 for none, int32, shape [rows, columns];
            [0, 0] where nobody has looked.
    """

    world: World
    view: View
    partition: Callable[[int], Triangles]
    burdens: tuple[float, ...]
    digest: str
    team_size: int = 1
    room: float = -math.inf
    retrace: bool = False
    layers: Mapping[str, int] = field(default_factory=lambda: LAYERS)
    records: Records = NO_RECORDS
    kept: Kept = NOTHING_KEPT
    places: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 3), np.float32))
    sight: NDArray[np.int32] = field(default_factory=lambda: np.empty((0, 0), np.int32))

    @property
    def cells(self) -> int:
        """How many cells the scene is divided into."""
        return self.world.top_tree.cells

    @property
    def is_divided(self) -> bool:
        """Whether there are several, so that work in one may need slaves that hold others."""
        return self.cells > 1


@dataclass(frozen=True, eq=False)
class SessionResult:
    """A finished render.

    Attributes:
        layers: name of layer -> float32, shape [height, width, 3] or [height, width].
        statistics: of each slave that was there at the end, with its number as `slave`.
        photons_traced: of each photon task, in the order of their paths. From the session that traced them, if they
            were reused.
        counted: of all photons in the maps, each once, also of those that lost slaves have stored, by name
            (master.statistics).
        seconds: wall-clock time by phase [s]: partition, photons, map, render. A phase that was skipped is missing.
        dropped: messages that were not used, by reason.
        records: irradiance records, those that were there already included.
        record_rays: gather rays that were shot for them.
        lost: slaves that were lost, whose statistics are missing.
        unheard: slaves whose statistics are missing, as they were still at tasks that others were faster with.
        went_on: whether some of it was done before an interruption, of which statistics are missing.
    """

    layers: dict[str, NDArray[np.float32]]
    statistics: list[dict[str, Any]]
    photons_traced: tuple[PhotonsTraced, ...]
    counted: dict[str, Any]
    seconds: dict[str, float]
    dropped: dict[str, int]
    records: Records = NO_RECORDS
    record_rays: int = 0
    lost: tuple[str, ...] = ()
    unheard: tuple[str, ...] = ()
    went_on: bool = False

    @property
    def paths(self) -> int:
        """Photon paths shot."""
        return sum(traced.paths for traced in self.photons_traced)

    @property
    def emitted(self) -> float:
        """Flux that the paths set out with, mean of RGB, summed [W x paths]."""
        return math.fsum(traced.emitted for traced in self.photons_traced)
