"""Master and slaves of a run find each other by a folder, and no secret is in it."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from patience import WAIT_S

from wdpm.placing.rendezvous import Found, Rendezvous, meet, meeting_folder
from wdpm.scenes.errors import ClusterEndedError, MasterLostError, SettingsError, WdpmError

ENDPOINT = "tcp://127.0.0.1:4711"


class Guest(threading.Thread):
    """A slave that looks for the master."""

    def __init__(self, folder: Path, rank: int, slaves: int) -> None:
        super().__init__()
        self._what = (folder, rank, slaves)
        self.found: Found | None = None
        self.error: WdpmError | None = None
        self.start()

    def run(self) -> None:
        try:
            self.found = meet(*self._what, patience=WAIT_S)
        except WdpmError as error:
            self.error = error

    def end(self) -> Found:
        self.join()
        assert self.error is None, self.error
        assert self.found is not None
        return self.found


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return meeting_folder(tmp_path, "17-0")


def test_master_and_slaves_find_each_other(folder: Path) -> None:
    guests = [Guest(folder, rank, 2) for rank in (1, 2)]
    master = Rendezvous(folder, 2)
    master.publish(ENDPOINT)
    found = [guest.end() for guest in guests]
    assert [each.endpoint for each in found] == [ENDPOINT] * 2
    assert {each.security.master for each in found} == {master.security.own.public}
    admits = master.security.guests.admits
    assert all(admits(each.security.own.public) for each in found)
    assert not admits(master.security.own.public)
    secrets = [master.security.own.secret, *(each.security.own.secret for each in found)]
    written = [path.read_bytes() for path in folder.iterdir()]
    assert len(written) == 3
    assert not [secret for secret in secrets for text in written if secret in text]
    assert folder.stat().st_mode & 0o777 == 0o700
    assert all(path.stat().st_mode & 0o777 == 0o600 for path in folder.iterdir())
    master.close("done")
    assert not folder.exists()


def test_more_slaves_than_there_are_tasks_are_let_in_by_nobody(folder: Path) -> None:
    master = Rendezvous(folder, 1)
    master.publish(ENDPOINT)
    stranger = meet(folder, 2, 1)
    assert not master.security.guests.admits(stranger.security.own.public)
    (folder / "slave-1.key").write_bytes(b"")
    assert not master.security.guests.admits(b"")


def test_slaves_that_come_after_the_end_do_not_wait_and_the_last_tidies_up(folder: Path) -> None:
    master = Rendezvous(folder, 2)
    master.publish(ENDPOINT)
    master.close("the scene cannot be read")
    for rank in (2, 1):
        assert folder.exists()
        with pytest.raises(ClusterEndedError, match="before this slave came: the scene cannot be read"):
            meet(folder, rank, 2)
    assert not folder.exists()


def test_a_folder_that_has_been_removed_is_not_made_again(folder: Path) -> None:
    master = Rendezvous(folder, 1)
    folder.rmdir()
    master.close("done")
    assert not folder.exists()


def test_nobody_comes(folder: Path) -> None:
    with pytest.raises(SettingsError, match="same folder on all nodes"):
        meet(folder, 1, 1, patience=0.3)
    Rendezvous(folder, 1)
    with pytest.raises(MasterLostError, match="has not said"):
        meet(folder, 1, 1, patience=0.3)


def test_a_folder_that_others_can_write_to_is_not_believed(folder: Path, tmp_path: Path) -> None:
    folder.mkdir(mode=0o700)
    folder.chmod(0o770)
    with pytest.raises(SettingsError, match="only you can write to"):
        meet(folder, 1, 1)
    folder.rmdir()
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(SettingsError, match="only you can write to"):
        meet(folder, 1, 1)
    with pytest.raises(SettingsError, match="cannot make the folder"):
        Rendezvous(folder, 1)


@pytest.mark.parametrize("text", ["", "tcp://host.name:1 " + "k" * 40, "tcp://127.0.0.1:1 short", "\xff"])
def test_a_file_that_is_none_of_a_master(folder: Path, text: str) -> None:
    Rendezvous(folder, 1)
    (folder / "master").write_text(text)
    with pytest.raises(SettingsError, match="holds no address and key"):
        meet(folder, 1, 1)
