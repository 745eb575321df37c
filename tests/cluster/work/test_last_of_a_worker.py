"""What a worker has open, and its memory, go with the last who needs it."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator

import pytest
from one_cell import FEW, ready

import wdpm


@pytest.fixture
def no_collector() -> Iterator[None]:
    """Nothing looks for what refers to itself in a circle."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.usefixtures("no_collector")
def test_a_worker_does_not_wait_for_the_collector() -> None:
    """Of large scenes it has gigabytes, on disk too, but few objects: the collector would come renders later."""
    worker = ready(wdpm.load("cornell-box", size=(4, 4)), FEW)
    gone = weakref.ref(worker), weakref.ref(worker.cells[0])
    del worker
    assert [each() for each in gone] == [None, None]
