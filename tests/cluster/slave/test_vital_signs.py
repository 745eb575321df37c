"""What a slave tells of its process."""

from __future__ import annotations

import time

import numpy as np
import pytest

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


def test_memory_and_cores_are_those_of_the_process() -> None:
    signs = VitalSigns(Carried(), time.monotonic())
    before = signs.due(time.monotonic() + TELL_S)
    held = np.ones(64 << 20, np.uint8)
    until = time.process_time() + 0.2
    while time.process_time() < until:
        pass
    after = signs.due(time.monotonic() + 2 * TELL_S)
    assert before is not None
    assert after is not None
    assert after.memory - before.memory > 0.8 * held.nbytes
    assert after.cores == pytest.approx(0.2 / TELL_S, rel=0.5)
