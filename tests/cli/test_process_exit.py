"""A command's process ends at once, but not before what others asked for at the end is done."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from wdpm.process_exit import NOT_FLUSHED

ENDS = """
import atexit, concurrent.futures, sys, threading, weakref
from wdpm.process_exit import leave

class Kept:
    def __del__(self):
        print("taken apart")

kept = Kept()
done = threading.Event()
atexit.register(print, "registered")
finalized = weakref.finalize(kept, print, "finalized")
pool = concurrent.futures.ThreadPoolExecutor(1)
pool.submit(done.wait).add_done_callback(lambda _: print("work done"))
threading.Thread(target=lambda: (done.set(), print("thread done"))).start()
sys.stdout.write("printed without an end of line ")
"""


def ended(how: str, **streams: int) -> subprocess.CompletedProcess[str]:
    """A process that ends in some way."""
    told = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **streams}
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    return subprocess.run([sys.executable, "-c", ENDS + how], text=True, check=False, env=buffered, **told)


def test_all_but_objects_ends_as_python_ends_it() -> None:
    ours, python = ended("leave(3)"), ended("sys.exit(3)")
    assert ours.returncode == python.returncode == 3
    assert python.stdout.splitlines()[-1] == "taken apart"
    told = sorted(ours.stdout.replace("an end of line ", "an end of line\n").splitlines())
    assert told == ["finalized", "printed without an end of line", "registered", "thread done", "work done"]
    assert not ours.stderr


def test_a_profiler_has_its_say(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text("from wdpm.process_exit import leave\nleave(0)\n")
    watched = subprocess.run([sys.executable, "-m", "cProfile", script], capture_output=True, text=True, check=True)
    assert "function calls" in watched.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no file here that refuses what is written")
def test_output_that_could_not_be_written_is_not_success() -> None:
    with open("/dev/full", "w") as full:
        ours, python = (ended(how, stdout=full.fileno()).returncode for how in ("leave(0)", "sys.exit(0)"))
    assert ours == python == NOT_FLUSHED


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no file here that refuses what is written")
def test_output_that_could_not_be_written_is_one_line() -> None:
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "wdpm", "inspect", "cornell-box"]
        found = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert found.stderr == "wdpm: error: no space left on device\n"
    assert found.returncode in (2, NOT_FLUSHED)


@pytest.mark.parametrize("closed", ["<&-", ">&-", "<&- >&-"])
def test_standard_streams_may_be_closed(closed: str) -> None:
    words = ["sh", "-c", f'exec "$0" -m wdpm inspect cornell-box {closed}', sys.executable]
    found = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (found.returncode, found.stderr) == (0, "")


def wdpm(*words: str) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own."""
    return subprocess.run([sys.executable, "-m", "wdpm", *words], capture_output=True, text=True, check=False)


def test_a_command_has_its_exit_code() -> None:
    bad, good = wdpm("check", "no such file"), wdpm("compare", "--help")
    assert bad.returncode == 2
    assert bad.stderr.startswith("wdpm: error: no such file")
    assert good.returncode == 0
    assert good.stdout.startswith("usage: wdpm compare")


def test_ctrl_c_before_a_command_has_begun_is_one_line(tmp_path: Path) -> None:
    """What computes takes half a second to import, and no handler of a command's is there yet."""
    (tmp_path / "argparse.py").write_text("raise KeyboardInterrupt\n")
    path = os.pathsep.join([str(tmp_path), *sys.path])
    command = [sys.executable, "-P", "-c", "from wdpm.__main__ import run; run()"]
    found = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": path})
    assert (found.returncode, found.stderr) == (130, "wdpm: interrupted\n")
