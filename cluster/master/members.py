"""The slaves as a master knows them: who has joined, and who may."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.messages import protocol
from wdpm.cluster.task import Task

MOST_SETBACKS = 16
"""Losses and separations of slaves in a row, without a task that is done, that a render survives."""


@dataclass(eq=False)
class Member:
    """A slave as the master knows it.

    Attributes:
        left: it has said its last word, or is known to be lost.
        done: tasks that it has done, and busy_s: how long those took, from their handing out to their results [s].
        vitals: what its process takes now, as it last said; None before.
        peak_memory: most that it has used, as it last said; 0 before [bytes].
        cells: of the scene that was set up last, those that it has built.
    """

    number: int
    identity: bytes
    hello: protocol.Hello
    heard_at: float
    left: bool = False
    cells: frozenset[int] = frozenset()
    late: bool = False
    in_flight: dict[int, Task] = field(default_factory=dict)
    statistics: dict[str, Any] = field(default_factory=dict)
    counted: dict[str, Any] = field(default_factory=dict)
    done: int = 0
    busy_s: float = 0.0
    peak_memory: int = 0
    vitals: protocol.Vitals | None = None

    def __str__(self) -> str:
        return f"slave {self.number} ({self.hello.host}, process {self.hello.process})"

    @property
    def name(self) -> str:
        """Host and process, for those who look at the image."""
        return f"{self.hello.host}, process {self.hello.process}"

    def silence(self, now: float) -> float:
        """How long nothing has been heard of it [s]."""
        return now - self.heard_at

    def news_of_silence(self, now: float, limits: ClusterLimits) -> str | None:
        """What to tell the person when it becomes late, or is no longer; None while nothing changes."""
        silence = self.silence(now)
        late, self.late = self.late, silence > limits.late_s
        if self.late == late:
            return None
        if late:
            return f"{self} is back"
        return f"{self} has been silent for {silence:.0f} s; it is waited for {limits.dead_s - silence:.0f} s more"


class Members:
    """The slaves that have joined, numbered in the order in which they did. No number is given twice.

    Args:
        expected: how many a session waits for at first ...
        most: ... and how many there may be at a time.
        versions: what they must have, by name.
        cores: of machines of which the master knows that, by name: its own.
    """

    def __init__(
        self, expected: int, most: int, versions: Mapping[str, str], cores: Mapping[str, int] | None = None
    ) -> None:
        self.expected = expected
        self.most = most
        self.cores = dict(cores or {})
        self._versions = dict(versions)
        self._all: list[Member] = []
        self._by_identity: dict[bytes, Member] = {}

    def __len__(self) -> int:
        return len(self._by_identity)

    def __iter__(self) -> Iterator[Member]:
        """Those that are there, by number."""
        return iter(sorted(self._by_identity.values(), key=lambda member: member.number))

    @property
    def ever_joined(self) -> Sequence[Member]:
        """All that ever joined, by number."""
        return self._all

    def get(self, identity: bytes) -> Member | None:
        """The slave of a connection, if it has joined and is there."""
        return self._by_identity.get(identity)

    @property
    def all_left(self) -> bool:
        """Whether none of them is expected to say anything more."""
        return all(member.left for member in self)

    def add(self, identity: bytes, hello: protocol.Hello, now: float) -> Member:
        """Let a slave join."""
        member = self._by_identity[identity] = Member(len(self._all), identity, hello, now)
        self._all.append(member)
        return member

    def expect_no_more_than(self, slaves: int) -> None:
        """No more than so many can come any more."""
        self.expected = min(self.expected, slaves)

    def lose(self, member: Member) -> None:
        """A slave is gone. If it comes back, that is another one."""
        member.left = True
        del self._by_identity[member.identity]

    def reason_to_refuse(self, hello: protocol.Hello) -> str | None:
        """Why a slave may not join, or None."""
        differing = sorted(
            name
            for name in self._versions.keys() | hello.versions.keys()
            if self._versions.get(name) != hello.versions.get(name)
        )
        if differing:
            listed = "; ".join(
                f"{name}: master {self._versions.get(name, 'none')}, slave {hello.versions.get(name, 'none')}"
                for name in differing
            )
            return f"versions differ ({listed}), so the image's bits could; install the same on both machines"
        if len(self) >= self.most:
            return f"all {self.most} slaves that this master waits for have joined"
        return None


@dataclass
class Setbacks:
    """Losses and separations of slaves since a task was done.

    Slaves that had joined before the first of them do not count: however many are lost at once, each is lost but once.

    Attributes:
        tasks_done, slaves_joined: how many there were when the first of them came.
    """

    tasks_done: int = -1
    slaves_joined: int = 0
    count: int = 0

    def add(self, tasks_done: int, slaves_joined: int, lost: Member | None) -> bool:
        """Count one more; whether these are more than a render survives.

        Args:
            tasks_done, slaves_joined: how many there have been so far.
            lost: the slave, if it is not a separation of two.
        """
        if tasks_done > self.tasks_done:
            self.tasks_done, self.slaves_joined, self.count = tasks_done, slaves_joined, 0
        self.count += lost is None or lost.number >= self.slaves_joined
        return self.count > MOST_SETBACKS
