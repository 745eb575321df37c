"""What is free is given back to the system, which sees who uses how much."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from wdpm.cluster.host_memory import return_free_memory


def resident() -> int:
    """Anonymous memory of this process, which no file backs [bytes]."""
    [line] = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("RssAnon:")]
    return int(line.split()[1]) << 10


@pytest.mark.skipif(sys.platform != "linux", reason="the allocator is asked on Linux alone")
def test_free_memory_is_given_back() -> None:
    """Though what lies behind it is in use: every hundredth of some small arrays."""
    arrays = [np.ones(50_000, np.uint8) for _ in range(2000)]
    kept = arrays[99::100]
    full = resident()
    del arrays
    return_free_memory()
    assert resident() < full - (70 << 20)
    assert all(array.all() for array in kept)
