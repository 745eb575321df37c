"""A command's process ends at once, but not before what others asked for at the end is done."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from wdpm.images.image import load
from wdpm.process_exit import NOT_FLUSHED

pytestmark = pytest.mark.processes

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


def wdpm(*words: str) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own."""
    return subprocess.run([sys.executable, "-m", "wdpm", *words], capture_output=True, text=True, check=False)


def test_a_command_has_its_exit_code() -> None:
    bad, good = wdpm("check", "no such file"), wdpm("compare", "--help")
    assert bad.returncode == 2
    assert bad.stderr.startswith("wdpm: error: no such file")
    assert good.returncode == 0
    assert good.stdout.startswith("usage: wdpm compare")


CTRL_C_THAT_NUMPY_TAKES = """
import os, signal
try:
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(10_000_000):
        pass
except KeyboardInterrupt:
    raise ImportError("numpy._core.multiarray failed to import") from None
"""


@pytest.mark.parametrize("begin", ["raise KeyboardInterrupt\n", CTRL_C_THAT_NUMPY_TAKES], ids=["raised", "lost"])
def test_ctrl_c_before_a_command_has_begun_is_one_line(begin: str, tmp_path: Path) -> None:
    """What computes takes half a second to import, and no handler of a command's is there yet."""
    (tmp_path / "argparse.py").write_text(begin)
    path = os.pathsep.join([str(tmp_path), *sys.path])
    command = [sys.executable, "-P", "-c", "from wdpm.__main__ import run; run()"]
    found = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": path})
    assert (found.returncode, found.stderr) == (130, "wdpm: interrupted\n")


def by_shell(words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own, as a shell starts it; `wdpm` is the command."""
    words = words.replace("wdpm", f"{sys.executable} -m wdpm")
    return subprocess.run(["sh", "-c", words], capture_output=True, text=True, check=False, env=os.environ | variables)


RENDER = (
    "wdpm render cornell-box --all-effects --size 8x8 --spp 1 --photons 500 --threads 1 "
    "-o a.exr -o a.png --report a.json"
)
needs_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no file here that refuses writing")


@needs_full
@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("stream", ["1", "2"])
def test_a_render_goes_on_where_its_log_has_no_room(
    stream: str, unbuffered: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = by_shell(f"{RENDER} {stream}>/dev/full", PYTHONUNBUFFERED=unbuffered)
    assert done.returncode == (2 if stream == "1" else 0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.exr", "a.json", "a.png"]
    assert "Traceback" not in done.stderr
    if stream == "1":
        assert done.stderr.endswith("wdpm: error: standard output: cannot be written: no space left on device\n")
    else:
        assert "wrote a.png" in done.stdout


@needs_full
def test_what_could_not_be_told_is_one_line() -> None:
    done = by_shell("wdpm check cornell-box --json > /dev/full")
    assert done.returncode == 2
    assert done.stderr == "wdpm: error: standard output: cannot be written: no space left on device\n"


@pytest.mark.skipif(os.name != "posix", reason="a shell closes streams")
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_streams_may_be_closed(closed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that are opened get their numbers, and would be printed into."""
    monkeypatch.chdir(tmp_path)
    assert by_shell(f"{RENDER} {closed}").returncode == 0
    assert load(tmp_path / "a.exr").pixels.shape == load(tmp_path / "a.png").pixels.shape == (8, 8, 3)


@pytest.mark.parametrize("errors", ["strict", "surrogateescape", "backslashreplace"])
def test_names_that_are_no_text_are_printed_all_the_same(errors: str) -> None:
    """Those of files as they are, those that a scene gives (JSON can say anything) somehow."""
    program = r"from wdpm.standard_streams import take_streams; take_streams(); print('\u00fc, \udcfc, \ud800')"
    told = os.environ | {"PYTHONIOENCODING": f"utf-8:{errors}"}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True, env=told)
    assert done.stdout.splitlines() == ["ü, ".encode() + b"\xfc, \\ud800"]


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
@pytest.mark.parametrize("name", [b"\xfc.exr", b"\xfc.png", "ü.exr".encode()])
def test_images_whose_names_are_no_text(name: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor are others where the locale's encoding is none for them."""
    monkeypatch.chdir(tmp_path)
    command = [sys.executable, "-m", "wdpm", *RENDER.split()[1:], "-o", name]
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    for locale in ({}, plain):
        done = subprocess.run(command, capture_output=True, check=False, env=os.environ | locale)
        assert done.returncode == 0, done.stderr
        assert b"wrote " + name in done.stdout
        assert load(tmp_path / os.fsdecode(name)).pixels.shape == (8, 8, 3)
        (tmp_path / os.fsdecode(name)).unlink()


def test_errors_name_files_as_they_are() -> None:
    done = subprocess.run([sys.executable, "-m", "wdpm", "check", b"\xfc.xml"], capture_output=True, check=False)
    assert done.stderr.startswith(b"wdpm: error: \xfc.xml: no such file")


def test_a_render_whose_reader_has_left_writes_its_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As `| head` leaves; of a command that is to print something, nobody wants the rest."""
    monkeypatch.chdir(tmp_path)
    done = by_shell(f"({RENDER} 2>&1; echo $? > code) | true", PYTHONUNBUFFERED="1")
    assert done.returncode == 0
    assert (tmp_path / "code").read_text() == "0\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.exr", "a.json", "a.png", "code"]
    by_shell("(wdpm check cornell-box; echo $? > code) | true", PYTHONUNBUFFERED="1")
    assert (tmp_path / "code").read_text() == "1\n"
