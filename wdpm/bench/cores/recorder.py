"""What a render in this process is made of, as it happens: time of its one thread, of launches, of tasks elsewhere."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Any

import warp as wp

from wdpm.bench.cores.schedule import Alone, Phase, Render
from wdpm.cluster.work.processes.fork_tree import forks_of_the_first
from wdpm.cluster.work.processes.sibling import can_fork_siblings
from wdpm.kernels.launch import Launcher, share_out
from wdpm.kernels.quick_launch import launch


class Recorder:
    """Is told of tasks (it is a forked_tasks.TaskObserver), and of launches that were cut for threads.

    It belongs to the thread that makes it, and renders.
    """

    def __init__(self) -> None:
        self._render = Render()
        self._order: dict[int, float | None] = {}  # tasks of a phase, as they were handed out: their time once done
        self._processes = self._forked = 0
        self._fork_s = 0.0
        self._launches: list[tuple[float, ...]] = []
        self._chunks_here_s = 0.0
        self._thread_s, self._process_s = time.thread_time(), time.process_time()

    def end(self) -> Render:
        """The render, once it has ended; another one may follow, of processes of its own."""
        self._end_alone()
        render, self._render, self._processes = self._render, Render(), 0
        return render

    def launched(self, chunks: Sequence[float], here_s: float) -> None:
        """A launch was cut into chunks, which took so long each [CPU s].

        Args:
            here_s: those of them that this thread did, together [CPU s].
        """
        self._launches.append(tuple(chunks))
        self._chunks_here_s += here_s

    def forked(self, count: int, cpu_s: float) -> None:
        """See TaskObserver."""
        if not self._order:
            self._end_alone(cpu_s)
        self._forked += count
        self._fork_s = cpu_s / max(1, forks_of_the_first(count))

    def handed_out(self, number: int) -> None:
        """See TaskObserver."""
        if not self._order and not self._forked:
            self._end_alone()
        self._order[number] = None

    def done(self, number: int, cpu_s: float) -> None:
        """See TaskObserver."""
        self._order[number] = cpu_s
        if None not in self._order.values():
            self._end_phase()

    def _end_alone(self, fork_s: float = 0.0) -> None:
        """What was done since is the first process's alone; but for forks, which are a phase's."""
        thread, process = self._took()
        beside = max(0.0, process - thread - sum(map(sum, self._launches)) + self._chunks_here_s)
        alone = max(0.0, thread - fork_s - self._chunks_here_s)
        self._render.parts.append(Alone(alone, tuple(self._launches), beside))
        self._launches, self._chunks_here_s = [], 0.0

    def _end_phase(self) -> None:
        tasks = tuple(cpu_s for cpu_s in self._order.values() if cpu_s is not None)
        _, process = self._took()
        forks = (self._processes, self._forked, self._fork_s, can_fork_siblings())
        self._render.parts.append(Phase(tasks, *forks, first_process=process))
        self._processes += self._forked
        self._forked, self._fork_s, self._order = 0, 0.0, {}
        self._launches, self._chunks_here_s = [], 0.0

    def _took(self) -> tuple[float, float]:
        """CPU time of this thread, and of all threads of this process, since this was last asked [s]."""
        before = self._thread_s, self._process_s
        self._thread_s, self._process_s = time.thread_time(), time.process_time()
        return self._thread_s - before[0], self._process_s - before[1]


class TimedLauncher(Launcher):
    """Launches on the CPU, and tells how long the chunks take of those that the recorder's thread has cut for threads.

    What other threads launch meanwhile is not on the path of that one.
    """

    def __init__(self, threads: int, recorder: Recorder) -> None:
        super().__init__("cpu", threads)
        self._recorder = recorder
        self._owner = threading.get_ident()

    def run(self, kernel: wp.Kernel, launches: Sequence[tuple[int, Sequence[Any]]]) -> None:
        pool = None if len(launches) == 1 or threading.get_ident() != self._owner else self._pool
        if pool is None:
            super().run(kernel, launches)
            return

        here: list[float] = []
        elsewhere: list[float] = []

        def timed(size: int, inputs: Sequence[Any]) -> None:
            began = time.thread_time()
            launch(kernel, size, inputs, self.device)
            (here if threading.get_ident() == self._owner else elsewhere).append(time.thread_time() - began)

        share_out(pool, self.threads, timed, launches)
        self._recorder.launched([*here, *elsewhere], sum(here))
