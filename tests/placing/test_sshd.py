"""A slave over a real SSH connection, to a server of this machine that runs for the test."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from digests import same_bits
from fake_ssh import make_wdpm
from free_ports import free_port
from patience import WAIT_S

import wdpm
from wdpm.scenes.errors import ClusterError

SSHD = shutil.which("sshd", path=f"{os.environ.get('PATH', os.defpath)}:/usr/sbin")
MISSING = SSHD is None or os.geteuid() != 0

pytestmark = [
    pytest.mark.sshd,
    pytest.mark.skipif(MISSING, reason="needs OpenSSH's server, and to be root: make test-ssh installs it"),
]

SERVER = """\
ListenAddress 127.0.0.1
Port {port}
HostKey {folder}/host
AuthorizedKeysFile {folder}/user.pub
PidFile none
StrictModes no
UsePAM no
PasswordAuthentication no
"""

CLIENT = """\
Host anna
    HostName 127.0.0.1
    Port {port}
    IdentityFile {folder}/user
    IdentitiesOnly yes
    UserKnownHostsFile {folder}/known
    StrictHostKeyChecking accept-new
"""


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A server that `ssh anna` reaches; gives its folder."""
    port = free_port()
    for name in ("host", "user"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", tmp_path / name], check=True)
    (tmp_path / "server").write_text(SERVER.format(port=port, folder=tmp_path))
    (tmp_path / "client").write_text(CLIENT.format(port=port, folder=tmp_path))
    client = tmp_path / "ssh"
    client.write_text(f'#!/bin/sh\nexec {shutil.which("ssh")} -F {tmp_path}/client "$@"\n')
    client.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    Path("/run/sshd").mkdir(exist_ok=True)
    assert SSHD is not None
    with subprocess.Popen([SSHD, "-D", "-e", "-f", tmp_path / "server"], stderr=subprocess.DEVNULL) as daemon:
        try:
            until_it_listens(port)
            yield tmp_path
        finally:
            daemon.terminate()


def until_it_listens(port: int) -> None:
    deadline = time.monotonic() + WAIT_S
    while True:
        try:
            socket.create_connection(("127.0.0.1", port)).close()
        except OSError:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        else:
            return


def program(folder: Path) -> str:
    """`wdpm` with this interpreter and this checkout: a login over SSH has an environment of its own."""
    path = folder / "a 'wdpm' of $mine"
    make_wdpm(path)
    package = Path(wdpm.__file__).parent.parent
    path.write_text(path.read_text().replace("exec ", f"export PYTHONPATH='{package}'\nexec "))
    return str(path)


def test_a_slave_over_ssh(server: Path) -> None:
    scene = wdpm.load("cornell-box", size=(48, 40))
    settings = {"photons": 5000, "spp": 2, "k": 20}
    with wdpm.Cluster.over_ssh(["anna:2"], remote_wdpm=program(server)) as cluster:
        image = cluster.render(scene, **settings)
    assert len(image.metadata["report"]["slaves"]) == 2
    assert same_bits(image, wdpm.render(scene, **settings))


def test_a_key_that_the_server_does_not_know(server: Path) -> None:
    (server / "user.pub").write_text("")
    with (
        wdpm.Cluster.over_ssh(["anna"], remote_wdpm=program(server)) as cluster,
        pytest.raises(ClusterError, match=r"no slave runs on anna: .*255.*Permission denied"),
    ):
        cluster.render("cornell-box")
