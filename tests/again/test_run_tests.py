"""Failures that are the machine's doing are run again, alone; those of bits never."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from failures import FILE_VARIABLE

TESTS = Path(__file__).resolve().parents[1]
sys.path.append(str(TESTS))
import run_tests  # noqa: E402 - a program, not a module of the helpers

SUITE = """
import numpy as np
import pytest
from failures import DifferentBits
from wdpm.scenes.errors import ClusterError, ProtocolError

@pytest.mark.processes
def test_late(): assert False, "it did not happen within 240 s"

@pytest.mark.sockets
def test_lost(): assert False, "no slave has joined"

@pytest.mark.sockets
def test_nothing_to_compare():
    def digest(): raise ClusterError("no slave has joined")
    assert digest() == "a"

@pytest.mark.sockets
def test_results(): raise ProtocolError("two results of task 3 differ")

@pytest.mark.processes
def test_output():
    code, said = 1, "wdpm: error: slave anna: two results of task 3 differ"
    assert code == 0, said

@pytest.mark.sockets
def test_bits(): raise DifferentBits("beauty")

@pytest.mark.processes
def test_digests():
    digest = "a"
    assert digest == "b"

@pytest.mark.processes
def test_arrays(): np.testing.assert_array_equal(np.zeros(2), np.ones(2))

@pytest.mark.processes
def test_passes(): pass

@pytest.fixture
def at_its_end():
    yield
    raise AssertionError("it was not closed")

@pytest.mark.processes
def test_twice(at_its_end): raise DifferentBits("first of bits, and then late")

def test_other(): assert False
"""


def test_a_run_takes_down_what_failed_and_why(tmp_path: Path) -> None:
    (tmp_path / "test_suite.py").write_text(SUITE)
    (tmp_path / "conftest.py").write_text("from failures import *\n")
    (tmp_path / "pytest.ini").write_text(
        f"[pytest]\npythonpath = {TESTS / 'helpers' / 'processes'}\nmarkers =\n  processes\n  sockets\n"
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    environment[FILE_VARIABLE] = str(tmp_path / "failures.json")
    command = [sys.executable, "-m", "pytest", "-q", "-n", "1", "-p", "no:cacheprovider"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stdout
    told = json.loads((tmp_path / "failures.json").read_text())
    assert {name.partition("::test_")[2]: may for name, may in told.items()} == {
        "late": True,
        "lost": True,
        "nothing_to_compare": True,
        "results": False,
        "output": False,
        "bits": False,
        "digests": False,
        "arrays": False,
        "twice": False,
        "other": False,
    }


class Runs:
    """Stands in for pytest: gives exit codes and failures, one run after another."""

    def __init__(self, *runs: tuple[int, dict[str, bool]]) -> None:
        self._runs = list(runs)
        self.asked: list[Sequence[str]] = []

    def __call__(self, arguments: Sequence[str], failures: Path) -> int:
        self.asked.append(arguments)
        code, failed = self._runs.pop(0)
        failures.write_text(json.dumps(failed))
        return code


@pytest.mark.parametrize(("again", "loud"), [(0, True), (1, False)])
def test_what_was_late_is_run_again_alone(
    again: int, loud: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = Runs((1, {"t.py::test_a": True}), (again, {}))
    assert run_tests.run(["-n", "2"], tmp_path, runs) == again
    assert runs.asked == [["-n", "2"], ["-p", "no:randomly", "-p", "no:xdist", "t.py::test_a"]]
    out = capsys.readouterr().out
    assert "1 failed beside others" in out
    assert ("FLAKY" in out) is loud


@pytest.mark.parametrize(
    ("code", "failed"),
    [
        (0, {}),
        (1, {"a": True, "b": False}),
        (1, {str(number): True for number in range(run_tests.MOST + 1)}),
        (2, {"a": True}),  # interrupted, or a file that cannot be collected
    ],
)
def test_all_else_is_as_it_is(code: int, failed: dict[str, bool], tmp_path: Path) -> None:
    runs = Runs((code, failed))
    assert run_tests.run([], tmp_path, runs) == code
    assert len(runs.asked) == 1
