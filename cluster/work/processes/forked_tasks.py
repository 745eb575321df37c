"""Tasks of one worker done by several processes, forked from it: all cores of a machine for one copy of the scene.

A forked process has the worker's cells, trees, maps and compiled kernels for nothing: the operating system copies a
page only when it is written. It does the tasks that it is handed, and answers each with the task's result and its
*share*: what the worker counted meanwhile, which the parent adds to its own. So a process that is killed takes no more
with it than the task it was at, and that is done again. What is small and changes often (the view, irradiance records)
the processes are told, and change as the worker does. Where more is asked of the worker than that (photons and their
maps), they end first, and the next task forks others.

Nothing is left behind, whoever is killed: streams are socket pairs without a name, a process ends when its parent
does, and all end with the object that started them.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import selectors
import signal
import sys
import time
import traceback
import weakref
from collections import deque
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import warp as wp

from wdpm.cluster.host_memory import PrivateMemory, keep_free_memory, return_free_memory
from wdpm.cluster.messages import packing, protocol, shares
from wdpm.cluster.messages.frames import Frame
from wdpm.cluster.records import Records
from wdpm.cluster.task import Task, TaskResult
from wdpm.cluster.transport import stream
from wdpm.cluster.work.processes.fork_tree import Forked, fork_tree
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import View
from wdpm.scenes import errors
from wdpm.scenes.errors import ClusterError, WdpmError

MOST_LOSSES = 3
"""Processes that may be killed before the render ends: what kills so many will kill the next as well."""

_PR_SET_PDEATHSIG = 1  # linux/prctl.h

_FROM_SHARE = packing.by_name(shares.FromShare)
_Change = protocol.SetView | protocol.SetRecords
"""What processes are told of the worker's changes, as slaves are. Epochs are 0: nothing is ever late here."""

_FROM_PARENT = packing.by_name(protocol.StartTask | _Change)


def can_fork(device: str) -> bool:
    """Whether this process may be forked now, to compute on a device.

    Not once it has used CUDA for anything, whose state and threads do not survive a fork. On macOS frameworks of the
    system start threads that do not either, and Windows has no fork.
    """
    may = sys.platform == "linux" and hasattr(os, "fork")
    return device == "cpu" and may and not any(gpu.has_context for gpu in wp.get_cuda_devices())


class TaskObserver(Protocol):
    """Is told what becomes of tasks, by the thread that starts them."""

    def forked(self, count: int, cpu_s: float) -> None:
        """So many processes have been forked together, or soon will be; that took this thread so long [CPU s]."""

    def handed_out(self, number: int) -> None:
        """A process has a task."""

    def done(self, number: int, cpu_s: float) -> None:
        """It is done, and took a process so long, with what that was told before [CPU s]."""


@dataclass(eq=False)
class _Process:
    """A forked process, and what its parent has it do."""

    forked: Forked
    task: Task | None = None
    private_bytes: int = 0


class ForkedTasks:
    """Starts tasks of a worker in processes: one in each, while others wait here for whichever process is done first.

    Args:
        worker: has all cells, so that its tasks need nobody else.
        processes: how many, at least 1.
        observer: is told of tasks that processes do.
    """

    def __init__(self, worker: CellWorker, processes: int, observer: TaskObserver | None = None) -> None:
        self._worker = worker
        self._observer = observer
        self._count = processes
        self._processes: list[_Process] = []
        self._ending: list[_Process] = []  # told to end, and not waited for: that takes some ten milliseconds
        self._waiting: deque[Task] = deque()
        self._selector = selectors.DefaultSelector()
        self._losses = 0
        self._parent = os.getpid()
        weakref.finalize(self, _end, self._processes, self._ending, self._parent)

    @property
    def running(self) -> int:
        """Tasks that are not done."""
        return len(self._waiting) + sum(process.task is not None for process in self._processes)

    def start(self, task: Task) -> None:
        """Have a task done after those that were started before, by a process that is idle; else see `wait`."""
        self._waiting.append(task)
        for process in self._processes:
            self._hand_next(process)

    def wait(self, seconds: float | None = None) -> list[TaskResult]:
        """Results that have come; waits for one, for so long at most.

        Where tasks wait for processes that are not there yet, it has these forked first: together, as that takes less
        time, so not before all is started that is to be.

        Raises:
            WdpmError: what a task raised.
            ClusterError: processes were killed, again and again.
        """
        self._fork_for_waiting()
        if not self._processes and self._waiting:
            return list(self._worker.start(self._waiting.popleft()).results)
        results: list[TaskResult] = []
        for key, _ in self._selector.select(seconds):
            process: _Process = key.data
            frames = stream.receive(process.forked.stream)
            if frames is None:
                self._lose(process)
            else:
                process.task = None
                self._hand_next(process)  # before all else, since it waits
                results.append(self._take(process, frames))
        return results

    def set_view(self, view: View) -> None:
        """The worker will look through a camera; so will the processes. None may be at a task, here and below."""
        self._tell(protocol.SetView(0, view))

    def set_records(self, records: Records) -> None:
        """The worker will have these irradiance records in place of those before; so will the processes."""
        self._tell(protocol.SetRecords(0, records))

    def stop(self) -> None:
        """End the processes, whatever they are at; the worker may change then. May be called again."""
        self.let_go()
        _end(self._processes, self._ending, self._parent)

    def let_go(self) -> None:
        """As `stop`, but what is at no task may end while the worker changes."""
        self._waiting.clear()
        if os.getpid() != self._parent:  # a program's own fork has a copy of this, and no processes
            return
        _tell_to_end(self._processes)
        self._ending.extend(self._processes)
        self._processes.clear()
        self._selector.close()
        self._selector = selectors.DefaultSelector()

    # The parent's side.

    def _fork_for_waiting(self) -> None:
        """Give tasks that wait to other processes, or to those that there are where the system allows no more of them.

        A container may have a limit of processes, or be short of memory. Where there is none, `wait` does the tasks.
        """
        wanted = min(len(self._waiting), self._count - len(self._processes))
        if wanted > 0 and not self._fork(wanted):
            self._count = len(self._processes)
        for process in self._processes:
            self._hand_next(process)

    def _fork(self, count: int) -> bool:
        """Fork so many processes; whether all are there or on their way."""
        if not self._processes:
            _end([], self._ending, os.getpid())
            return_free_memory()  # or each process would copy what lies in pages that are free as soon as it uses one
        self._worker.replica.launcher.stop_threads()
        gc.freeze()  # so that the collector's marks do not copy the pages of all objects into each process
        try:
            serve, others = partial(_serve, self._worker, os.getpid()), [each.forked.stream for each in self._processes]
            began = time.thread_time()
            forked = fork_tree(count, serve, others)
            if self._observer is not None:
                self._observer.forked(len(forked), time.thread_time() - began)
        except OSError:
            return False
        finally:
            gc.unfreeze()
        for each in forked:
            process = _Process(each)
            self._processes.append(process)
            self._selector.register(each.stream, selectors.EVENT_READ, process)
        return len(forked) == count

    def _hand_next(self, process: _Process) -> None:
        """Hand a process that is at no task the next one, if there is one."""
        if process.task is None and self._waiting:
            process.task = self._waiting.popleft()
            _send(process, packing.encode(protocol.StartTask(0, process.task)))
            if self._observer is not None:
                self._observer.handed_out(process.task.number)

    def _tell(self, change: _Change) -> None:
        if self._processes:
            frames = packing.encode(change)
            for process in self._processes:
                _send(process, frames)

    def _take(self, process: _Process, frames: list[Frame]) -> TaskResult:
        """The result of a task; its share goes to the worker."""
        answer: shares.FromShare = packing.decode(frames, _FROM_SHARE)
        if isinstance(answer, shares.TaskFailed):
            raise _error_of(answer)
        process.private_bytes = answer.private_bytes
        together = sum(process.private_bytes for process in self._processes)
        self._worker.add_share(answer.counted["values"], together)
        if self._observer is not None:
            self._observer.done(answer.result.number, answer.cpu_s)
        return answer.result

    def _lose(self, lost: _Process) -> None:
        """Have the task of a process that is gone done by another one."""
        self._processes.remove(lost)
        self._selector.unregister(lost.forked.stream)
        lost.forked.stream.close()
        if lost.forked.pid:
            _, status = os.waitpid(lost.forked.pid, 0)
            self._losses += 1
            if self._losses > MOST_LOSSES:
                raise ClusterError(
                    f"processes of this render end again and again ({_in_words(status)}); if memory is short, use "
                    "fewer --threads, photons or triangles"
                )
        if lost.task is not None:
            self._waiting.appendleft(lost.task)
        self._fork_for_waiting()


def _send(process: _Process, frames: list[Frame]) -> None:
    """If it is gone, `wait` finds that out, and another one, forked of the worker as it is then, gets its task."""
    with contextlib.suppress(OSError):
        stream.send(process.forked.stream, frames)


def _end(processes: list[_Process], ending: list[_Process], parent: int) -> None:
    """End all of these processes, if this is the one that forked them, and wait until they have.

    Args:
        ending: those that have been told to.
    """
    if os.getpid() != parent:
        return
    _tell_to_end(processes)
    for process in (*ending, *processes):  # whoever forks others comes before them, so it is known by then who is there
        if process.forked.pid:
            _kill_at_task(process)
            os.waitpid(process.forked.pid, 0)
    processes.clear()
    ending.clear()


def _tell_to_end(processes: list[_Process]) -> None:
    for process in processes:
        stream.end(process.forked.stream)  # closed alone, it would stay open in what others have forked meanwhile
        if process.forked.pid:
            _kill_at_task(process)


def _kill_at_task(process: _Process) -> None:
    if process.task is not None:
        os.kill(process.forked.pid, signal.SIGKILL)


def _in_words(status: int) -> str:
    if os.WIFSIGNALED(status):
        return f"killed by signal {os.WTERMSIG(status)}"
    return f"exit code {os.waitstatus_to_exitcode(status)}"


def _error_of(failed: shares.TaskFailed) -> BaseException:
    """What a task raised, as this process raises it."""
    kind = getattr(errors, failed.kind, None)
    if isinstance(kind, type) and issubclass(kind, WdpmError):
        return kind(failed.text)
    if failed.kind == MemoryError.__name__:
        return MemoryError(failed.text)
    fault = RuntimeError(f"{failed.kind}: {failed.text}")
    fault.add_note(f"It was raised in a forked process:\n{failed.trace}")
    return fault


# The forked process's side.


def _serve(worker: CellWorker, parent_pid: int, parent: stream.Stream) -> None:
    """Do tasks until the parent closes the stream, or ends."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent_pid:
        return
    told = time.process_time()
    keep_free_memory()  # its tasks are alike
    worker.become_share()
    memory = PrivateMemory()
    with contextlib.suppress(OSError):  # if the parent is gone
        while (frames := stream.receive(parent)) is not None:
            order: protocol.StartTask | _Change = packing.decode(frames, _FROM_PARENT)
            if isinstance(order, protocol.StartTask):
                answer = _answer(worker, order.task, memory, told)
                told = time.process_time()
                stream.send(parent, packing.encode(answer))
            else:
                _change(worker, order)


def _change(worker: CellWorker, change: _Change) -> None:
    """Change as the parent's worker does, which counts what that takes."""
    match change:
        case protocol.SetView(_, view):
            worker.set_view(view)
        case protocol.SetRecords(_, records):
            worker.set_records(records)
    worker.take_share()


def _answer(worker: CellWorker, task: Task, memory: PrivateMemory, told: float) -> shares.FromShare:
    """What the parent is told when a task is done, or has failed.

    Args:
        told: when it was told last, by the process's CPU time [s].
    """
    try:
        outbox = worker.start(task)
        if outbox.batches or len(outbox.results) != 1:
            raise AssertionError(f"task {task.number} was not done by itself")
        counted, private_bytes = {"values": worker.take_share()}, memory.bytes()
        return shares.TaskShared(outbox.results[0], counted, private_bytes, time.process_time() - told)
    except Exception as error:
        return shares.TaskFailed(type(error).__name__, str(error), traceback.format_exc())
