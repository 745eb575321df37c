"""A cluster that stays up over many renders while its slaves are struck: each render begins with all slaves, anew."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Self

from slaves import SlaveProcess, Slaves, cpu_here
from trials import Configuration, digest_of, scene_of

from wdpm.cluster.cluster_events import ClusterEvent
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.session import Session, SessionResult
from wdpm.clusters import Cluster
from wdpm.progress import Progress
from wdpm.rendering.prepare import Prepared

SLAVES = 4
TINY = {"photons": 500, "caustic_photons": 300, "volume_photons": 300, "spp": 1, "passes": 1}

LOOK_S = 0.2
"""Between two looks at whether processes have ended [s]."""

JOIN_S = 120.0
"""How long slaves that were started may take to join [s]."""


class Hung(RuntimeError):
    """A render, or a slave that was to join, did not come to an end."""


class Deadline:
    """Ends a render that takes too long.

    Args:
        seconds: from now on.
    """

    def __init__(self, seconds: float) -> None:
        self._over = time.monotonic() + seconds
        self._seconds = seconds
        self._phase = "before its first phase"

    def start(self, phase: str, total: int | None = None) -> None:  # noqa: ARG002 - a Progress
        self._phase = f"in phase {phase}"
        self.advance(0)

    def advance(self, amount: int = 1) -> None:  # noqa: ARG002
        if time.monotonic() > self._over:
            raise Hung(f"not rendered within {self._seconds:g} s, {self._phase}")

    def note(self, text: str) -> None: ...

    def finish(self) -> None: ...


class AnewCluster(Cluster):
    """Has every render begin anew: without cells and photons of the one before."""

    renders = 0

    def run(self, prepared: Prepared, session: Session, progress: Progress) -> SessionResult:
        """Render a session whose digest no other render has."""
        return super().run(prepared, replace(session, digest=f"{session.digest}/{self.renders}"), progress)


@dataclass
class Watcher:
    """Knows who is in the cluster, by what an observer is told.

    Attributes:
        there: number of a slave -> its process.
        redone: tasks that were handed out again after the master had their result.
    """

    slaves: Slaves | None = None
    there: dict[int, int] = field(default_factory=dict)
    redone: int = 0
    _done: set[int] = field(default_factory=set)
    _answered: int | None = None
    changed: threading.Condition = field(default_factory=threading.Condition)

    def __call__(self, event: ClusterEvent) -> None:
        facts = event.facts
        with self.changed:
            answered, self._answered = self._answered, None
            match event.name:
                case "joined":
                    self.there[int(facts["slave"])] = int(facts["process"])
                case "lost" | "left":
                    self.there.pop(int(facts["slave"]), None)
                case "ready" if self.slaves is not None and int(facts["slave"]) in self.there:
                    self.slaves.ready(self.there[int(facts["slave"])])
                case "task done":
                    self._answered = int(facts["task"])
                case "progress" if answered is not None:  # at once: the result was taken
                    self._done.add(answered)
                case "task" if facts["kind"] != "photons" and int(facts["task"]) in self._done:
                    self.redone += 1
            self.changed.notify_all()

    def begin(self) -> None:
        """A render begins."""
        with self.changed:
            self.redone, self._done, self._answered = 0, set(), None


@dataclass(frozen=True)
class Outcome:
    """Of one render: its bits, and what it took [s]."""

    digest: str
    seconds: float
    cpu_s: float
    start_up_s: float
    redone: int


class StandingCluster:
    """A master in this process and slaves in others.

    Args:
        link: what the slaves' connections suffer, as options of linked_slave.py; None for plain connections.
        slaves: how many there are when a render begins.
    """

    def __init__(self, link: Sequence[str] | None = None, slaves: int = SLAVES) -> None:
        self._count = slaves
        self._stack = ExitStack()
        self._watcher = Watcher()
        self._cluster = AnewCluster.listen(
            "tcp://127.0.0.1:0", slaves, most=2 * slaves, join_timeout=JOIN_S, observers=[self._watcher]
        )
        self._stack.callback(self._cluster.close)
        self.slaves = self._watcher.slaves = Slaves(self._cluster.endpoint, link)
        self._stack.callback(self.slaves.end)
        self._warm: list[SlaveProcess] = []

    def complete(self) -> None:
        """Have as many slaves as there should be, all of them joined; one that was told to leave takes a while."""
        watcher, until = self._watcher, time.monotonic() + JOIN_S
        while time.monotonic() < until:
            alive = self.slaves.alive
            for _ in range(self._count - len(alive)):
                self.slaves.start()
            with watcher.changed:
                if len(alive) == self._count and set(watcher.there.values()) == {slave.number for slave in alive}:
                    return
                watcher.changed.wait(LOOK_S)
        raise Hung(f"slaves did not all join within {JOIN_S:g} s; there are {watcher.there} of {self.slaves.alive}")

    def warm_up(self, what: Configuration) -> None:
        """Have new slaves load the kernels of a configuration, by a tiny render: that is part of their start."""
        if self.slaves.all != self._warm:
            self._cluster._copies = Copies(what.copies)
            tiny = {**what.chosen, **TINY}
            self._cluster.render(scene_of(what.scene, (12, 12)), progress=Deadline(JOIN_S), **tiny)
            self._warm = list(self.slaves.all)

    def render(self, what: Configuration, longest: float) -> Outcome:
        """Render from the beginning.

        Raises:
            Hung: it took longer than that [s].
        """
        self._cluster._copies = Copies(what.copies)
        self._cluster.renders += 1
        self._watcher.begin()
        before, starts_before, began = self.cost(), self.slaves.cost()[1], time.monotonic()
        image = self._cluster.render(scene_of(what.scene), progress=Deadline(longest), **what.chosen)
        seconds, starts = time.monotonic() - began, self.slaves.cost()[1] - starts_before
        return Outcome(digest_of(image), seconds, self.cost() - before - starts, starts, self._watcher.redone)

    def cost(self) -> float:
        """CPU time of all processes so far [s]."""
        return cpu_here() + self.slaves.cost()[0]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()
