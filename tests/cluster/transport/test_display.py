"""A display is handed what goes into the film, to the bit, whoever rendered it."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from fake_worker import FakeWorker, make_session, picture
from slave_threads import SMALL, SlaveThread, check_picture
from slow_slaves import AGREED

from wdpm.cluster.display import Bucket, Frame, PassMean, SlaveSeen
from wdpm.cluster.in_process import MemoryCluster
from wdpm.cluster.master.server import MasterServer


class RecordingDisplay:
    """Puts the image together from what it is shown."""

    enough = False

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.ended: list[Sequence[Mapping[str, Any]]] = []
        self.workers: set[int] = set()
        self.seen: list[SlaveSeen] = []
        self.film: dict[str, np.ndarray] = {}

    def begin(self, frame: Frame) -> None:
        self.frames.append(frame)
        shape = (frame.height, frame.width)
        self.film = {
            name: np.full(shape if count == 1 else (*shape, count), np.nan, np.float32)
            for name, count in frame.channels.items()
        }

    def bucket(self, bucket: Bucket) -> None:
        self.workers.add(bucket.slave)
        for name, pixels in bucket.layers.items():
            height, width = pixels.shape[:2]
            place = self.film[name][bucket.y0 : bucket.y0 + height, bucket.x0 : bucket.x0 + width]
            assert np.isnan(place).all(), "a bucket came twice"
            place[:] = pixels

    def slaves(self, seen: Sequence[SlaveSeen]) -> None:
        self.seen = list(seen)

    def end(self, statistics: Sequence[Mapping[str, Any]]) -> None:
        self.ended.append(statistics)

    def pass_done(self, mean: PassMean) -> None:
        raise AssertionError(f"a cluster knows no passes: {mean}")


@pytest.mark.parametrize("seed", [None, 0, 1])
def test_a_display_sees_the_image(seed: int | None) -> None:
    display, session = RecordingDisplay(), make_session(3, 4)
    cluster = MemoryCluster(FakeWorker, 3, shuffle=None if seed is None else random.Random(seed))
    result = cluster.render(session, display=display)
    assert len(display.frames) == len(display.ended) == 1
    frame = display.frames[0]
    assert (frame.width, frame.height, frame.first_sample, frame.spp) == (50, 34, 0, session.view.spp)
    assert frame.holders == (0, 1, 2, 0)
    assert len(frame.slaves) == 3
    assert display.workers == {0, 1, 2}
    assert len(display.ended[0]) == 3
    for name, layer in picture(session.view).layers.items():
        np.testing.assert_array_equal(display.film[name], layer)
        np.testing.assert_array_equal(display.film[name], result.layers[name])


def test_a_display_is_not_kept_for_the_next_session() -> None:
    display = RecordingDisplay()
    cluster = MemoryCluster(FakeWorker, 2)
    cluster.render(make_session(2, 2), display=display)
    cluster.render(make_session(2, 2))
    assert len(display.frames) == 1


@pytest.mark.sockets
def test_a_master_with_slaves_at_an_address_feeds_it_too() -> None:
    display, session = RecordingDisplay(), make_session(2, 4)
    with MasterServer("tcp://127.0.0.1:0", 2, limits=SMALL, agreed=AGREED) as master:
        slaves = [SlaveThread(master.endpoint) for _ in range(2)]
        master.render(session, display=display)
    assert [slave.end() for slave in slaves] == [None, None]
    check_picture(session, display.film)
    assert [(slave.cells, slave.whole, slave.lost) for slave in display.seen] == [(2, False, False)] * 2
    assert len(display.ended) == 1
