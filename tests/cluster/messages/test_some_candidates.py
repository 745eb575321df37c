"""A task of some candidates of a round: what comes over the wire is a list of them, within its range."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.cluster.messages import packing
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.task import RecordTask
from wdpm.scenes.errors import ProtocolError


def over_the_wire(*some: int) -> RecordTask:
    frames = packing.encode(p.StartTask(1, RecordTask(0, 0, 2, 9, np.array(some, np.int32))))
    task: RecordTask = packing.decode(frames, {"StartTask": p.StartTask}).task
    return task


@pytest.mark.parametrize(
    ("some", "reason"), [((1, 4), "outside its range"), ((4, 9), "outside"), ((4, 4), "ascending")]
)
def test_candidates_that_cannot_be_are_refused(some: tuple[int, ...], reason: str) -> None:
    with pytest.raises(ProtocolError, match=reason):
        over_the_wire(*some)


def test_a_table_of_candidates_is_refused() -> None:
    frames = packing.encode(p.StartTask(1, RecordTask(0, 0, 2, 9, np.array([[4]], np.int32))))
    with pytest.raises(ProtocolError, match="candidates that are no list"):
        packing.decode(frames, {"StartTask": p.StartTask})


@pytest.mark.parametrize(("some", "meant"), [((2, 8), [2, 8]), ((), list(range(2, 9)))])
def test_some_are_meant_or_all(some: tuple[int, ...], meant: list[int]) -> None:
    task = over_the_wire(*some)
    assert task.candidates.tolist() == meant
    assert task.count == len(meant)
