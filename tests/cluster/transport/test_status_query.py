"""`wdpm status` over sockets: with keys of a reader and without, against whoever answers what."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from fake_worker import FakeWorker, make_session
from free_ports import free_port
from patience import WAIT_S
from slave_threads import SMALL, SlaveThread, check_picture
from slow_slaves import AGREED

from wdpm.cli.main import main
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.slave.process import run_slave
from wdpm.cluster.status_query import ask_status
from wdpm.cluster.transport.transport import Role
from wdpm.cluster.transport.zeromq.key_files import load_keys, make_keys
from wdpm.scenes.errors import ClusterError

pytestmark = [pytest.mark.sockets, pytest.mark.processes]

PATIENT = ("--timeout", f"{WAIT_S:g}s")
NO_ANSWER = 75
"""The exit code."""

HEADINGS = "slave host process threads memory now peak cores in out team cells tasks done s a task silent"


def test_a_master_without_keys_answers(capsys: pytest.CaptureFixture[str]) -> None:
    with MasterServer("tcp://127.0.0.1:0", 1, limits=SMALL, agreed=AGREED) as master:
        assert ask_status(master.endpoint, None, WAIT_S).phase == "joining"
        slave = SlaveThread(master.endpoint)
        session = make_session(1, 1)
        check_picture(session, master.render(session).layers)
        assert main(["status", master.endpoint, "--json", *PATIENT]) == 0
        report = json.loads(capsys.readouterr().out)
        assert (report["phase"], report["images"], report["left_s"]) == ("idle", 1, None)
        assert report["slaves"][0]["done"] > 0
        assert main(["status", master.endpoint, *PATIENT]) == 0
        printed = capsys.readouterr().out
        assert "slaves: 1 of 1 (at most 1); 1 joined, 0 lost, 0 refused" in printed
        # Whatever the width of the terminal (here 80), no heading or figure is cut to a letter or two.
        assert printed.splitlines()[2].split() == HEADINGS.split()
        assert "…" not in printed
        check_picture(session, master.render(session).layers)
    assert slave.end() is None


def test_readers_look_and_do_nothing_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Keys of a reader, of a slave and of the master serve; a reader is no slave, and a stranger is nobody."""
    folder = tmp_path / "keys"
    for words in ([str(folder)], ["add", str(folder), "anna"], ["add-reader", str(folder), "bob"]):
        assert main(["keys", *words]) == 0
    make_keys(tmp_path / "others")
    assert main(["keys", "add", str(tmp_path / "others"), "eve"]) == 0
    with MasterServer(
        "tcp://127.0.0.1:0", 1, limits=SMALL, agreed=AGREED, security=load_keys(folder, Role.MASTER)
    ) as master:
        for keys in (folder / "bob", folder / "anna", folder):
            assert main(["status", master.endpoint, "--keys", str(keys), *PATIENT]) == 0
        bob = load_keys(folder / "bob", Role.SLAVE)
        with pytest.raises(ClusterError, match="these are keys of a reader"):
            run_slave(master.endpoint, FakeWorker, security=bob, agreed=AGREED, tell=lambda _: None)
        slave = SlaveThread(master.endpoint, security=load_keys(folder / "anna", Role.SLAVE))
        session = make_session(1, 1)
        check_picture(session, master.render(session).layers)
        capsys.readouterr()
        eve = str(tmp_path / "others" / "eve")
        for options in ([], ["--keys", eve]):
            for timeout in ("1s", "10s", "100s"):  # a refusal may be late
                code = main(["status", master.endpoint, "--timeout", timeout, *options])
                if code != NO_ANSWER:
                    break
            assert code in (1, 2)
            assert "keys" in capsys.readouterr().err
    assert slave.end() is None


def test_nobody_answers(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["status", f"tcp://127.0.0.1:{free_port()}", "--timeout", "0.5"]) == NO_ANSWER
    assert "no master answers at" in capsys.readouterr().err
