"""The commands of the page about three machines, run as they stand there, but for the address and the image's size."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from blocks_of_pages import ROOT, commands_of, words_of
from free_ports import free_port
from patience import WAIT_S

from wdpm.cli.main import main
from wdpm.images.image import load

pytestmark = pytest.mark.sockets

PAGE = ROOT / "docs" / "how-to" / "three-machines.md"
SMALL = ["--size", "16x16", "--spp", "1", "--photons", "500", "--quiet"]


def start(folder: Path, words: list[str]) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-m", "wdpm", *words], cwd=folder, stderr=subprocess.PIPE, text=True)


def test_the_commands_render_a_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    address = f"tcp://127.0.0.1:{free_port()}"
    every = [[address if word.startswith("tcp://") else word for word in words_of(line)] for line in commands_of(PAGE)]
    keys, add, master, slave = every
    assert [each[0] for each in every] == ["keys", "keys", "master", "slave"]
    assert main(keys) == main(add) == 0

    running = []
    try:
        for name in add[3:]:
            folder = tmp_path / f"machine-of-{name}"
            folder.mkdir()
            shutil.move(tmp_path / add[2] / name, folder / "slave-keys")
            running.append(start(folder, slave))
        running.append(start(tmp_path, [*master, *SMALL]))
        said = [process.communicate(timeout=2 * WAIT_S)[1] for process in running]
    finally:
        for process in running:
            process.kill()
            process.wait()
    assert [process.returncode for process in running] == [0, 0, 0], said
    assert len(running) == 3
    assert load(tmp_path / "box.exr").shape == (16, 16)
