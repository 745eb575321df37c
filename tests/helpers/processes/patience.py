"""How long tests wait for what must come.

A machine that is slow, laden or stands still for a while must not fail a test, so limits are far longer than anything
takes: only what never comes takes as long. No test may ask how fast something was, nor how much memory or processor
time a process took of a machine that it shares.
"""

from __future__ import annotations

import time
from collections.abc import Callable

WAIT_S = 240.0
"""Far beyond anything that is waited for, and below pytest's own limit of a test, which tells less."""


def wait_until(
    condition: Callable[[], object], what: str = "it", meanwhile: Callable[[], object] = lambda: None
) -> None:
    """Wait until something is so.

    Args:
        what: should happen, for the message of the failure.
        meanwhile: is called between two looks, and may raise.

    Raises:
        AssertionError: it was not so within WAIT_S.
    """
    deadline = time.monotonic() + WAIT_S
    while not condition():
        meanwhile()
        assert time.monotonic() < deadline, f"{what} did not happen within {WAIT_S:g} s"
        time.sleep(0.02)
