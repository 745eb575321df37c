"""Folders that clusters have left: whose are removed, and whose are not."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from wdpm.cluster.transport import local_sockets
from wdpm.cluster.transport.orphaned_folders import OWNER, lock, remove_orphaned

pytestmark = [pytest.mark.processes, pytest.mark.skipif(os.name != "posix", reason="folders here have no mode")]

NAME = "wdpm-abc_1234"


@pytest.fixture
def parent(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where temporary files go. Folders of pytest have longer paths than a socket may have."""
    with tempfile.TemporaryDirectory() as made:
        monkeypatch.setattr(tempfile, "tempdir", made)
        yield Path(made)


def left_in(parent: Path, name: str = NAME) -> Path:
    """What a cluster leaves that was killed."""
    folder = parent / name
    folder.mkdir(mode=0o700)
    for file in (OWNER, "0123456789abcdef", "made-" + 32 * "0"):
        (folder / file).touch()
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(folder / "master"))
    return folder


def test_a_master_removes_what_others_left_that_were_killed(parent: Path) -> None:
    folder = left_in(parent)
    with local_sockets.address_for_master() as address:
        assert address is not None
        assert not folder.exists()
        own = Path(address.removeprefix("ipc://")).parent
        assert [path.name for path in own.iterdir()] == [OWNER]
        remove_orphaned(parent)  # as another master does
        assert own.exists()
    assert list(parent.iterdir()) == []


MASTER = """
import sys, tempfile, time
from wdpm.cluster.transport.local_sockets import address_for_master
tempfile.tempdir = sys.argv[1]
with address_for_master() as address:
    print(address, flush=True)
    time.sleep(1e6)
"""


def test_a_folder_is_its_masters_until_that_is_killed(parent: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", MASTER, str(parent)], stdout=subprocess.PIPE, text=True) as master:
        assert master.stdout is not None
        folder = Path(master.stdout.readline().strip().removeprefix("ipc://")).parent
        remove_orphaned(parent)
        assert folder.exists()
        master.send_signal(signal.SIGKILL)
    remove_orphaned(parent)
    assert not folder.exists()


def with_a_file_of_somebody(folder: Path) -> None:
    (folder / "thesis.tex").touch()


def with_a_folder(folder: Path) -> None:
    (folder / ("made-" + 32 * "1")).mkdir()


def open_to_others(folder: Path) -> None:
    folder.chmod(0o755)


def of_nobody_known(folder: Path) -> None:
    (folder / OWNER).unlink()


def whose_owner_is_a_link(folder: Path) -> None:
    (folder / OWNER).unlink()
    (folder / OWNER).symlink_to(folder / "0123456789abcdef")


def of_another_name(folder: Path) -> None:
    folder.rename(folder.with_name("wdpm-bench-abc12345"))


def that_is_a_link(folder: Path) -> None:
    folder.rename(folder.with_name("elsewhere"))
    folder.symlink_to(folder.with_name("elsewhere"))


@pytest.mark.parametrize(
    "change",
    [
        with_a_file_of_somebody,
        open_to_others,
        of_nobody_known,
        whose_owner_is_a_link,
        of_another_name,
        that_is_a_link,
    ],
)
def test_what_may_be_somebody_elses_stays(parent: Path, change: Callable[[Path], None]) -> None:
    change(left_in(parent))
    before = sorted(parent.rglob("*"))
    remove_orphaned(parent)
    assert sorted(parent.rglob("*")) == before


def test_a_folder_in_it_stays(parent: Path) -> None:
    folder = left_in(parent)
    with_a_folder(folder)
    remove_orphaned(parent)
    assert [path.is_dir() for path in folder.iterdir()].count(True) == 1


def test_where_nothing_can_be_locked_a_folder_stays(parent: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import fcntl

    def none(*_: object) -> None:
        raise OSError("no locks here")

    folder = parent / NAME
    folder.mkdir(mode=0o700)
    with monkeypatch.context() as context:
        context.setattr(fcntl, "flock", none)
        assert lock(folder) is None
    assert list(folder.iterdir()) == []
    remove_orphaned(parent)
    assert folder.exists()
