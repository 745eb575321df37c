"""Slave processes that take their time, for tests in which one of them has to die."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

PROGRAMS = Path(__file__).parent
"""Where the programs lie that tests start: master_process.py and slave_process.py."""
AGREED = {"code": "1"}


def slow_slave(delay: float, *options: str) -> Callable[[str], Sequence[str]]:
    """Command line of a slave process that takes some seconds a task."""
    return lambda endpoint: [sys.executable, str(PROGRAMS / "slave_process.py"), endpoint, str(delay), *options]
