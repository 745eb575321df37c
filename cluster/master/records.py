"""The rounds in which a view's irradiance records are made: of each round without knowledge of each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.kept import RecordsKept
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master.homes import cells_of_pixels, home_cells
from wdpm.cluster.records import (
    GOLDEN,
    Records,
    candidate_count,
    candidates_at,
    check_records,
    equal,
    joined,
    of_rounds,
)
from wdpm.cluster.session import Session
from wdpm.cluster.task import RecordsMade, RecordTask
from wdpm.cluster.world import View
from wdpm.kernels.irradiance.record_agreement import agreeing
from wdpm.kernels.irradiance.record_clamp import clamped
from wdpm.kernels.irradiance.record_smoothing import smoothed
from wdpm.kernels.launch import ONE_THREAD, Launcher

DISAGREEMENT = 3.0
"""Standard errors of a record (CachePlan.tolerance) by which it may differ from what another expects of it: two
standard deviations of the difference of two such records. In uplight-room the floor where the table's shade ends was
10 % too dark with no bound, is 2 % too dark with 4 and right with 3, for a tenth and a fifth more records; the squared
error of cbox (128x128, 16 samples) falls to a half, by the ceiling beside the lamp."""


READ_FURTHER = 1.5
"""How far records are read once all are there, at most, as a share of the reach that they were placed by. A place that
the last round leaves out would trace one gather ray a sample, and be a pearl among what is interpolated; and where more
records tell of a place, more of their noise averages out. Only as far as they agree: beside the lamp of cbox light ends
at once."""


def _interleaved(places: NDArray[np.int32], count: int) -> list[NDArray[np.int32]]:
    """Candidates of so many tasks: of each `count` in a row every task gets one, each time beginning with another task.

    The pixels of a round lie in a grid, as do those that earlier rounds have taken: always in the same order of tasks,
    one of them would have those of some columns.
    """
    turns, left = divmod(len(places), count)
    begins = (np.arange(turns) * GOLDEN % 1.0 * count).astype(np.intp)
    by_turn = places[: turns * count].reshape(turns, count)
    out = []
    for task in range(count):
        own = by_turn[np.arange(turns), (task - begins) % count]
        # Who has one more comes first.
        out.append(np.append(own, places[turns * count + task]) if task < left else own)
    return out


class RecordRounds:
    """The rounds of a view, one after another.

    Args:
        given: records of the view that are there already, if any: then no round is made.
        kept: what an interrupted render has made of some rounds: their candidates are not asked for again.
        launcher: works out how far records reach, and smooths them, on the CPU.

    Attributes:
        records: of all rounds that have ended.
    """

    def __init__(
        self, view: View, given: Records, kept: Sequence[RecordsKept] = (), launcher: Launcher = ONE_THREAD
    ) -> None:
        self._view = view
        self._launcher = launcher
        self._round = view.cache.rounds if len(given) else 0
        self._kept = [] if len(given) else sorted(kept, key=lambda each: (each.task.round, each.task.start))
        self._made: list[RecordsMade] = [each.result for each in self._kept]
        self.records = given
        self._shared: Records | None = None
        self._agreed: tuple[int, NDArray[np.float32]] = (0, np.zeros(0, np.float32))  # of how many rounds, and radii

    @property
    def kept(self) -> int:
        """Candidates of all rounds that are done already."""
        return sum(each.task.count for each in self._kept)

    @property
    def finished(self) -> bool:
        """Whether no round is left."""
        return self._round >= self._view.cache.rounds

    @property
    def rays(self) -> int:
        """Gather rays that were shot."""
        return sum(made.rays for made in self._made)

    @property
    def rays_expected(self) -> int:
        """Gather rays of the round that is next, about: rounds have like numbers of records, once they are many."""
        candidates, rays = self._candidates(self._round), math.prod(self._view.cache.strata(self._round))
        if self._round == 0:
            return candidates * rays
        before = sum(len(made.records) for made in self._made if made.round == self._round - 1)
        return min(candidates, before) * rays

    @property
    def total(self) -> int:
        """Candidates of all rounds."""
        return sum(self._candidates(number) for number in range(self._view.cache.rounds))

    def tasks(self, slaves: int, limits: ClusterLimits, first_number: int, *, alike: bool = False) -> list[RecordTask]:
        """The tasks of the round that is next: ever smaller ones, so that all slaves end together.

        They come in batches, of one task of equal size for each slave, and each batch is the same part of what is left
        (factoring, Hummel, Schonberg & Flynn 1992): what tasks cost is nearly in proportion to their candidates, so
        slaves that begin together end together. A batch's candidates go to its tasks one by one: whether one becomes a
        record, and how many gather rays that gets, is much the same for its neighbours, which come one after another.

        Args:
            slaves: tasks that are done at once.
            alike: whether those who do them are equally fast: then batches are larger.
        """
        places = np.flatnonzero(self._open(self._candidates(self._round))).astype(np.int32)
        out: list[RecordTask] = []
        alike = alike and slaves > 1
        parts = math.ceil(limits.record_parts * slaves) if slaves > 1 else 1
        least = self._least(len(places), slaves, parts, limits)
        start = 0
        while start < len(places):
            left = len(places) - start
            equal = math.ceil(left * limits.record_even / slaves) if alike else -(-left // parts)
            size = max(equal, least)
            # No batch of some slaves alone at the end; on one machine none that is not worth it for all.
            if left - slaves * size < slaves * least * (1.0 if alike else 0.5):
                size = -(-left // slaves)
            size = min(size, limits.record_task_most)
            batch = places[start : start + slaves * size]
            count = -(-len(batch) // size)
            number = first_number + len(out)
            out += [self._task(number + index, some) for index, some in enumerate(_interleaved(batch, count))]
            start += len(batch)
        return out

    def _least(self, count: int, slaves: int, parts: int, limits: ClusterLimits) -> int:
        """Candidates of a task, at least."""
        worth = min(-(-count * limits.record_task_rays // max(self.rays_expected, 1)), -(-count // slaves))
        return max(limits.record_task_least, -(-count // (parts * limits.record_task_spread)), worth)

    def _task(self, number: int, places: NDArray[np.int32]) -> RecordTask:
        """The task of some candidates of the round that is next."""
        start, stop = int(places[0]), int(places[-1]) + 1
        whole = stop - start == len(places)
        return RecordTask(number, self._round, start, stop, np.zeros(0, np.int32) if whole else places)

    def tasks_by_cell(self, session: Session, homes: int, first_number: int) -> tuple[list[RecordTask], dict[int, int]]:
        """The tasks of the round that is next where cells of a divided scene have different holders.

        Each is of candidates that see one cell: whoever holds it has the places that gather rays set out from, and most
        of what they find. Where there are fewer homes than cells, candidates that see other cells are added.

        Args:
            homes: slaves that are home to a task of the round.

        Returns:
            the tasks, and the cell that each is about, by its number.
        """
        places = np.flatnonzero(self._open(self._candidates(self._round))).astype(np.int32)
        camera = self._view.camera
        pixels = candidates_at(camera.width, camera.height, self._view.cache, self._round, places)
        about = home_cells(cells_of_pixels(session, pixels), homes)
        most = max(-(-len(places) // homes), 1)
        out: list[RecordTask] = []
        cell_of: dict[int, int] = {}
        for cell in np.unique(about):
            own = places[about == cell]
            for some in np.array_split(own, max(round(len(own) / most), 1)):
                out.append(self._task(first_number + len(out), some))
                cell_of[out[-1].number] = int(cell)
        return out, cell_of

    def _open(self, count: int) -> NDArray[np.bool_]:
        """Which candidates of the round that is next nobody has done."""
        left = np.ones(count, np.bool_)
        for task in (each.task for each in self._kept if each.task.round == self._round):
            left[task.candidates] = False
        return left

    def put(self, task: RecordTask, result: RecordsMade) -> None:
        """Keep a task's records."""
        check_records(result.records, task.round, task.start, task.stop, task.some)
        self._made.append(result)

    def holds(self, task: RecordTask, result: RecordsMade) -> bool:
        """Whether a task's records are there, with the same bits."""
        return any(made.number == task.number and equal(made.records, result.records) for made in self._made)

    def end_round(self) -> None:
        """All tasks of the round are done."""
        self._round += 1
        self.records = joined([made.records for made in self._made if made.round < self._round])
        self._shared = None

    def shared(self) -> Records:
        """The records as slaves use them, worked out once for all."""
        if self._shared is None:
            reach = clamped(self.records.position, self._agreeing(), self._launcher)
            self._shared = replace(self.records, radius=reach)
            if self.finished:
                smooth = replace(self._shared, **smoothed(vars(self._shared), self._launcher))
                self._shared = replace(smooth, radius=self._further(smooth))
        return self._shared

    def _agreeing(self) -> NDArray[np.float32]:
        """How far records reach, as far as they agree with others. Those of the last round have no say.

        A gap that they would make is not filled any more: it would be traced sample by sample, and be noise. So how far
        the others reach is known before they come, and nobody waits for it.
        """
        radius, plan = self.records.radius.copy(), self._view.cache
        rounds = min(self._round, plan.rounds - 1)
        rows = of_rounds(self.records, rounds)
        if self._agreed[0] != rounds:
            before = vars(self.records.take(rows))
            self._agreed = rounds, agreeing(before, DISAGREEMENT * plan.tolerance, self._launcher)
        radius[rows] = self._agreed[1]
        return radius

    def _further(self, records: Records) -> NDArray[np.float32]:
        """How far records are read, by the reach that they were placed by: further, as far as they agree.

        Here those of the last round have a say as well: nothing is cut below what they left covered.
        """
        further = records.radius * np.float32(READ_FURTHER)
        tolerance = DISAGREEMENT * self._view.cache.tolerance
        agreed = agreeing({**vars(records), "radius": further}, tolerance, self._launcher)
        return np.maximum(records.radius, agreed)

    def _candidates(self, number: int) -> int:
        camera = self._view.camera
        return candidate_count(camera.width, camera.height, self._view.cache, number)
