"""Launches of kernels over the cores of one machine.

Warp runs a CPU launch on one core but releases the interpreter's lock, so a launch is cut into chunks that a thread
pool runs at once. Every kernel that is launched here takes `offset`, the number of its first item.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import warp as wp

from wdpm.kernels.quick_launch import launch
from wdpm.kernels.stacks import allow_stacks

GRAIN = 2048
"""Items below which handing a chunk of ordinary work to another thread costs more than it saves: a launch takes some
50 us of the interpreter's time, an item a few tens of nanoseconds at least."""

CHUNKS_A_THREAD = 3
"""Chunks a thread: more even out their lengths, fewer cost less."""


@functools.cache
def arguments_of(kernel: wp.Kernel) -> tuple[tuple[str, ...], frozenset[str]]:
    """The names of a kernel's arguments, in order, and those of them that whoever launches it gives."""
    names = tuple(argument.label for argument in kernel.adj.args)
    return names, frozenset(names) - {"offset"}


class Launcher:
    """Runs kernels on one device with a number of threads.

    Args:
        device: a Warp device name, "cpu" or "cuda:0".
        threads: cores to use on the CPU; None for all. On CUDA a launch is never cut.
        wait_for_kernels: whether a scene's own kernels are compiled before it is rendered; else kernels with all
            effects stand in for those that are not compiled (kernels/stand_ins.py).

    Raises:
        MachineError: the system allows stacks that are too small for kernels.
    """

    def __init__(self, device: str = "cpu", threads: int | None = None, *, wait_for_kernels: bool = True) -> None:
        allow_stacks()
        self.device = device
        self.wait_for_kernels = wait_for_kernels
        self.threads = max(1, threads or os.cpu_count() or 1) if device == "cpu" else 1
        self._executor: ThreadPoolExecutor | None = None

    @property
    def _pool(self) -> ThreadPoolExecutor | None:
        """Threads, from the first launch that is cut until `stop_threads`."""
        if self._executor is None and self.threads > 1:
            self._executor = ThreadPoolExecutor(self.threads)
        return self._executor

    def stop_threads(self) -> None:
        """End all threads, so that the process may fork; the next launch starts others."""
        if self._executor is not None:
            self._executor.shutdown()
            self._executor = None

    def use_one_thread(self) -> None:
        """Launch on the calling thread alone from here on: in a forked process, which is one of several."""
        self._executor = None
        self.threads = 1

    def chunks(self, count: int, grain: int = GRAIN) -> list[tuple[int, int]]:
        """How `count` items are cut: (start, size) of each chunk, of at least `grain` items where there are several."""
        if count == 0:
            return []
        parts = 1 if self.threads == 1 else max(1, min(CHUNKS_A_THREAD * self.threads, count // grain))
        size = -(-count // parts)
        return [(start, min(size, count - start)) for start in range(0, count, size)]

    def __call__(self, kernel: wp.Kernel, count: int, /, *, grain: int = GRAIN, **arguments: Any) -> None:
        """Run `kernel` for items 0 to count - 1.

        Args:
            grain: items that are worth a chunk of their own.
            arguments: of the kernel, by name, all but `offset`.

        Raises:
            TypeError: these are not the kernel's arguments.
        """
        names, expected = arguments_of(kernel)
        if arguments.keys() != expected:
            missing, unknown = sorted(expected - arguments.keys()), sorted(arguments.keys() - expected)
            raise TypeError(f"kernel {kernel.key}: arguments missing: {missing}, not known: {unknown}")
        launches = []
        for start, size in self.chunks(count, grain):
            arguments["offset"] = start
            launches.append((size, [arguments[name] for name in names]))
        self.run(kernel, launches)

    def build_launcher(self) -> Callable[..., None] | None:
        """For trees, which are built on the CPU: launches whose items are subtrees, each worth a chunk of its own.

        None where there is but one thread for them.
        """
        if self.threads == 1:
            return None

        def launch_cut(kernel: wp.Kernel, count: int, inputs: Sequence[Any], outputs: Sequence[Any] = ()) -> None:
            self.run(kernel, [(size, [*inputs, start, *outputs]) for start, size in self.chunks(count, grain=1)])

        return launch_cut

    @property
    def run_on_host(self) -> Callable[[wp.Kernel, Sequence[tuple[int, Sequence[Any]]]], None]:
        """As `run`, but on the CPU, wherever else kernels run: for trees, which are built there."""
        return self.run if self.device == "cpu" else ONE_THREAD.run

    def at_once(self, *makers: Callable[[], Any]) -> list[Any]:
        """What several functions give that have nothing to do with each other, in their order; raises what one raises.

        Each runs on a thread of its own, from which it may launch, where launches have several: what the interpreter
        and NumPy do between launches on one core overlaps with the others' then.
        """
        if self.threads == 1 or len(makers) == 1:
            return [make() for make in makers]
        _ = self._pool  # before several ask for it at once
        with ThreadPoolExecutor(len(makers) - 1) as others:
            futures = [others.submit(make) for make in makers[1:]]
            return [makers[0](), *(future.result() for future in futures)]

    def begin(self, make: Callable[[], Any]) -> Future[Any]:
        """Run a function on a thread of its own, from which it may launch, and go on.

        Whoever begins it waits for its end before the process forks.
        """
        _ = self._pool  # before two ask for it at once
        with_thread = ThreadPoolExecutor(1)
        begun = with_thread.submit(make)
        with_thread.shutdown(wait=False)
        return begun

    def run(self, kernel: wp.Kernel, launches: Sequence[tuple[int, Sequence[Any]]]) -> None:
        """Run several launches of one kernel, at once where there are threads, and wait for all."""
        pool = None if len(launches) == 1 else self._pool
        if pool is None:
            for size, inputs in launches:
                launch(kernel, size, inputs, self.device)
        else:
            share_out(pool, self.threads, lambda size, inputs: launch(kernel, size, inputs, self.device), launches)
        if self.device != "cpu":
            wp.synchronize_device(self.device)


def share_out(
    pool: ThreadPoolExecutor,
    threads: int,
    do: Callable[[int, Sequence[Any]], None],
    launches: Sequence[tuple[int, Sequence[Any]]],
) -> None:
    """Do several launches on this thread and others of a pool, so many in all, each the next whenever it is free.

    A thread is told once, not for each launch: that takes the interpreter some 10 us, and there are thrice as many.
    Waits for all; raises what one of them raises.
    """
    waiting = iter(launches)

    def work() -> None:
        for size, inputs in waiting:
            do(size, inputs)

    others = [pool.submit(work) for _ in range(min(threads, len(launches)) - 1)]
    try:
        work()
    finally:
        for other in others:
            if not other.cancel():  # one that has not begun has nothing left to do
                other.result()


ONE_THREAD = Launcher("cpu", 1)
"""Launches on the calling thread."""
