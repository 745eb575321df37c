"""Masters as processes that are killed or terminated, and started again with --resume."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import wdpm
from wdpm.cli.main import main
from wdpm.cluster.render_settings import Indirect
from wdpm.images.image import load
from wdpm.rendering.record_file import read_records

pytestmark = pytest.mark.sockets

CHOSEN: dict[str, Any] = {"photons": 1000, "spp": 8, "k": 20, "indirect": Indirect.CACHE}
OPTIONS = ["cornell-box", "--size", "40x40", "--photons", "1000", "--spp", "8", "--k", "20"]
OPTIONS += ["--indirect", "cache", "--bucket", "8", "-q"]
LONGEST_S = 90.0


@contextmanager
def wdpm_process(folder: Path, *words: str) -> Iterator[subprocess.Popen[str]]:
    """A command; killed at the end, if it runs then."""
    root = Path(wdpm.__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    with subprocess.Popen(
        [sys.executable, "-m", "wdpm", *words], cwd=folder, env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_until(what: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + LONGEST_S
    while not what():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline
        time.sleep(0.01)


def kept(journal: Path) -> list[bytes]:
    """The headers of what a journal holds."""
    return [frames[0] for frames, _ in read_records(journal)] if journal.exists() and journal.stat().st_size else []


@pytest.fixture(scope="module")
def expected() -> str:
    scene = wdpm.load("cornell-box", size=(40, 40))
    return wdpm.render(scene, **CHOSEN).digest()


def test_a_master_is_killed_in_photons_records_and_image(expected: str, tmp_path: Path) -> None:
    """Its slaves have keys, wait for it, and are the same processes to the end."""
    assert main(["keys", str(tmp_path / "master")]) == 0
    for name in ("anna", "bert"):
        assert main(["keys", "add", str(tmp_path / "master"), name]) == 0
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    log, journal = tmp_path / "log", tmp_path / "box.exr.wdpm-journal"
    master = ["master", *OPTIONS, "-o", "box.exr", "--bind", address, "--slaves", "2", "--keys", "master"]
    master += ["--resume", "--journal", ".", "--log", "log"]

    def begun(phase: str) -> bool:
        return log.exists() and f'"phase": "{phase}"' in log.read_text()

    def holds(kind: bytes, before: int) -> bool:
        return sum(kind in header for header in kept(journal)) > before

    with (
        wdpm_process(tmp_path, "slave", address, "--keys", "master/anna", "--threads", "1") as anna,
        wdpm_process(tmp_path, "slave", address, "--keys", "master/bert", "--threads", "1") as bert,
    ):
        for moment in (
            lambda: begun("photons"),
            lambda: holds(b"RecordsKept", 2),
            lambda: holds(b"BucketKept", 3),
        ):
            with wdpm_process(tmp_path, *master) as process:
                wait_until(moment, process)
                process.send_signal(signal.SIGKILL)
                assert process.wait(LONGEST_S) == -signal.SIGKILL
            log.unlink()
            assert not (tmp_path / "box.exr").exists()
        with wdpm_process(tmp_path, *master) as process:
            assert process.wait(LONGEST_S) == 0, process.communicate()[1]
        assert [anna.wait(LONGEST_S), bert.wait(LONGEST_S)] == [0, 0]
    assert load(tmp_path / "box.exr").digest() == expected
    assert not journal.exists()


def test_a_render_that_is_terminated_says_how_to_go_on(expected: str, tmp_path: Path) -> None:
    """With slaves of its own, which it starts anew."""
    journal = tmp_path / "box.exr.wdpm-journal"
    render = ["render", *OPTIONS, "-o", "box.exr", "--slaves", "2", "--journal", "."]
    with wdpm_process(tmp_path, *render) as process:
        wait_until(lambda: sum(b"BucketKept" in header for header in kept(journal)) > 3, process)
        process.send_signal(signal.SIGTERM)
        _, told = process.communicate(timeout=LONGEST_S)
    assert process.returncode == 143
    assert told.splitlines() == [
        "wdpm: wrote box.partial.exr: the picture as far as it is",
        "wdpm: box.exr.wdpm-journal keeps what is finished; the same command with --resume goes on",
        "wdpm: terminated",
    ]
    assert (load(tmp_path / "box.partial.exr").pixels > 0).any()
    with wdpm_process(tmp_path, *render) as process:
        _, told = process.communicate(timeout=LONGEST_S)
        assert (process.returncode, "give --resume" in told, told.count("\n")) == (2, True, 1)
    with wdpm_process(tmp_path, *render, "--resume") as process:
        assert process.wait(LONGEST_S) == 0
    assert load(tmp_path / "box.exr").digest() == expected
    assert sorted(path.name for path in tmp_path.iterdir()) == ["box.exr"]
