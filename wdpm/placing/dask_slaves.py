"""Slaves on the workers of a Dask cluster: one on each, as long as fewer run than are wanted.

Each slave is a task that is bound to one worker. When a worker is lost its task is let go, and the one that Dask starts
in its place, like any that joins later, gets a task of its own. So no task ever loses a second worker, and what Dask
allows of that (`distributed.scheduler.allowed-failures`) is never used up.
"""

from __future__ import annotations

import queue
import threading
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

from distributed.comm import get_address_host

from wdpm.cluster.master.events import NotComing, StillAwaited
from wdpm.placing.dask_task import Order, kill, serve
from wdpm.placing.own_address import address_towards, listening_address, reached_at
from wdpm.scenes.errors import ClusterError, SettingsError

LOOK_S = 1.0
"""Between one look at the workers and the next [s]."""

GRACE_S = 5.0
"""How long slaves get to end by themselves before they are killed [s]."""

NO_WORKERS = (
    "Dask has no workers so far; a cluster that adapts starts none for slaves, which are bound to workers: give adapt "
    "a minimum, or call scale"
)

MOST_FAILURES = 3
"""Of slaves on one worker, without the worker being lost: another slave would fare alike."""


class DaskSlaves:
    """Keeps slaves on Dask's workers.

    Args:
        client: a `distributed.Client`; not asynchronous.
        most: slaves at a time.
        device: that they compute on.

    Raises:
        SettingsError: the client is asynchronous, or something else.

    Attributes:
        listen_at: where the master has to listen so that they reach it.
    """

    def __init__(self, client: Any, most: int, device: str = "cpu") -> None:
        if getattr(client, "asynchronous", True):
            raise SettingsError("on_dask needs a distributed.Client that is not asynchronous")
        self._client = client
        self._most = most
        self._device = device
        self._run = uuid.uuid4().hex[:12]
        self._count = 0
        self._placed: dict[str, tuple[Order, Any]] = {}  # by address of the worker: what it was given, and its future
        self._failures: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}  # why the last slave on a worker ended
        self._given_up: set[str] = set()
        self._news: queue.SimpleQueue[NotComing | StillAwaited] = queue.SimpleQueue()
        self._complete = False
        self._said_none = False
        self._error: ClusterError | None = None
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._number = address_towards(self._hosts())
        self.listen_at = listening_address(self._number)

    def workers(self) -> list[str]:
        """Addresses of the workers that are there now."""
        return sorted(self._client.nthreads())

    def start(self, endpoint: str, keys: Callable[[], bytes]) -> None:
        """Begin to place slaves."""
        reached = reached_at(self._number, endpoint)
        self._thread = threading.Thread(target=self._keep, args=(reached, keys), name="wdpm on Dask", daemon=True)
        self._thread.start()

    def ended(self) -> Iterable[NotComing | StillAwaited]:
        """Workers on which none runs, and that there are none, since this was last asked. The master sees who is lost.

        Raises:
            ClusterError: no slave can be placed any more.
        """
        if self._error is not None:
            raise self._error
        while not self._news.empty():
            yield self._news.get()

    def all_joined(self) -> None:
        """From now on nobody waits for any of them."""
        self._complete = True

    def no_more(self) -> None:
        """Place no more slaves: the master is about to tell those that are there to stop."""
        self._stopping.set()

    def stop(self) -> None:
        """Wait for the slaves to end, kill those that do not; the client stays open."""
        self.no_more()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        deadline = time.monotonic() + GRACE_S
        while time.monotonic() < deadline and self._running():
            time.sleep(0.05)
        late = self._running()
        if late:
            there = set(self.workers())
            self._client.run(kill, [order.name for order, _ in late.values()], workers=sorted(there.intersection(late)))
        for _, future in self._placed.values():
            future.release()
        self._placed = {}

    def _hosts(self) -> list[str]:
        """Machines of the workers, and of the scheduler: the master has to be reached from there."""
        addresses = [*self.workers(), self._client.scheduler.address]
        return [get_address_host(address) for address in addresses if not address.startswith("inproc://")]

    def _running(self) -> dict[str, tuple[Order, Any]]:
        return {worker: placed for worker, placed in self._placed.items() if not placed[1].done()}

    def _keep(self, endpoint: str, keys: Callable[[], bytes]) -> None:
        try:
            while not self._stopping.is_set():
                self._look(endpoint, keys)
                self._stopping.wait(LOOK_S)
        except Exception as error:  # of any kind that Dask raises: whoever waits for slaves must hear of it
            self._error = ClusterError(f"Dask's scheduler cannot be asked for workers: {type(error).__name__}: {error}")

    def _look(self, endpoint: str, keys: Callable[[], bytes]) -> None:
        workers = self.workers()
        if not (workers or self._complete or self._said_none):
            self._said_none = True
            self._news.put(StillAwaited(NO_WORKERS))
        lost = [worker for worker in self._placed if worker not in workers]
        for worker in lost:
            _, future = self._placed.pop(worker)
            future.cancel()  # it would wait for this worker for ever
        for worker, (_, future) in list(self._placed.items()):
            if future.done():
                del self._placed[worker]
                self._failures[worker] += 1
                self._reasons[worker] = f"{worker}: {_why(future)}"
        usable = [worker for worker in workers if self._failures[worker] < MOST_FAILURES]
        left = min(len(usable), self._most)
        for worker in lost:
            self._go_without(f"{worker} is lost", left)  # one that comes in its place joins late
        for worker in sorted({*workers} - {*usable} - self._given_up):
            self._given_up.add(worker)
            if not left:
                self._error = ClusterError(f"a slave cannot run on a worker of Dask: {self._reasons[worker]}")
            self._go_without(f"no slave runs on {self._reasons[worker]}", left)
        for worker in usable:
            if worker not in self._placed and len(self._placed) < self._most and not self._stopping.is_set():
                self._placed[worker] = self._place(worker, endpoint, keys())

    def _go_without(self, reason: str, left: int) -> None:
        """A slave that is waited for does not come: others begin, if there are any.

        Args:
            left: slaves that run on other workers, or will.
        """
        if left and not self._complete:
            self._news.put(NotComing(reason, left))

    def _place(self, worker: str, endpoint: str, keys: bytes) -> tuple[Order, Any]:
        self._count += 1
        order = Order(f"wdpm-slave-{self._run}-{self._count}", endpoint, keys, self._device)
        future = self._client.submit(
            serve, order, key=order.name, workers=[worker], allow_other_workers=False, pure=False
        )
        return order, future


def _why(future: Any) -> str:
    """Why a task ended, in one line."""
    if future.status == "finished":
        return str(future.result())
    if future.status != "error":
        return f"the task was {future.status}"
    error = future.exception()
    return f"{type(error).__name__}: {error}".partition("\n")[0]
