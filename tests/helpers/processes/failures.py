"""What failed in a run of the tests, and which of it may be the machine's doing: hooks of pytest, for conftest.py.

A test that is marked `processes` or `sockets` has processes, threads or sockets play together, or looks at the machine,
where others do so, too. What it says of time may fail there once; what it says of bits may not: an image that differs
once is a bug, and is never rendered again until it happens to be right.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Generator
from pathlib import Path

import pytest

from wdpm.scenes.errors import ClusterError

FILE_VARIABLE = "WDPM_TEST_FAILURES"
"""Names the file that a run writes its failures to: the test's name -> whether it may be run again."""

MARKS = ("processes", "sockets")
OF_BITS = ("digest", "bits", "pixels", "layers", "array_equal", "allclose")
"""Words in a line of Python that compares images."""

RESULTS_DIFFER = "two results of task"
"""What a master says of results that were to have the same bits (cluster.master.tasks)."""

_MAY = "may be run again"
_failed: dict[str, bool] = {}


class DifferentBits(AssertionError):
    """Pixels or arrays are not those that they must be."""


def is_of_bits(failure: pytest.ExceptionInfo[BaseException]) -> bool:
    """Whether a failure is of what was computed: also where a test itself compared pixels, arrays or digests.

    A cluster that failed, or was not waited for any longer, gave nothing to compare, whatever line of a test asked it:
    unless it failed since its master had compared, and found other bits.
    """
    if RESULTS_DIFFER in str(failure.value):
        return True
    if failure.errisinstance((ClusterError, TimeoutError, subprocess.TimeoutExpired)):
        return False
    lines = [str(entry.statement) for entry in failure.traceback]
    return failure.errisinstance(DifferentBits) or any(word in line for word in OF_BITS for line in lines)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Have the report of a failure say whether the test may be run again; it may come from another process."""
    report = yield
    if report.failed and call.excinfo is not None:
        may = any(map(item.get_closest_marker, MARKS)) and not is_of_bits(call.excinfo)
        report.user_properties.append((_MAY, may))
    return report


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Take down a failure. A test that failed twice, at its end as well, may be run again if both failures may."""
    if report.failed:
        may = bool(dict(report.user_properties).get(_MAY, False))
        _failed[report.nodeid] = may and _failed.get(report.nodeid, True)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write down what failed, where somebody wants to know; of processes that share the tests, one does."""
    path = os.environ.get(FILE_VARIABLE)
    if path and not hasattr(session.config, "workerinput"):
        Path(path).write_text(json.dumps(_failed))
