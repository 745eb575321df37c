"""What a slave tells of its process."""

from __future__ import annotations

import os

import pytest

from wdpm.cluster.host_memory import memory_in_use
from wdpm.cluster.messages.protocol import Vitals
from wdpm.cluster.slave import vital_signs
from wdpm.cluster.slave.vital_signs import TELL_S, VitalSigns
from wdpm.cluster.transport.transport import Carried


def test_rates_are_of_the_time_since_the_last_word() -> None:
    carried = Carried(1000, 500)
    signs = VitalSigns(carried, 10.0)
    carried.sent, carried.received = 5000, 500
    assert signs.due(10.0 + TELL_S / 2) is None
    told = signs.due(14.0)
    assert told is not None
    assert (told.sent, told.received) == (1000.0, 0.0)
    assert signs.due(14.0 + TELL_S / 2) is None


def test_memory_and_cores_are_those_of_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the system tells them, whatever work costs there: the cores are its seconds since the last word."""
    times, memory = [1.0, 0.5, 2.0, 0.25, 1000.0], [3 << 20]
    monkeypatch.setattr(vital_signs.os, "times", lambda: tuple(times))
    monkeypatch.setattr(vital_signs, "memory_in_use", lambda: memory[0])
    signs = VitalSigns(Carried(), 100.0)
    times[:] = [1.25, 0.75, 3.0, 0.25, 2000.0]  # of itself and of ended children; the last is no time of a processor
    told = signs.due(100.0 + 2 * TELL_S)
    assert told == Vitals(3 << 20, 1.5 / (2 * TELL_S), 0.0, 0.0)
    memory[0] = 1 << 20
    told = signs.due(100.0 + 3 * TELL_S)
    assert told == Vitals(1 << 20, 0.0, 0.0, 0.0)


def test_the_system_tells_of_this_process() -> None:
    least = sum(os.times()[:4])
    assert least <= vital_signs._cpu_s() <= sum(os.times()[:4])
    assert memory_in_use() > 0
