"""How far irradiance records are read, by what others beside them say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_worker import make_view

from wdpm.cluster.master.records import READ_FURTHER, RecordRounds
from wdpm.cluster.records import ROUND_BITS, CachePlan, Records, of_rounds

PLAN = CachePlan(rounds=3, spacing=16, rows=2, columns=6, error=0.3, least=1.0, most=9.0, wanted=0.3)
VIEW = make_view(64, 32, 16)


def test_records_of_the_last_round_shorten_no_reach() -> None:
    """Nobody would fill the gap. Those of earlier rounds do, as soon as they are there."""
    places = np.linspace(0.0, 0.5, 6)
    rounds = np.repeat(np.arange(PLAN.rounds), 2)
    light = np.where(np.arange(6) < 4, [1.0, 2.0] * 3, 9.0)
    every = Records(
        (rounds.astype(np.int64) << ROUND_BITS) + np.arange(6),
        np.stack([places, 0 * places, 0 * places], axis=1).astype(np.float32),
        np.tile(np.float32([0, 0, 1]), (6, 1)),
        np.tile(light[:, None], (1, 3)).astype(np.float32),
        np.zeros((6, 3, 3), np.float32),
        np.zeros((6, 3, 3), np.float32),
        np.zeros(6, np.float32),
        np.ones(6, np.float32),
        np.zeros(6, np.float32),
    )
    plan = replace(PLAN, tolerance=0.05)
    last = RecordRounds(replace(VIEW, cache=plan), every).shared().radius
    before = every.take(of_rounds(every, PLAN.rounds - 1))
    alone = RecordRounds(replace(VIEW, cache=plan), before).shared().radius
    assert (alone < READ_FURTHER).all()
    np.testing.assert_array_equal(last[: len(alone)], alone)
    sure = RecordRounds(replace(VIEW, cache=replace(plan, tolerance=1.0)), every).shared().radius
    np.testing.assert_array_equal(sure, READ_FURTHER)


@pytest.mark.parametrize(("light", "further"), [(1.0, READ_FURTHER), (1.3, 1.0)])
def test_records_are_read_further_than_they_were_placed_by_where_they_agree(light: float, further: float) -> None:
    """The other of the two lies just beyond the reach that they were placed by, and is of the last round."""
    place = np.zeros((2, 3), np.float32)
    place[1, 0] = 1.2
    none = np.zeros((2, 3, 3), np.float32)
    two = Records(
        np.array([0, (PLAN.rounds - 1) << ROUND_BITS], np.int64),
        place,
        np.tile(np.float32([0, 0, 1]), (2, 1)),
        np.float32([[1, 1, 1], [light, light, light]]),
        none,
        none,
        np.zeros(2, np.float32),
        np.ones(2, np.float32),
        np.zeros(2, np.float32),
    )
    view = replace(VIEW, cache=replace(PLAN, tolerance=0.02))
    np.testing.assert_array_equal(RecordRounds(view, two).shared().radius, np.float32(further))
