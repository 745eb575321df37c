"""Runs the tests; those of processes that failed among others once more, alone.

    python tests/run_tests.py [OPTIONS OF PYTEST]

What passes then is told, loudly, and does not fail the run: whoever changes something else is not to be held up by a
machine that stood still. It has to be mended all the same. See tests/helpers/processes/failures.py for what is never
run again: above all, an image that differs.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

FILE_VARIABLE = "WDPM_TEST_FAILURES"
MOST = 3
"""Tests that are run again. More failures at a time have one cause, and it is not chance."""

Pytest = Callable[[Sequence[str], Path], int]
"""Arguments, and the file for failures -> exit code."""


def pytest_process(arguments: Sequence[str], failures: Path) -> int:
    """Run pytest in a process of its own."""
    command = [sys.executable, "-m", "pytest", *arguments]
    return subprocess.run(command, env={**os.environ, FILE_VARIABLE: str(failures)}, check=False).returncode


def run(arguments: Sequence[str], folder: Path, pytest: Pytest = pytest_process) -> int:
    """Run the tests, and some of those that failed once more.

    Args:
        arguments: of pytest.
        folder: for files.

    Returns:
        The exit code of pytest: 0 if all passed, in the end.
    """
    file = folder / "failures.json"
    code = pytest(arguments, file)
    failed: dict[str, bool] = json.loads(file.read_text()) if file.exists() else {}
    if code != 1 or not failed or not all(failed.values()) or len(failed) > MOST:
        return code
    say(f"{len(failed)} failed beside others, and may have been held up by them: once more, alone", failed)
    code = pytest(["-p", "no:randomly", "-p", "no:xdist", *failed], folder / "again.json")
    if code == 0:
        say("FLAKY: failed beside others and passed alone; this is no pass to rely on, mend them", failed)
    return code


def say(what: str, tests: Sequence[str] | dict[str, bool]) -> None:
    """A line, and one for each test."""
    print("\n".join(["", f"== {what}", *(f"==     {test}" for test in tests), ""]), flush=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        sys.exit(run(sys.argv[1:], Path(place)))
