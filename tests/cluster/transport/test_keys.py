"""Keys and addresses: who may listen where."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from wdpm.cluster.transport import address
from wdpm.cluster.transport.transport import Role
from wdpm.cluster.transport.zeromq import key_files
from wdpm.cluster.transport.zeromq.key_files import SLAVES, add_slave, keys_for, load_keys, make_keys
from wdpm.cluster.transport.zeromq.run_keys import RunKeys, slave_keys
from wdpm.scenes.errors import SettingsError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "keys"


@pytest.fixture
def slave_folder(folder: Path) -> Path:
    """That of the slave anna, beside the master's, to which it was added."""
    make_keys(folder)
    public, own = add_slave(folder, "anna")
    assert public == folder / "slaves" / "anna.key"
    return own.rename(folder.parent / "slave-keys")


def files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_keys_are_for_their_owner_only(folder: Path, slave_folder: Path) -> None:
    assert files(folder) == {"master.key", "master.key_secret", "slaves"}
    assert files(slave_folder) == {"slave.key", "slave.key_secret", "master.key"}
    assert all(
        (path / f).stat().st_mode & 0o777 == 0o600 for path in (folder, slave_folder) for f in files(path) - {SLAVES}
    )
    assert files(folder / SLAVES) == {"anna.key"}
    assert folder.stat().st_mode & 0o777 == slave_folder.stat().st_mode & 0o777 == 0o700
    master, slave = load_keys(folder, Role.MASTER), load_keys(slave_folder, Role.SLAVE)
    assert len({master.own.public, master.own.secret, slave.own.public, slave.own.secret}) == 4
    assert master.master == slave.master == master.own.public
    assert master.guests.admits(slave.own.public)
    assert not master.guests.admits(master.own.public)
    assert not slave.guests.admits(master.own.public)
    assert master.own.secret.decode() not in repr(master)


def test_no_two_slaves_have_the_same_keys(folder: Path) -> None:
    make_keys(folder)
    owns = {load_keys(add_slave(folder, name)[1], Role.SLAVE).own.public for name in ("anna", "bert")}
    assert len(owns) == 2
    assert all(map(load_keys(folder, Role.MASTER).guests.admits, owns))


def test_slaves_come_and_go_while_the_master_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(key_files, "_READ_AGAIN_S", 3600.0)
    make_keys(folder)
    first, _ = add_slave(folder, "anna")
    guests = load_keys(folder, Role.MASTER).guests
    _, own = add_slave(folder, "bert")
    bert = load_keys(own, Role.SLAVE).own.public
    assert not guests.admits(bert), "not read again so soon"
    monkeypatch.setattr(key_files, "_READ_AGAIN_S", 0.0)
    assert guests.admits(bert)
    (folder / "slaves" / "carl.key").write_text("half a file")
    first.unlink()
    assert guests.admits(bert)
    (folder / "slaves" / "bert.key").unlink()
    assert not guests.admits(bert)


def test_a_master_whom_nobody_may_join(folder: Path) -> None:
    make_keys(folder)
    with pytest.raises(SettingsError, match="has no key of a slave; make one for each with `wdpm keys add"):
        load_keys(folder, Role.MASTER)


def test_the_masters_folder_is_no_slaves(folder: Path) -> None:
    make_keys(folder)
    with pytest.raises(SettingsError, match=r"has the master's keys; give the slave the folder that `wdpm keys add"):
        load_keys(folder, Role.SLAVE)


@pytest.mark.parametrize("name", ["", "slaves", "../anna", ".", "-x", "a" * 65, "anna/bert"])
def test_what_is_no_name_of_a_slave(folder: Path, name: str) -> None:
    make_keys(folder)
    with pytest.raises(SettingsError, match="is no name of a slave"):
        add_slave(folder, name)


def test_a_name_is_given_once(folder: Path, slave_folder: Path) -> None:
    assert slave_folder.exists()
    with pytest.raises(SettingsError, match=r"anna\.key exists already"):
        add_slave(folder, "anna")


def test_a_slave_of_no_master(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"cannot read the key .*master\.key: no such file"):
        add_slave(tmp_path, "anna")


def test_keys_of_a_run_go_over_a_pipe() -> None:
    run = RunKeys()
    lines = [run.for_slave() for _ in range(2)]
    first, second = map(slave_keys, lines)
    assert first.own != second.own
    assert first.master == second.master == run.master.master
    assert all(run.master.guests.admits(keys.own.public) for keys in (first, second))
    assert not run.master.guests.admits(run.master.own.public)
    assert not RunKeys().master.guests.admits(first.own.public)
    assert first.own.secret in lines[0]
    assert run.master.own.secret not in lines[0]


@pytest.mark.parametrize("line", [b"", b"one two three\n", b"a" * 40 + b"\n"])
def test_standard_input_without_keys(line: bytes) -> None:
    with pytest.raises(SettingsError, match="no keys of a run"):
        slave_keys(line)


def test_keys_are_not_overwritten(folder: Path) -> None:
    make_keys(folder)
    with pytest.raises(SettingsError, match="exists already"):
        make_keys(folder)


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingsError, match="cannot make the folder"):
        make_keys(tmp_path / "file" / "keys")


@pytest.mark.parametrize("name", ["master", "slave"])
def test_a_full_disk_leaves_no_half_of_a_key(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The next try would find a folder that exists already, and no key in it."""
    real = key_files.zmq.auth.create_certificates

    def full(where: Path, name: str) -> tuple[str, str]:
        Path(where, f"{name}.key_secret").touch()
        raise OSError(28, "No space left on device", str(Path(where, f"{name}.key_secret")))

    def make() -> object:
        return make_keys(folder) if name == "master" else add_slave(folder, "anna")

    if name == "slave":
        make_keys(folder)
    before = sorted(folder.rglob("*"))
    monkeypatch.setattr(key_files.zmq.auth, "create_certificates", full)
    with pytest.raises(SettingsError, match=rf"cannot write .*{name}\.key_secret: No space left on device"):
        make()
    assert sorted(folder.rglob("*")) == before
    assert folder.exists() == (name == "slave")
    monkeypatch.setattr(key_files.zmq.auth, "create_certificates", real)
    assert make()


def test_missing_keys(folder: Path) -> None:
    with pytest.raises(SettingsError, match=r"cannot read the key .*master.key_secret"):
        load_keys(folder, Role.MASTER)


@pytest.mark.parametrize(
    "text", ["", "metadata\ncurve\n", 'curve\n    public-key = "short"\n    secret-key = "short"\n']
)
def test_damaged_keys(slave_folder: Path, text: str) -> None:
    (slave_folder / "slave.key_secret").write_text(text)
    with pytest.raises(SettingsError, match=r"slave.key_secret holds no"):
        load_keys(slave_folder, Role.SLAVE)


def test_a_damaged_key_of_a_slave(folder: Path, slave_folder: Path) -> None:
    assert slave_folder.exists()
    (folder / "slaves" / "carl.key").write_text("")
    with pytest.raises(SettingsError, match=r"carl.key holds no key"):
        load_keys(folder, Role.MASTER)


def test_keys_that_others_can_read(slave_folder: Path) -> None:
    (slave_folder / "slave.key_secret").chmod(0o644)
    with pytest.raises(SettingsError, match="chmod 600"):
        load_keys(slave_folder, Role.SLAVE)


@pytest.mark.parametrize(
    ("mode", "owner", "user", "open_to_others"),
    [
        (0o600, 10001, 10001, False),
        (0o640, 10001, 10001, True),
        (0o440, 0, 10001, False),  # as Kubernetes gives a secret to a group
        (0o444, 0, 10001, True),
        (0o440, 0, 0, True),
        (0o440, 10002, 10001, True),
    ],
)
def test_who_can_read_a_key(
    mode: int, owner: int, user: int, open_to_others: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: user)
    found = os.stat_result((stat.S_IFREG | mode, 0, 0, 1, owner, owner, 200, 0, 0, 0))
    assert key_files.is_open_to_others(found) == open_to_others


def test_this_machine_needs_no_keys() -> None:
    assert keys_for("tcp://127.0.0.1:1", None, False, Role.SLAVE) is None
    assert keys_for("tcp://[::1]:1", None, False, Role.SLAVE) is None
    assert keys_for("tcp://10.0.0.1:1", None, True, Role.SLAVE) is None


def test_keys_are_used_where_they_are_given(folder: Path, slave_folder: Path) -> None:
    for role, own in ((Role.MASTER, folder), (Role.SLAVE, slave_folder)):
        keys = keys_for("tcp://10.0.0.1:1", own, False, role)
        assert keys is not None
        assert keys.own == load_keys(own, role).own


@pytest.mark.parametrize("where", ["tcp://10.0.0.1:1", "tcp://0.0.0.0:1", "tcp://[::]:1"])
def test_other_machines_need_keys(where: str) -> None:
    with pytest.raises(SettingsError, match="--keys FOLDER"):
        keys_for(where, None, False, Role.SLAVE)


def test_addresses() -> None:
    assert address.split("tcp://host:80") == ("host", 80)
    assert address.split("tcp://[::1]:80") == ("::1", 80)
    assert address.resolve("tcp://127.0.0.1:80") == "tcp://127.0.0.1:80"
    assert address.resolve("tcp://localhost:80") == "tcp://127.0.0.1:80"
    assert address.resolve("tcp://[::1]:80") == "tcp://[::1]:80"
    assert address.resolve("tcp://*:80") == "tcp://0.0.0.0:80"
    assert address.interface_towards("tcp://127.0.0.1:80") == "127.0.0.1"


@pytest.mark.parametrize("text", ["", "127.0.0.1:80", "tcp://host", "tcp://:80", "tcp://host:-1", "tcp://host:65536"])
def test_what_is_no_address(text: str) -> None:
    with pytest.raises(SettingsError, match="expected tcp://HOST:PORT"):
        address.split(text)


def test_an_unknown_machine() -> None:
    with pytest.raises(SettingsError, match=r"cannot find the machine 'no\.such\.machine\.invalid'"):
        address.resolve("tcp://no.such.machine.invalid:80")
