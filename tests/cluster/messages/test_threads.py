"""Threads of one process, which pack and unpack a kind of message for the first time together, agree on its fields."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
from fake_worker import make_world

from wdpm.cluster.messages import packing
from wdpm.cluster.messages import protocol as p

ALL = packing.by_name(p.Message)
THREADS = 8


@pytest.fixture
def busy_switching() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("busy_switching")
def test_threads_may_meet_a_message_first_together() -> None:
    message = p.Setup(1, make_world(1), (0,), ("",))
    expected = [bytes(frame) for frame in packing.encode(message)]

    def both_ways(gate: threading.Barrier) -> list[bytes]:
        gate.wait()
        return [bytes(frame) for frame in packing.encode(packing.decode(expected, ALL))]

    with ThreadPoolExecutor(THREADS) as pool:
        for _ in range(20):
            packing._codec_of.cache_clear()
            gate = threading.Barrier(THREADS)
            for answer in [pool.submit(both_ways, gate) for _ in range(THREADS)]:
                assert answer.result() == expected
