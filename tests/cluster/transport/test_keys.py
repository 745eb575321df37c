"""Keys and addresses: who may listen where."""

from __future__ import annotations

from pathlib import Path

import pytest

from wdpm.cluster.transport import address
from wdpm.cluster.transport.transport import Role
from wdpm.cluster.transport.zeromq.key_files import keys_for, load_keys, make_keys
from wdpm.cluster.transport.zeromq.run_keys import make_run_keys, slave_keys
from wdpm.scenes.errors import SettingsError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "keys"


def test_keys_are_for_their_owner_only(folder: Path) -> None:
    paths = make_keys(folder)
    assert {path.name for path in paths} == {"master.key", "master.key_secret", "slave.key", "slave.key_secret"}
    assert all(path.stat().st_mode & 0o777 == 0o600 for path in paths)
    assert folder.stat().st_mode & 0o777 == 0o700
    master, slave = load_keys(folder, Role.MASTER), load_keys(folder, Role.SLAVE)
    assert len({master.own.public, master.own.secret, slave.own.public, slave.own.secret}) == 4
    assert (master.master, master.slave) == (slave.master, slave.slave) == (master.own.public, slave.own.public)
    assert master.own.secret.decode() not in repr(master)


def test_a_slave_needs_no_secret_of_the_master(folder: Path) -> None:
    make_keys(folder)
    (folder / "master.key_secret").unlink()
    load_keys(folder, Role.SLAVE)
    with pytest.raises(SettingsError, match=r"cannot read the key .*master.key_secret"):
        load_keys(folder, Role.MASTER)


def test_keys_of_a_run_go_over_a_pipe() -> None:
    master, line = make_run_keys()
    slave = slave_keys(line)
    assert (master.master, master.slave) == (slave.master, slave.slave)
    assert slave.own.public == slave.slave
    assert slave.own.secret in line
    assert master.own.secret not in line
    assert make_run_keys().line != line


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


def test_missing_keys(folder: Path) -> None:
    with pytest.raises(SettingsError, match=r"cannot read the key .*master.key_secret"):
        load_keys(folder, Role.MASTER)


@pytest.mark.parametrize(
    "text", ["", "metadata\ncurve\n", 'curve\n    public-key = "short"\n    secret-key = "short"\n']
)
def test_damaged_keys(folder: Path, text: str) -> None:
    make_keys(folder)
    (folder / "slave.key_secret").write_text(text)
    with pytest.raises(SettingsError, match=r"slave.key_secret holds no"):
        load_keys(folder, Role.SLAVE)


def test_keys_that_others_can_read(folder: Path) -> None:
    make_keys(folder)
    (folder / "slave.key_secret").chmod(0o644)
    with pytest.raises(SettingsError, match="chmod 600"):
        load_keys(folder, Role.SLAVE)


def test_this_machine_needs_no_keys(folder: Path) -> None:
    assert keys_for("tcp://127.0.0.1:1", None, False, Role.SLAVE) is None
    assert keys_for("tcp://[::1]:1", None, False, Role.SLAVE) is None
    assert keys_for("tcp://10.0.0.1:1", None, True, Role.SLAVE) is None
    make_keys(folder)
    assert keys_for("tcp://10.0.0.1:1", folder, False, Role.MASTER) == load_keys(folder, Role.MASTER)


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
