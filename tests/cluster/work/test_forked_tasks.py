"""Tasks in forked processes: the same bits and counts, whoever is killed, and nobody is left behind."""

from __future__ import annotations

import errno
import gc
import mmap
import os
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from digests import same_bits
from one_cell import ready
from patience import WAIT_S, wait_until

from wdpm.cluster.records import CachePlan, equal
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.slave.jobs import Build, BuildMaps, Compute, ExchangeGhosts, FinishMaps, ForgetPhotons, StartTask
from wdpm.cluster.task import BucketRendered, BucketTask, PhotonTask, RecordsMade, RecordTask
from wdpm.cluster.work.processes import fork_tree
from wdpm.cluster.work.processes.forked_tasks import MOST_LOSSES, ForkedTasks, can_fork
from wdpm.cluster.work.worker import CellWorker
from wdpm.rendering.in_process import InProcess, render_in_process
from wdpm.rendering.passes import render_in_passes
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import ClusterError, GuardError

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(not can_fork("cpu"), reason="processes are forked on Linux alone"),
]

FEW = RenderSettings(photons=2000, spp=2)
SCENE = cornell_box((40, 32))
ROUND = CachePlan(rounds=1, spacing=4, rows=2, columns=4, error=0.5, least=2.0, most=40.0, wanted=0.3)
BUCKETS = [BucketTask(n, x, y, x + 8, y + 8) for n, (x, y) in enumerate((x, y) for y in (0, 8, 16) for x in (0, 8, 16))]


@pytest.fixture
def worker() -> CellWorker:
    return ready(SCENE, FEW)


@pytest.fixture
def forked(worker: CellWorker) -> Iterator[ForkedTasks]:
    tasks = ForkedTasks(worker, 3)
    yield tasks
    tasks.stop()


def begin(forked: ForkedTasks, tasks: list[BucketTask]) -> None:
    """Start tasks, and have the processes forked that they wait for."""
    for task in tasks:
        forked.start(task)
    forked._fork_for_waiting()


def processes_of(forked: ForkedTasks) -> list[int]:
    """Their numbers, once all are there."""
    wait_until(lambda: all(process.forked.pid for process in forked._processes), "processes")
    return [process.forked.pid for process in forked._processes]


def is_there(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def finish(forked: ForkedTasks) -> list[Any]:
    """All results, by number of their tasks."""
    results: list[Any] = []
    while forked.running:
        results += forked.wait(60)
    return sorted(results, key=lambda result: result.number)


def same_pixels(one: list[BucketRendered], other: list[BucketRendered]) -> bool:
    return all(
        a.layers.keys() == b.layers.keys() and all(np.array_equal(a.layers[n], b.layers[n]) for n in a.layers)
        for a, b in zip(one, other, strict=True)
    )


def test_results_are_those_of_the_worker_itself(worker: CellWorker, forked: ForkedTasks) -> None:
    for task in BUCKETS:
        forked.start(task)
    found = finish(forked)
    assert [result.number for result in found] == list(range(len(BUCKETS)))
    assert same_pixels(found, [worker.start(task).results[0] for task in BUCKETS])


def test_counts_come_to_the_worker(worker: CellWorker, forked: ForkedTasks) -> None:
    alone = ready(SCENE, FEW)
    for each in (worker, alone):
        each.start(PhotonTask(len(BUCKETS), 0, FEW.photons))
        each.exchange_ghosts()
        each.build_maps()
        each.finish_maps()
    for task in BUCKETS:
        forked.start(task)
        alone.start(task)
    finish(forked)
    forked.stop()
    mine, theirs = worker.statistics(), alone.statistics()
    for name in ("gathers", "gathers_truncated", "photons", "guards"):
        assert mine[name] == theirs[name], name
    assert mine["gathers_truncated"] > 0


def test_photons_are_traced_by_the_worker_itself_and_no_process_is_forked_for_them() -> None:
    worker, alone = ready(SCENE, FEW), ready(SCENE, FEW)
    worker.replica.launcher.threads = 3
    forked = ForkedTasks(worker, 3)
    compute = Compute(lambda *_: worker, lambda _: forked)
    compute.start(Build(0, worker.replica.world, {}, (0,)))
    for number in range(3):
        task = PhotonTask(number, 500 * number, 500 * (number + 1))
        outcome = compute.start(StartTask(task))
        assert outcome is not None
        assert outcome.results == alone.start(task).results
    assert not processes_of(forked)
    mine, other = (one.cells[0].store for one in (worker, alone))
    ids = [np.sort(store.so_far()["id"]) for store in (mine, other)]
    assert len(ids[0]) > 0
    assert np.array_equal(*ids)
    assert mine._points_ahead is not None  # their trees are built meanwhile
    for job in (ExchangeGhosts(), BuildMaps(), FinishMaps()):
        compute.start(job)
    alone.exchange_ghosts()
    alone.build_maps()
    alone.finish_maps()
    assert mine._points_ahead is None
    assert mine.points[0].count > 0
    for name in ("leaves", "nodes"):
        np.testing.assert_array_equal(*(getattr(store.points[0], name).numpy() for store in (mine, other)))


def test_points_that_were_begun_with_are_let_go_of_with_the_photons() -> None:
    worker = ready(SCENE, FEW)
    worker.replica.launcher.threads = 2
    for paths in (500, 700):
        worker.begin_points()
        worker.start(PhotonTask(paths, 0, paths))
        worker.forget_photons()
    assert worker.cells[0].store._points_ahead is None
    worker.begin_points()
    worker.start(PhotonTask(0, 0, 500))
    worker.exchange_ghosts()
    worker.build_maps()
    once = ready(SCENE, FEW)
    once.start(PhotonTask(0, 0, 500))
    once.exchange_ghosts()
    once.build_maps()
    assert worker.cells[0].store.points[0].count == once.cells[0].store.points[0].count > 0


def test_processes_end_when_photons_are_forgotten_that_they_know() -> None:
    worker = ready(SCENE, FEW)
    forked = ForkedTasks(worker, 2)
    compute = Compute(lambda *_: worker, lambda _: forked)
    compute.start(Build(0, worker.replica.world, {}, (0,)))
    assert compute.start(StartTask(BUCKETS[0])) is None
    forked._fork_for_waiting()
    assert len(processes_of(forked)) == 1
    while compute.under_way:
        compute.wait(60)
    compute.start(ForgetPhotons(replace(worker.replica.world.photon_plan, seed=7)))
    assert not processes_of(forked)
    compute.stop()


def test_processes_follow_the_worker_to_another_view_and_other_records() -> None:
    worker = ready(SCENE, replace(FEW, indirect=Indirect.CACHE))
    forked = ForkedTasks(worker, 2)
    forked.start(BUCKETS[0])
    finish(forked)
    pids = processes_of(forked)
    assert worker.replica.view is not None
    turned = replace(worker.replica.view, seed=3, cache=ROUND)
    forked.set_view(turned)
    worker.set_view(turned)
    made: list[RecordsMade] = [worker.start(RecordTask(0, 0, 0, 40)).results[0]]  # type: ignore[list-item]
    forked.start(RecordTask(0, 0, 0, 40))
    assert equal(finish(forked)[0].records, made[0].records)
    assert len(made[0].records) > 10
    before = worker.start(BUCKETS[4]).results
    forked.set_records(made[0].records)
    worker.set_records(made[0].records)
    counted = worker.statistics()["final_gather_interpolated"]
    forked.start(BUCKETS[4])
    found = finish(forked)
    assert worker.statistics()["final_gather_interpolated"] > counted
    assert same_pixels(found, worker.start(BUCKETS[4]).results)  # type: ignore[arg-type]
    assert not same_pixels(found, before)  # type: ignore[arg-type]
    assert processes_of(forked) == pids
    forked.stop()


def test_a_process_that_was_killed_before_a_change_is_replaced_by_one_that_knows_it(
    worker: CellWorker, forked: ForkedTasks
) -> None:
    forked.start(BUCKETS[0])
    finish(forked)
    for pid in processes_of(forked):
        os.kill(pid, signal.SIGKILL)
    assert worker.replica.view is not None
    view = replace(worker.replica.view, seed=5)
    forked.set_view(view)
    worker.set_view(view)
    forked.start(BUCKETS[1])
    assert same_pixels(finish(forked), worker.start(BUCKETS[1]).results)  # type: ignore[arg-type]


def test_no_process_is_left_when_nobody_holds_them_any_more(worker: CellWorker) -> None:
    forked = ForkedTasks(worker, 2)
    begin(forked, BUCKETS[:1])
    pids = processes_of(forked)
    assert all(map(is_there, pids))
    del forked
    gc.collect()
    assert not any(map(is_there, pids))


def test_no_task_waits_for_one_process_while_another_is_idle(forked: ForkedTasks) -> None:
    begin(forked, BUCKETS)
    assert forked.running == len(BUCKETS)
    assert [process.task for process in forked._processes] == BUCKETS[:3]
    left = len(BUCKETS)
    while left > 3:
        left -= len(forked.wait(60))
        at_work = {process.task.number for process in forked._processes if process.task is not None}
        assert len(at_work) == min(3, left)
    finish(forked)


def test_what_a_worker_had_before_stays_and_is_not_told_again(worker: CellWorker, forked: ForkedTasks) -> None:
    worker.start(PhotonTask(0, 0, 500))
    before = worker.statistics()["photons"][0]
    forked.start(BUCKETS[0])
    finish(forked)
    assert worker.statistics()["photons"][0] == before > 0


@pytest.mark.parametrize("victims", [1, MOST_LOSSES])
def test_tasks_of_killed_processes_are_done_again(worker: CellWorker, forked: ForkedTasks, victims: int) -> None:
    expected = [worker.start(task).results[0] for task in BUCKETS]
    begin(forked, BUCKETS)
    for pid in processes_of(forked)[:victims]:
        os.kill(pid, signal.SIGKILL)
    assert same_pixels(finish(forked), expected)


def test_processes_that_are_killed_again_and_again_end_the_render(forked: ForkedTasks) -> None:
    begin(forked, BUCKETS[:1])

    def kill_all() -> None:
        while True:
            for pid in processes_of(forked):
                os.kill(pid, signal.SIGKILL)
            forked.wait(60)

    with pytest.raises(ClusterError, match=r"end again and again \(killed by signal 9\)"):
        kill_all()


def allow(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let this process and those that are forked from it fork so many together."""
    left = mmap.mmap(-1, 1)
    left[0] = count

    def counted(fork: Callable[..., int]) -> Callable[..., int]:
        def fork_if_allowed(*arguments: int) -> int:
            if not left[0]:
                raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
            left[0] -= 1
            return fork(*arguments)

        return fork_if_allowed

    monkeypatch.setattr(os, "fork", counted(os.fork))
    monkeypatch.setattr(fork_tree, "fork_sibling", counted(fork_tree.fork_sibling))


@pytest.mark.parametrize("allowed", [0, 1, 2])
def test_a_system_that_allows_few_processes_or_none(
    allowed: int, worker: CellWorker, forked: ForkedTasks, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = [worker.start(task).results[0] for task in BUCKETS]
    allow(allowed, monkeypatch)
    begin(forked, BUCKETS)
    if allowed == 2:  # and no other can take the place of one that is lost
        os.kill(forked._processes[0].forked.pid, signal.SIGKILL)
    assert same_pixels(finish(forked), expected)


def test_what_a_task_raises_is_raised(worker: CellWorker) -> None:
    def refuse(*_: object) -> None:
        raise GuardError("strict: this is not to be")

    worker.start = refuse  # type: ignore[method-assign,assignment]
    forked = ForkedTasks(worker, 2)
    forked.start(BUCKETS[0])
    with pytest.raises(GuardError, match="this is not to be"):
        finish(forked)
    forked.stop()


def test_a_fault_tells_where_it_was(worker: CellWorker) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("by nothing")

    worker.start = fail  # type: ignore[method-assign,assignment]
    forked = ForkedTasks(worker, 2)
    forked.start(BUCKETS[0])
    with pytest.raises(RuntimeError, match="ZeroDivisionError: by nothing") as caught:
        finish(forked)
    assert "in fail" in caught.value.__notes__[0]
    forked.stop()


def test_as_many_processes_are_forked_as_there_are_tasks_for(forked: ForkedTasks) -> None:
    """One that is idle is handed a task before another is forked."""
    begin(forked, BUCKETS[:2])
    assert [process.task for process in forked._processes] == BUCKETS[:2]
    first = processes_of(forked)
    finish(forked)
    assert processes_of(forked) == first
    begin(forked, BUCKETS[2:5])
    assert len(processes_of(forked)) == 3
    assert processes_of(forked)[:2] == first
    begin(forked, BUCKETS[5:6])
    assert len(processes_of(forked)) == 3
    finish(forked)


def test_no_process_is_left_when_they_are_stopped(forked: ForkedTasks) -> None:
    begin(forked, BUCKETS[:3])
    pids = processes_of(forked)
    finish(forked)
    assert len(pids) == 3
    assert all(map(is_there, pids))
    forked.stop()
    assert not any(map(is_there, pids))


def test_no_process_is_left_when_the_render_is_given_up(forked: ForkedTasks) -> None:
    begin(forked, BUCKETS)
    pids = processes_of(forked)
    forked.stop()
    assert not any(map(is_there, pids))


def test_renders_of_several_threads_do_not_wait_for_each_others_end(worker: CellWorker, forked: ForkedTasks) -> None:
    """Processes of the one have copies of the other's streams, and know nothing of them."""
    begin(forked, BUCKETS[:3])
    pids = processes_of(forked)
    finish(forked)
    other = ForkedTasks(worker, 2)
    begin(other, BUCKETS[:2])
    finish(other)
    stopping = threading.Thread(target=forked.stop, daemon=True)
    stopping.start()
    stopping.join(WAIT_S)
    still_there = stopping.is_alive()
    other.stop()
    assert not still_there
    assert not any(map(is_there, pids))


def test_a_fork_of_the_whole_program_ends_no_process(forked: ForkedTasks) -> None:
    begin(forked, BUCKETS[:3])
    pids = processes_of(forked)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        copy = os.fork()
    if copy == 0:
        try:
            forked.stop()
        finally:
            os._exit(0)
    os.waitpid(copy, 0)
    results = finish(forked)
    assert sorted(result.number for result in results) == [0, 1, 2]
    assert processes_of(forked) == pids


def test_the_report_counts_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """But for what depends on who did how much: times, traffic, memory, and the last digits of sums of flux."""
    monkeypatch.setattr("wdpm.rendering.in_process.WORTH_FORKING", 0)
    one, several = (render_in_process(SCENE, FEW, workers=1, threads=threads) for threads in (1, 3))
    assert same_bits(one, several)
    reports = [image.metadata["report"] for image in (one, several)]
    for name in ("gathers", "gathers_truncated", "vertices", "beams", "guards", "nonfinite", "warnings", "triangles"):
        assert reports[0][name] == reports[1][name], name
    assert reports[0]["photons"]["stored"] == reports[1]["photons"]["stored"]
    for name, value in reports[0]["energy"].items():
        assert reports[1]["energy"][name] == pytest.approx(value, rel=1e-9, abs=1e-12), name


def test_no_process_is_left_when_a_render_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even while the backend lives on: processes end with what they render, and live on from pass to pass."""
    monkeypatch.setattr("wdpm.rendering.in_process.WORTH_FORKING", 0)
    forked: list[int] = []
    fork = ForkedTasks._fork

    def noted(self: ForkedTasks, count: int) -> bool:
        all_there = fork(self, count)
        forked.extend(processes_of(self)[-count:])
        return all_there

    monkeypatch.setattr(ForkedTasks, "_fork", noted)
    with InProcess(threads=2) as backend:
        render_in_passes(SCENE, backend, replace(FEW, passes=2))
        assert not any(map(is_there, forked))
    assert len(forked) == 2 * 2  # two each time for what reads the maps, which end when another pass begins


KILLED = """
import os, sys, threading, time
from wdpm.cluster.work.processes import forked_tasks
fork = forked_tasks.ForkedTasks._fork
def noted(self, count):
    all_there = fork(self, count)
    for process in self._processes:
        while not process.forked.pid:
            time.sleep(0.001)
        print(process.forked.pid, flush=True)
    return all_there
forked_tasks.ForkedTasks._fork = noted
import wdpm
from wdpm.quiet import quiet_warp
quiet_warp()
wdpm.render("cornell-box", spp=4096, photons=2000, threads=3)
"""


def test_forked_processes_end_with_their_parent(tmp_path: Path) -> None:
    """Even if it is killed, and cannot say so."""
    with subprocess.Popen([sys.executable, "-c", KILLED], stdout=subprocess.PIPE, text=True, cwd=tmp_path) as parent:
        assert parent.stdout is not None
        pids = [int(parent.stdout.readline()) for _ in range(3)]
        assert all(map(is_there, pids))
        parent.kill()
    wait_until(lambda: not any(map(is_there, pids)), "their end")


def test_no_process_forks_that_has_used_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    """Used by whatever part of the process; a GPU that is there and unused is no hindrance."""
    gpus = [SimpleNamespace(has_context=False), SimpleNamespace(has_context=False)]
    monkeypatch.setattr(wp, "get_cuda_devices", lambda: gpus)
    assert can_fork("cpu")
    assert not can_fork("cuda:0")
    gpus[1].has_context = True
    assert not can_fork("cpu")


def test_processes_that_are_let_go_end_by_themselves_and_are_waited_for_before_others_are_forked(
    forked: ForkedTasks,
) -> None:
    begin(forked, BUCKETS)
    before = processes_of(forked)
    forked.let_go()  # some are at a task
    assert not processes_of(forked)
    assert forked.running == 0
    begin(forked, BUCKETS[:1])
    assert not any(map(is_there, before))
    assert len(finish(forked)) == 1
    last = processes_of(forked)
    forked.let_go()
    forked.stop()
    assert not any(map(is_there, last))
