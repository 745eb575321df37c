"""The thread on which a slave computes, so that heartbeats go on during long kernels."""

from __future__ import annotations

import queue
import threading
import time
import traceback

from wdpm.cluster.slave import events as s
from wdpm.cluster.slave.jobs import Compute, Job
from wdpm.cluster.transport.mailbox import Mailbox
from wdpm.scenes.errors import MachineError, WdpmError, is_of_files, is_of_memory

LEAVE_S = 1.0
"""How long a slave that ends waits for the worker's last job."""

NO_MEMORY = "it has not enough memory; use more slaves, or fewer photons or triangles"
"""Why a slave leaves."""

NO_FILES = "no more files and sockets can be opened on its machine"
"""The same."""


class ComputeThread:
    """Runs jobs one after another; what came of each is an event in the mailbox.

    Args:
        compute: is used by the thread alone.
    """

    def __init__(self, compute: Compute) -> None:
        self.mailbox = Mailbox()
        self._compute = compute
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="wdpm compute", daemon=True)
        self._leaving = threading.Lock()
        self._ended = self._left_behind = False

    def start(self) -> None:
        """Begin to wait for jobs."""
        self._thread.start()

    def submit(self, job: Job) -> None:
        """Run a job after all others."""
        self._jobs.put(job)

    def stop(self) -> None:
        """End after the job that runs, and wait a moment for that."""
        self._jobs.put(None)
        self._thread.join(LEAVE_S)
        # A long kernel or a compilation cannot be interrupted. It is left behind, to die with the process: whoever ends
        # last closes the mailbox.
        with self._leaving:
            self._left_behind = not self._ended
            if self._ended:
                self.mailbox.close()

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            self.mailbox.put(self.run_here(job))
        with self._leaving:
            self._ended = True
            if self._left_behind:
                self.mailbox.close()

    def run_here(self, job: Job) -> s.Computed | s.ComputeFailed | s.Leave:
        """Run a job on the calling thread; while the one here is at none."""
        try:
            began = time.thread_time()
            outcome = self._compute.run(job)
            return s.Computed(outcome, time.thread_time() - began)
        except Exception as error:
            if (unfit := why_unfit(error)) is not None:
                return s.Leave(unfit)
            if isinstance(error, WdpmError):
                return s.ComputeFailed(str(error))
            # A fault of the program: its place goes to the log here, one line to the master.
            traceback.print_exc()
            return s.ComputeFailed(f"{type(error).__name__} in {type(job).__name__}: {error}")


def why_unfit(error: Exception) -> str | None:
    """Why this machine cannot go on, if that is what an error tells: another one may be fit."""
    if isinstance(error, MachineError):
        return str(error)
    if is_of_memory(error):
        return NO_MEMORY
    return NO_FILES if is_of_files(error) else None
