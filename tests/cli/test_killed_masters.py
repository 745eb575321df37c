"""Masters as processes that are killed or terminated, and started again with --resume."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from free_ports import free_port
from patience import WAIT_S

import wdpm
from wdpm.cli.main import main
from wdpm.cluster.render_settings import Indirect
from wdpm.images.image import load

# Each starts six processes or more, one after another.
pytestmark = [pytest.mark.sockets, pytest.mark.processes, pytest.mark.timeout(1200)]

CHOSEN: dict[str, Any] = {"photons": 1000, "spp": 8, "k": 20, "indirect": Indirect.CACHE}
OPTIONS = ["cornell-box", "--size", "40x40", "--photons", "1000", "--spp", "8", "--k", "20"]
OPTIONS += ["--indirect", "cache", "--bucket", "8", "-q"]

STRUCK = """
import os, sys
from wdpm.cli.main import main
from wdpm.monitoring.json_log import JsonLog
from wdpm.rendering.record_file import RecordWriter

what, times, number, *words = sys.argv[1:]
seen = 0

def struck(write, is_it):
    def written(self, given):
        global seen
        write(self, given)
        seen += is_it(given)
        if seen == int(times):
            seen += 1
            os.kill(os.getpid(), int(number))
    return written

JsonLog.__call__ = struck(JsonLog.__call__, lambda event: event.facts.get("phase") == what)
RecordWriter.append = struck(RecordWriter.append, lambda frames: what.encode() in bytes(frames[0]))
sys.exit(main(words))
"""
"""`wdpm` that sends itself a signal once its log has had a phase, or its journal a kind of record, so many times:
a test that looked from outside would come too late where it is given no processor."""


@contextmanager
def wdpm_process(folder: Path, *words: str, struck: Sequence[str] = ()) -> Iterator[subprocess.Popen[str]]:
    """A command; killed at the end, if it runs then.

    Args:
        struck: what comes how many times before which signal; none for a command that nothing strikes.
    """
    root = Path(wdpm.__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    program = ["-c", STRUCK, *struck] if struck else ["-m", "wdpm"]
    with subprocess.Popen(
        [sys.executable, *program, *words], cwd=folder, env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture(scope="module")
def expected() -> str:
    scene = wdpm.load("cornell-box", size=(40, 40))
    return wdpm.render(scene, **CHOSEN).digest()


def test_a_master_is_killed_in_photons_records_and_image(expected: str, tmp_path: Path) -> None:
    """Its slaves have keys, wait for it, and are the same processes to the end."""
    assert main(["keys", str(tmp_path / "master")]) == 0
    for name in ("anna", "bert"):
        assert main(["keys", "add", str(tmp_path / "master"), name]) == 0
    address = f"tcp://127.0.0.1:{free_port()}"
    journal = tmp_path / "box.exr.wdpm-journal"
    master = ["master", *OPTIONS, "-o", "box.exr", "--bind", address, "--slaves", "2", "--keys", "master"]
    master += ["--resume", "--journal", ".", "--log", "log"]
    slave = ["slave", address, "--threads", "1", "--timeout", f"{3 * WAIT_S:.0f}"]
    with (
        wdpm_process(tmp_path, *slave, "--keys", "master/anna") as anna,
        wdpm_process(tmp_path, *slave, "--keys", "master/bert") as bert,
    ):
        for moment in (("photons", "1"), ("RecordsKept", "3"), ("BucketKept", "4")):
            with wdpm_process(tmp_path, *master, struck=(*moment, str(int(signal.SIGKILL)))) as process:
                assert process.wait(WAIT_S) == -signal.SIGKILL, process.communicate()[1]
            assert not (tmp_path / "box.exr").exists()
        with wdpm_process(tmp_path, *master) as process:
            assert process.wait(WAIT_S) == 0, process.communicate()[1]
        assert [anna.wait(WAIT_S), bert.wait(WAIT_S)] == [0, 0]
    assert load(tmp_path / "box.exr").digest() == expected
    assert not journal.exists()


@pytest.mark.parametrize(
    ("number", "code", "word"), [(signal.SIGTERM, 143, "terminated"), (signal.SIGHUP, 129, "hung up")]
)
def test_a_render_that_is_ended_says_how_to_go_on(
    number: int, code: int, word: str, expected: str, tmp_path: Path
) -> None:
    """With slaves of its own, which it starts anew."""
    render = ["render", *OPTIONS, "-o", "box.exr", "--slaves", "2", "--journal", "."]
    with wdpm_process(tmp_path, *render, struck=("BucketKept", "4", str(int(number)))) as process:
        _, told = process.communicate(timeout=WAIT_S)
    assert process.returncode == code
    assert told.splitlines() == [
        "wdpm: wrote box.partial.exr: the picture as far as it is",
        "wdpm: box.exr.wdpm-journal keeps what is finished; the same command with --resume goes on",
        f"wdpm: {word}",
    ]
    assert (load(tmp_path / "box.partial.exr").pixels > 0).any()
    with wdpm_process(tmp_path, *render) as process:
        _, told = process.communicate(timeout=WAIT_S)
        assert (process.returncode, "give --resume" in told, told.count("\n")) == (2, True, 1)
    with wdpm_process(tmp_path, *render, "--resume") as process:
        assert process.wait(WAIT_S) == 0
    assert load(tmp_path / "box.exr").digest() == expected
    assert sorted(path.name for path in tmp_path.iterdir()) == ["box.exr"]
