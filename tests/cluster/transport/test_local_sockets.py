"""Sockets in a folder: who may use them, and that nothing is left behind."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
from argparse import ArgumentTypeError
from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_worker import make_session
from patience import WAIT_S, wait_until
from slave_threads import SMALL, SlaveThread, check_picture
from slow_slaves import AGREED

import wdpm
from wdpm import values
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.messages import packing, protocol
from wdpm.cluster.transport import local_sockets
from wdpm.cluster.transport.fork_server import can_serve
from wdpm.cluster.transport.parent_watch import has_ended
from wdpm.cluster.transport.transport import Role
from wdpm.cluster.transport.zeromq.network import ZeroMQTransport
from wdpm.cluster.transport.zeromq.run_keys import RunKeys, slave_keys
from wdpm.scenes.errors import ClusterError, SettingsError

pytestmark = [pytest.mark.sockets, pytest.mark.skipif(os.name != "posix", reason="folders here have no mode")]

FROM_SLAVE = packing.by_name(protocol.FromSlave)


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder that only its owner enters. Those of pytest have longer paths than a socket may have."""
    with tempfile.TemporaryDirectory() as made:
        yield Path(made)


def test_a_cluster_leaves_nothing_in_the_folder(folder: Path) -> None:
    with MasterServer(f"ipc://{folder}/master", 2, limits=SMALL, agreed=AGREED) as master:
        slaves = [SlaveThread(master.endpoint) for _ in range(2)]
        session = make_session(2, 4)
        check_picture(session, master.render(session).layers)
        assert len(list(folder.iterdir())) == 3
    assert [slave.end() for slave in slaves] == [None, None]
    assert list(folder.iterdir()) == []


def test_the_folder_of_a_master_is_its_owners_alone_and_is_removed() -> None:
    with local_sockets.address_for_master() as address:
        assert address is not None
        assert local_sockets.resolve(address) == address
        made = Path(address.removeprefix("ipc://")).parent
        assert made.stat().st_mode & 0o777 == 0o700
        (made / "slave").touch()
    assert not made.exists()


def test_a_folder_for_temporary_files_that_is_gone_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", "/no/such/folder")
    with pytest.raises(SettingsError, match=r"\(No such file or directory\); set TMPDIR to a folder that"):
        wdpm.Cluster.local(slaves=1)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("relative", "expected ipc:// and a path from /"),
        ("/" + 110 * "a", "of at most 100 bytes"),
        (
            "/no-such-folder/master",
            "its folder is not there, or no longer; see that nothing clears /no-such-folder, where the sockets are, or",
        ),
    ],
)
def test_addresses_that_are_none(name: str, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        local_sockets.resolve(f"ipc://{name}")


def test_a_folder_that_others_can_enter_is_refused(folder: Path) -> None:
    folder.chmod(0o750)
    network = ZeroMQTransport().open(None)
    with pytest.raises(SettingsError, match="others can enter its folder; expected one of mode 700"):
        network.listen(f"ipc://{folder}/master", Role.MASTER, FROM_SLAVE)
    with pytest.raises(ClusterError, match=r"cannot connect: cannot use ipc://.* others can enter its folder"):
        network.connect(f"ipc://{folder}/master", Role.MASTER, {})
    network.close()


def test_who_has_keys_is_not_led_to_a_socket_without(folder: Path) -> None:
    network = ZeroMQTransport().open(slave_keys(RunKeys().for_slave()))
    for use in (network.listen, network.connect):
        with pytest.raises(ClusterError, match="takes no keys, and there are some here"):
            use(f"ipc://{folder}/master", Role.SLAVE, {})
    network.close()


@pytest.mark.parametrize("name", [90 * "a", "jürgen"])
def test_where_paths_are_too_long_or_odd_slaves_get_keys(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deep = folder / name
    deep.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(deep))
    with wdpm.Cluster.local(slaves=1) as cluster:
        assert cluster.endpoint.startswith("tcp://127.0.0.1:")
        assert len(cluster._master.slaves()) == 1
    assert list(deep.iterdir()) == []


def test_the_last_slave_of_a_master_that_was_killed_removes_its_folder(folder: Path) -> None:
    own = folder / "run"
    own.mkdir(mode=0o700)
    (own / "master").touch()
    (own / "of another slave").touch()
    (own / "owner").touch()
    command = [sys.executable, "-m", "wdpm", "slave", f"ipc://{own}/master", "--life-line"]

    def slave_ends() -> None:
        ended = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=WAIT_S)
        assert b"the process that started it has ended" in ended.stderr

    slave_ends()
    assert {path.name for path in own.iterdir()} == {"of another slave", "owner"}
    (own / "of another slave").unlink()
    slave_ends()
    assert not own.exists()


STARTS_SLAVES = """
import sys, time
from wdpm.cluster.master.local_slaves import LocalSlaves, slave_command
slaves = LocalSlaves()
slaves.start(2, slave_command(1, "cpu", keyed=False), sys.argv[1], forked=True)
print(*slaves.processes, flush=True)
time.sleep(1e6)
"""
"""A process with slaves that are forked, and with nobody who listens where they look for their master."""


@pytest.mark.skipif(not can_serve(), reason="this system forks no slaves")
def test_what_slaves_were_forked_from_clears_away_what_is_left_of_them_and_of_their_master(folder: Path) -> None:
    """They were stopped when it was killed, and killed as well then."""
    own = folder / "run"
    own.mkdir(mode=0o700)
    for name in ("master", "of-a-slave"):
        with socket.socket(socket.AF_UNIX) as left:
            left.bind(str(own / name))
    command = [sys.executable, "-c", STARTS_SLAVES, f"ipc://{own}/master"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as master:
        assert master.stdout is not None
        slaves = [int(number) for number in master.stdout.readline().split()]
        for slave in slaves:
            os.kill(slave, signal.SIGSTOP)
        master.kill()
    assert len(slaves) == 2
    assert own.exists()
    for slave in slaves:
        os.kill(slave, signal.SIGKILL)
    wait_until(lambda: not own.exists(), "its end")


def test_whether_the_other_end_of_a_life_line_has_let_go() -> None:
    here, there = os.pipe()
    assert not has_ended(here)
    os.close(there)
    assert has_ended(here)
    os.close(here)


def test_the_command_line_takes_such_an_address_for_a_slave_only() -> None:
    assert values.address_of_master("ipc:///run/x/master") == "ipc:///run/x/master"
    assert values.address_of_master("tcp://127.0.0.1:7117") == "tcp://127.0.0.1:7117"
    with pytest.raises(ArgumentTypeError, match="expected tcp://HOST:PORT"):
        values.address("ipc:///run/x/master")
    with pytest.raises(ArgumentTypeError, match="expected tcp://HOST:PORT"):
        values.address_of_master("ipc://run")
