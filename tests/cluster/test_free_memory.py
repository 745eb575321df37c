"""What is free is given back to the system, which sees who uses how much."""

from __future__ import annotations

import ctypes
import subprocess
import sys

import numpy as np
import pytest

from wdpm.cluster import host_memory
from wdpm.cluster.host_memory import keep_free_memory, return_free_memory

CAN_TRIM = sys.platform == "linux" and hasattr(ctypes.CDLL(None), "malloc_trim")


@pytest.mark.skipif(not CAN_TRIM, reason="only glibc's allocator is asked")
def test_free_memory_is_given_back() -> None:
    """Though what lies behind it is in use: every hundredth of some small arrays.

    The allocator's word counts: how much memory a process has is a matter of the system's, and of all its threads.
    """
    arrays = [np.ones(50_000, np.uint8) for _ in range(2000)]
    kept = arrays[99::100]
    del arrays
    assert return_free_memory()
    assert all(array.all() for array in kept)


def test_elsewhere_nothing_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host_memory.sys, "platform", "darwin")
    assert not return_free_memory()
    assert not keep_free_memory()


@pytest.mark.skipif(not CAN_TRIM, reason="only glibc's allocator is told")
def test_a_slave_tells_the_allocator_to_keep_what_is_free() -> None:
    """In a process of its own: what it is told holds for good. glibc says no to what it cannot take."""
    code = "import sys; from wdpm.cluster.host_memory import keep_free_memory; sys.exit(0 if keep_free_memory() else 9)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
