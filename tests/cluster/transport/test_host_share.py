"""Memory that processes of one machine share: who makes it, who finds it, and what is left of it."""

from __future__ import annotations

import errno
import gc
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from patience import WAIT_S, wait_until
from shared_memory import memory_is_shared

from wdpm.cluster.transport import host_share, local_sockets
from wdpm.cluster.transport.host_share import Claim, HostShare

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(host_share.host_share(Path()) is None, reason="only Linux has such memory"),
]
if_shared = pytest.mark.skipif(not memory_is_shared(), reason="this system lets processes share no memory")

CONTENT = [memoryview(b"tree"), memoryview(b" of photons")]

MAKER = """
import sys, time
from pathlib import Path
from wdpm.cluster.transport.host_share import HostShare
with HostShare(Path(sys.argv[1])).claim("tree") as claim:
    if sys.argv[2] == "made":
        kept = claim.publish([memoryview(b"tree"), memoryview(b" of photons")])
    else:
        print("at it", flush=True)
        time.sleep(1e6)
print("made", flush=True)
time.sleep(1e6)
"""


class Maker:
    """Another process, which makes something and keeps it, or is at it for ever."""

    def __init__(self, folder: Path, until: str) -> None:
        command = [sys.executable, "-c", MAKER, str(folder), until]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        assert self.process.stdout.readline().strip() == until

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait(WAIT_S)

    def __enter__(self) -> Maker:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        assert self.process.stdout is not None
        self.process.stdout.close()


def found(share: HostShare, name: str = "tree") -> bytes | None:
    """What is there, as a copy."""
    with share.claim(name) as claim:
        assert claim is not None
        return None if claim.found is None else bytes(claim.found)


def published(share: HostShare, name: str = "tree") -> memoryview:
    """What all find from then on."""
    with share.claim(name) as claim:
        assert claim is not None
        assert claim.found is None
        memory = claim.publish(CONTENT)
    assert memory is not None
    return memory


@if_shared
def test_others_find_what_one_has_made(tmp_path: Path) -> None:
    kept = published(HostShare(tmp_path))
    assert kept == b"tree of photons"
    assert found(HostShare(tmp_path)) == kept
    assert found(HostShare(tmp_path), "another tree") is None


@if_shared
def test_nobody_can_change_it(tmp_path: Path) -> None:
    kept = published(HostShare(tmp_path))
    with HostShare(tmp_path).claim("tree") as claim:
        assert claim is not None
        assert claim.found is not None
        assert claim.found.readonly
    assert kept.readonly
    [entry] = tmp_path.iterdir()
    process, number, *_ = entry.read_text().split()
    again = os.open(f"/proc/{process}/fd/{number}", os.O_RDWR)
    with pytest.raises(PermissionError):
        os.pwrite(again, b"x", 0)
    with pytest.raises(PermissionError):
        os.ftruncate(again, 1)
    os.close(again)


@if_shared
def test_nothing_is_left_once_the_maker_lets_go(tmp_path: Path) -> None:
    share = HostShare(tmp_path)
    kept = published(share)
    del kept
    gc.collect()
    assert list(tmp_path.iterdir()) == []
    assert found(share) is None


@if_shared
def test_one_at_a_time(tmp_path: Path) -> None:
    first, second = HostShare(tmp_path), HostShare(tmp_path)
    got: list[bytes | None] = []
    with first.claim("tree") as claim:
        assert claim is not None
        with second.claim("tree", wait=False) as other:
            assert other is None
        thread = threading.Thread(target=lambda: got.append(found(second)))
        thread.start()
        kept = claim.publish(CONTENT)
        assert not got
    thread.join(WAIT_S)
    assert got == [kept]


def test_patience_ends(tmp_path: Path) -> None:
    """Who waits in vain makes it, and nobody is told of that."""
    with HostShare(tmp_path).claim("tree"), HostShare(tmp_path, patience=0.01).claim("tree") as claim:
        assert claim is not None
        assert claim.found is None
        assert claim.publish(CONTENT) is None


@if_shared
def test_what_a_killed_process_made_is_gone_but_for_those_who_have_it(tmp_path: Path) -> None:
    share = HostShare(tmp_path)
    with Maker(tmp_path, "made") as maker:
        with share.claim("tree") as claim:
            assert claim is not None
            here = claim.found
        maker.kill()
        assert here == b"tree of photons"
        kept = published(share)
        assert found(share) == kept


@if_shared
def test_who_is_killed_while_making_leaves_that_to_the_next(tmp_path: Path) -> None:
    share, got = HostShare(tmp_path, patience=WAIT_S), []
    with Maker(tmp_path, "at it") as maker:
        thread = threading.Thread(target=lambda: got.append(published(share)))
        thread.start()
        maker.kill()
        thread.join(WAIT_S)
    assert found(share) == got[0]


@if_shared
@pytest.mark.parametrize("entry", [b"", b"nonsense", b"1 2 3", b"0 0 0 0 0\n", b"999999999 3 1 1 1\n"])
def test_an_entry_that_leads_nowhere_is_none(tmp_path: Path, entry: bytes) -> None:
    share = HostShare(tmp_path)
    kept = published(share)
    [path] = tmp_path.iterdir()
    path.write_bytes(entry)
    assert found(share) is None
    assert kept == b"tree of photons"


@if_shared
def test_a_file_that_can_still_change_is_not_taken(tmp_path: Path) -> None:
    share = HostShare(tmp_path)
    kept = published(share)
    [path] = tmp_path.iterdir()
    memory = os.memfd_create("open", os.MFD_ALLOW_SEALING)
    os.write(memory, kept)
    there = os.fstat(memory)
    path.write_text(f"{os.getpid()} {memory} {there.st_dev} {there.st_ino} {there.st_size}\n")
    assert found(share) is None
    os.close(memory)


def test_where_nothing_can_be_shared_nobody_waits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each makes its own, at the same time: no lock is held."""

    def refused(*_: object) -> int:
        raise OSError(12, "no memory")

    monkeypatch.setattr(os, "memfd_create", refused)
    share = HostShare(tmp_path)
    with share.claim("tree") as claim:
        assert claim is not None
        assert claim.publish(CONTENT) is None
    with share.claim("tree") as one, share.claim("tree", wait=False) as other:
        assert isinstance(one, Claim)
        assert isinstance(other, Claim)
        assert one.found is other.found is None


@if_shared
def test_where_the_disk_is_full_everyone_makes_his_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An entry is a few bytes in a file, for which there may be no room."""

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(host_share.os, "pwrite", full)
    open_files = len(os.listdir("/proc/self/fd"))
    for _ in range(2):
        with HostShare(tmp_path).claim("tree") as claim:
            assert claim is not None
            assert claim.found is None
            assert claim.publish(CONTENT) is None
    assert len(os.listdir("/proc/self/fd")) == open_files


def test_a_folder_that_is_gone_stops_nobody(tmp_path: Path) -> None:
    with HostShare(tmp_path / "gone").claim("tree") as claim:
        assert claim is not None
        assert claim.publish(CONTENT) is None


@if_shared
def test_the_folder_of_a_killed_master_is_removed_with_what_lies_in_it(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir(mode=0o700)
    share = local_sockets.shared_with(f"ipc://{folder}/master")
    assert share is not None
    kept = published(share)
    local_sockets.leave_orphaned(f"ipc://{folder}/master")
    assert not folder.exists()
    assert kept == b"tree of photons"


def test_slaves_at_other_addresses_share_nothing() -> None:
    assert local_sockets.shared_with("tcp://127.0.0.1:5555") is None


@if_shared
def test_all_locks_of_a_process_go_with_it(tmp_path: Path) -> None:
    maker = Maker(tmp_path, "at it")
    with maker, HostShare(tmp_path).claim("tree", wait=False) as claim:
        assert claim is None
    wait_until(lambda: maker.process.poll() is not None)
    assert found(HostShare(tmp_path)) is None
