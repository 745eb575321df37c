"""Events of a cluster, read off what goes in and out of a master's state machine, which knows nothing of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import TypeGuard

from wdpm.cluster.cluster_events import ClusterEvent, ClusterObserver
from wdpm.cluster.master import events as m
from wdpm.cluster.messages import protocol
from wdpm.cluster.records import Records
from wdpm.cluster.task import BucketRendered, BucketTask, PhotonTask, RecordsMade, Task, TaskResult

Facts = dict[str, int | float | str]


class EventLog:
    """Tells observers what happens.

    Args:
        observers: nobody is told anything, and nothing costs time, if there are none.
    """

    def __init__(self, observers: Sequence[ClusterObserver] = ()) -> None:
        self._observers = observers
        self._numbers: dict[bytes, int] = {}
        self._begun: dict[int, tuple[str, float]] = {}

    def tell(self, event: m.Event, instructions: Iterable[m.Instruction], now: float) -> None:
        """What a state machine was told, and what it answered.

        Args:
            now: any clock that grows [s].
        """
        if not self._observers:
            return
        for happened in self._happened(event, instructions, now):
            for observer in self._observers:
                observer(happened)

    def _happened(self, event: m.Event, instructions: Iterable[m.Instruction], now: float) -> Iterator[ClusterEvent]:
        yield from self._received(event, now)
        for instruction in instructions:
            match instruction:
                case m.Send(identity, message):
                    yield from self._sent(event, identity, message, now)
                case m.Started(phase, total):
                    yield ClusterEvent("phase", {"phase": phase, "units": total})
                case m.Advanced(amount):
                    yield ClusterEvent("progress", {"units": amount})
                case m.Noted(text):
                    yield ClusterEvent("note", {"text": text})
                case m.Finished():
                    yield ClusterEvent("rendered")
                case m.Broken(reason):
                    yield ClusterEvent("broken", {"reason": reason})

    def _received(self, event: m.Event, now: float) -> Iterator[ClusterEvent]:
        match event:
            case m.SlaveSaid(identity, message) if identity in self._numbers:
                yield from self._said(self._numbers[identity], message, now)
            case m.SlaveLost(identity, reason) if identity in self._numbers:
                yield ClusterEvent("lost", {"slave": self._numbers[identity], "reason": reason})
            case m.ProcessEnded(process, reason, _):
                yield ClusterEvent("process ended", {"process": process, "reason": reason})
            case m.Begin():
                yield ClusterEvent("begun")
            case m.Close(reason, completed):
                yield ClusterEvent("closed", {"reason": reason, "completed": completed})

    def _said(
        self, slave: int, message: protocol.FromSlave | protocol.FromReader, now: float
    ) -> Iterator[ClusterEvent]:
        match message:
            case protocol.TaskDone(_, result):
                kind, begun = self._begun.pop(result.number, ("unknown", now))
                facts: Facts = {
                    "slave": slave,
                    "task": result.number,
                    "kind": kind,
                    "seconds_taken": round(now - begun, 6),
                }
                yield ClusterEvent("task done", {**facts, "bytes": _result_bytes(result)})
            case protocol.PartitionReceived(_, cell):
                yield ClusterEvent("cell received", {"slave": slave, "cell": cell})
            case protocol.Ready():
                yield ClusterEvent("ready", {"slave": slave})
            case protocol.Statistics(_, values):
                numbers = {name: value for name, value in sorted(values.items()) if _is_number(value)}
                yield ClusterEvent("statistics", {"slave": slave, **numbers})
            case protocol.Failed(reason) | protocol.Goodbye(reason):
                yield ClusterEvent("left", {"slave": slave, "reason": reason})
            case protocol.PeerGone(peer):
                yield ClusterEvent("peer gone", {"slave": slave, "peer": peer})
            case protocol.PeerUnreachable(peer, reason):
                yield ClusterEvent("peer unreachable", {"slave": slave, "peer": peer, "reason": reason})

    def _sent(
        self, event: m.Event, identity: bytes, message: protocol.FromMaster | protocol.ToReader, now: float
    ) -> Iterator[ClusterEvent]:
        match message:
            case protocol.Welcome(number):
                self._numbers[identity] = number
                yield ClusterEvent("joined", {"slave": number, **_who(event)})
            case protocol.Refuse(reason):
                yield ClusterEvent("refused", {"reason": reason, **_who(event)})
            case protocol.Partition(_, cell, part, parts, triangles):
                facts = {"slave": self._numbers.get(identity, -1), "cell": cell, "part": part, "parts": parts}
                yield ClusterEvent("cell sent", {**facts, "triangles": triangles.total, "bytes": triangles.nbytes})
            case protocol.StartTask(_, task):
                self._begun[task.number] = (_kind(task), now)
                yield ClusterEvent(
                    "task", {"slave": self._numbers.get(identity, -1), "task": task.number, "kind": _kind(task)}
                )


def _who(event: m.Event) -> dict[str, int | str]:
    """What a slave has said of itself."""
    if not isinstance(event, m.SlaveSaid) or not isinstance(event.message, protocol.Hello):
        return {}
    hello = event.message
    return {"host": hello.host, "process": hello.process, "threads": hello.threads, "memory": hello.memory}


def _is_number(value: object) -> TypeGuard[int | float]:
    return type(value) is int or (type(value) is float and math.isfinite(value))


def _kind(task: Task) -> str:
    match task:
        case PhotonTask():
            return "photons"
        case BucketTask():
            return "bucket"
        case _:
            return "records"


def _result_bytes(result: TaskResult) -> int:
    match result:
        case BucketRendered():
            return sum(layer.nbytes for layer in result.layers.values())
        case RecordsMade():
            return _bytes(result.records)
        case _:
            return 0


def _bytes(arrays: Records) -> int:
    """Of all arrays of a dataclass."""
    return sum(array.nbytes for array in vars(arrays).values())
