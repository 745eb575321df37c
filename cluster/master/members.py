"""The slaves as a master knows them: who has joined, and who may."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from wdpm.cluster.messages import protocol
from wdpm.cluster.task import Task


@dataclass(eq=False)
class Member:
    """A slave as the master knows it."""

    number: int
    identity: bytes
    hello: protocol.Hello
    heard_at: float
    left: bool = False
    in_flight: dict[int, Task] = field(default_factory=dict)
    statistics: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"slave {self.number} ({self.hello.host}, process {self.hello.process})"


class Members:
    """The slaves that have joined, numbered in the order in which they did.

    Args:
        expected: how many may.
        versions: what they must have, by name.
    """

    def __init__(self, expected: int, versions: Mapping[str, str]) -> None:
        self.expected = expected
        self._versions = dict(versions)
        self._by_identity: dict[bytes, Member] = {}

    def __len__(self) -> int:
        return len(self._by_identity)

    def __iter__(self) -> Iterator[Member]:
        """By number: nobody ever leaves."""
        return iter(self._by_identity.values())

    def get(self, identity: bytes) -> Member | None:
        """The slave of a connection, if it has joined."""
        return self._by_identity.get(identity)

    @property
    def all_left(self) -> bool:
        """Whether none of them is expected to say anything more."""
        return all(member.left for member in self)

    def number(self, number: int) -> Member:
        """The slave of this number."""
        return list(self)[number]

    def add(self, identity: bytes, hello: protocol.Hello, now: float) -> Member:
        """Let a slave join."""
        member = self._by_identity[identity] = Member(len(self), identity, hello, now)
        return member

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
        if len(self) >= self.expected:
            return f"all {self.expected} slaves that this master waits for have joined"
        return None
