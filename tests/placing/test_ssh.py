"""Slaves over SSH, with an ssh that stays on this machine: what it is told, the same bits, and slaves that are lost."""

from __future__ import annotations

import os
import re
import shlex
import signal
from pathlib import Path
from typing import Any

import pytest
from digests import same_bits
from fake_ssh import calls, make_ssh, make_wdpm
from patience import WAIT_S, wait_until

import wdpm
from wdpm.cli.main import main
from wdpm.cluster.master.events import NotComing, StillAwaited
from wdpm.images.image import load
from wdpm.placing import own_address, ssh_slaves
from wdpm.placing.hosts import Host
from wdpm.placing.ssh_slaves import SshSlaves
from wdpm.scenes.errors import ClusterError, SettingsError

SETTINGS: dict[str, Any] = {"photons": 5000, "spp": 2, "k": 20}
ENDPOINT = "tcp://127.0.0.1:4711"

pytestmark = pytest.mark.processes


@pytest.fixture
def ssh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the ssh that is used."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{make_ssh(folder)}:{os.environ['PATH']}")
    return folder


def ends(slaves: SshSlaves) -> str:
    """Why the slaves have ended."""
    reasons: list[str] = []

    def has_ended() -> list[str]:
        try:
            slaves.ended()
        except ClusterError as error:
            reasons.append(str(error))
        return reasons

    wait_until(has_ended, "the end of the slaves")
    return reasons[0]


def text_of(path: Path) -> str:
    """What a program has written so far."""
    return path.read_text() if path.exists() else ""


def script(folder: Path, text: str) -> str:
    path = folder / "a wdpm's"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.sockets
def test_a_render_over_ssh_has_the_bits_of_one_process(ssh: Path, tmp_path: Path) -> None:
    program = make_wdpm(tmp_path / "a 'wdpm' $PATH")
    image = tmp_path / "box.exr"
    words = ["cornell-box", "--size", "48x40", "--photons", "5k", "--spp", "2", "--k", "20", "-o", str(image), "-q"]
    assert main(["render", *words, "--hosts", "me@bert", "--remote-wdpm", program, "--threads", "1"]) == 0
    assert same_bits(load(image), wdpm.render(wdpm.load("cornell-box", size=(48, 40)), **SETTINGS))
    assert len(load(image).metadata["report"]["slaves"]) == 1
    started = [call for call in calls(ssh) if call[0] != "-G"]
    assert [call[-3:-1] for call in started] == [["--", "me@bert"]]
    assert "BatchMode=yes" in started[0]
    assert shlex.split(started[0][-1])[:2] == [program, "slave"]


@pytest.mark.sockets
def test_a_sequence_keeps_its_slaves(ssh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for number, width in ((1, 40), (2, 48)):
        Path(f"s.{number}.xml").write_text(ROOM.format(width=width))
    words = ["render", "s.%d.xml", "--frames", "1..2", "-q", "--photons", "2k", "--spp", "1", "--max-depth", "3"]
    program = make_wdpm(tmp_path / "wdpm there")
    assert main([*words, "-o", "a.exr", "--hosts", "bert", "--remote-wdpm", program, "--threads", "1"]) == 0
    assert len([call for call in calls(ssh) if call[0] != "-G"]) == 1
    assert main([*words, "-o", "b.exr"]) == 0
    for number in ("0001", "0002"):
        assert load(f"a.{number}.exr").digest() == load(f"b.{number}.exr").digest()


ROOM = """<scene version="3.0.0">
<sensor type="perspective"><film type="hdrfilm"><integer name="width" value="{width}"/>
<integer name="height" value="20"/></film>
<transform name="to_world"><lookat origin="0.1,0.1,-0.8" target="0,0,1" up="0,1,0"/></transform></sensor>
<shape type="cube"><boolean name="flip_normals" value="true"/><bsdf type="diffuse"/></shape>
<emitter type="point"><point name="position" x="0.2" y="0.5" z="0"/></emitter></scene>"""


def test_keys_go_over_standard_input_and_nothing_of_them_is_a_word(
    ssh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    does = ('head -n 1 >> "{0}/keys"', 'echo "$@" >> "{0}/words"', "cat", 'touch "{0}/end"')
    program = script(tmp_path, "\n".join(does).format(tmp_path))
    slaves = SshSlaves([Host("bert", 2)], program)
    slaves.start(ENDPOINT, lambda: b"a line of keys\n")
    wait_until(lambda: text_of(tmp_path / "words").count("\n") == 2, "the start of both slaves", slaves.ended)
    assert (tmp_path / "keys").read_text() == 2 * "a line of keys\n"
    said = f"slave {ENDPOINT} --keys - --life-line --device cpu --share 2\n"
    assert (tmp_path / "words").read_text() == 2 * said
    assert not [word for call in calls(ssh) for word in call if "line of keys" in word]
    assert not (tmp_path / "end").exists()
    monkeypatch.setattr(ssh_slaves, "GRACE_S", WAIT_S)
    slaves.stop()  # closes the connection, and with it the standard input of what runs there
    assert (tmp_path / "end").exists()


@pytest.mark.parametrize(
    ("host", "text", "said"),
    [
        ("deaf", "", "no slave runs on deaf: .*exit code 255: ssh: connect to host deaf port 22: Connection refused"),
        ("anna", "echo 'a fault' >&2; exit 1", "no slave runs on anna: .*exit code 1: a fault"),
    ],
)
@pytest.mark.usefixtures("ssh")
def test_a_slave_that_does_not_start_is_an_error(host: str, text: str, said: str, tmp_path: Path) -> None:
    slaves = SshSlaves([Host(host)], script(tmp_path, text))
    slaves.start(ENDPOINT, bytes)
    assert re.search(said, ends(slaves))
    slaves.stop()


@pytest.mark.sockets
@pytest.mark.usefixtures("ssh")
@pytest.mark.parametrize(
    ("host", "timeout", "said"),
    [
        ("deaf", "100s", "no slave runs on deaf: .*Connection refused; 1 other is there"),
        ("mute", "8s", "1 of 2 slaves have joined"),
    ],
    ids=["does not start", "hangs"],
)
def test_a_slave_that_does_not_come_is_not_waited_for_long(
    host: str, timeout: str, said: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    image = tmp_path / "box.exr"
    words = ["cornell-box", "--size", "48x40", "--photons", "5k", "--spp", "2", "--k", "20", "-o", str(image)]
    words += ["--hosts", f"{host},bert", "--remote-wdpm", make_wdpm(tmp_path / "wdpm there"), "--threads", "1"]
    assert main(["render", *words, "--join-timeout", timeout]) == 0
    assert re.search(said, capfd.readouterr().err)
    assert same_bits(load(image), wdpm.render(wdpm.load("cornell-box", size=(48, 40)), **SETTINGS))


@pytest.mark.usefixtures("ssh")
def test_a_person_hears_once_what_ssh_said_of_slaves_that_do_not_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = script(tmp_path, "echo 'wdpm slave: joined tcp://127.0.0.1:1 as slave 0' >&2; cat")
    slaves = SshSlaves([Host("mute"), Host("touch"), Host("bert")], program)
    slaves.start(ENDPOINT, bytes)
    wait_until(lambda: all(place.process and place.process.last_line for place in slaves._places[1:]), "words of ssh")
    assert list(slaves.ended()) == []
    monkeypatch.setattr(ssh_slaves, "QUIET_S", 0.0)
    assert list(slaves.ended()) == [
        StillAwaited("mute: no slave has joined from there for 0 s; ssh has said nothing"),
        StillAwaited(
            "touch: no slave has joined from there for 0 s; ssh has said last: Confirm user presence for key ED25519-SK"
        ),
    ]
    assert list(slaves.ended()) == []
    monkeypatch.setattr(ssh_slaves, "GRACE_S", 0.0)
    slaves.stop()


@pytest.mark.usefixtures("ssh")
def test_a_configuration_that_ssh_does_not_take_is_one_line() -> None:
    with pytest.raises(SettingsError, match=r"^--hosts needs .*: ssh -G -- odd: Bad owner or permissions on /home/me"):
        SshSlaves([Host("odd")])


def test_a_slave_that_did_not_start_is_tried_again_once_the_others_render(
    ssh: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def calls_of_deaf() -> int:
        return len([call for call in calls(ssh) if call[-2:-1] == ["deaf"] and call[0] != "-G"])

    monkeypatch.setattr(ssh_slaves, "FIRST_WAIT_S", 0.0)
    slaves = SshSlaves([Host("deaf"), Host("bert")], script(tmp_path, "cat"))
    slaves.start(ENDPOINT, bytes)
    not_coming: list[NotComing] = []
    wait_until(lambda: not_coming.extend(slaves.ended()) or not_coming, "the end of the slave on deaf")
    assert [event.left for event in not_coming] == [1]
    assert not list(slaves.ended())
    assert calls_of_deaf() == 1  # not while others are waited for
    slaves.all_joined()
    wait_until(lambda: slaves.ended() or calls_of_deaf() == 2, "another try")
    slaves.stop()


@pytest.mark.usefixtures("ssh")
def test_a_lost_slave_is_started_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ssh_slaves, "FIRST_WAIT_S", 0.01)
    slaves = SshSlaves([Host("anna")], script(tmp_path, f'echo $$ >> "{tmp_path}/started"; cat'))
    started = tmp_path / "started"
    slaves.start(ENDPOINT, bytes)
    wait_until(lambda: text_of(started), "the first start", slaves.ended)
    slaves.all_joined()
    for times in (2, 3):
        os.kill(int(started.read_text().split()[-1]), signal.SIGKILL)
        wait_until(lambda times=times: len(text_of(started).split()) == times, f"start {times}", slaves.ended)
    slaves.stop()
    assert len(started.read_text().split()) == 3


@pytest.mark.usefixtures("ssh")
@pytest.mark.parametrize(("code", "times"), [(2, 1), (1, 3)])
def test_a_slave_that_always_fails_is_given_up(
    code: int, times: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ssh_slaves, "FIRST_WAIT_S", 0.01)
    monkeypatch.setattr(ssh_slaves, "MOST_TRIES", 2)
    slaves = SshSlaves([Host("anna")], script(tmp_path, f'echo x >> "{tmp_path}/started"; exit {code}'))
    slaves.all_joined()
    slaves.start(ENDPOINT, bytes)
    assert f"no slave is left: anna: it ended with exit code {code}" in ends(slaves)
    assert (tmp_path / "started").read_text().count("x") == times
    slaves.no_more()
    assert slaves.ended() == ()
    slaves.stop()


def test_the_number_that_others_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = {"tcp://127.0.0.1:1": "127.0.0.1", "tcp://10.0.0.2:1": "10.0.0.1"}
    monkeypatch.setattr(own_address.address, "interface_towards", numbers.__getitem__)
    assert own_address.address_towards(["127.0.0.1"]) == "127.0.0.1"
    assert own_address.address_towards(["127.0.0.1", "10.0.0.2"]) == "10.0.0.1"
    assert own_address.listening_address("127.0.0.1") == "tcp://127.0.0.1:0"
    assert own_address.listening_address("10.0.0.1") == "tcp://*:0"
    assert own_address.reached_at("10.0.0.1", "tcp://0.0.0.0:4711") == "tcp://10.0.0.1:4711"


def test_no_ssh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SettingsError, match="there is no program ssh"):
        SshSlaves([Host("anna")])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--hosts=-oProxyCommand=ls"], "is no host"),
        (["--hosts", "anna", "--slaves", "2"], "--hosts and --slaves contradict each other"),
        (["--slaves", "2", "--join-timeout", "9s"], "--join-timeout goes with --slurm or --dask or --hosts"),
        (["--dask", "tcp://127.0.0.1:1", "--threads", "2"], "leave --threads and --memory out"),
        (["--dask", "tcp://127.0.0.1:1", "--replay", "1,1,1"], "--dask and --replay contradict each other"),
    ],
)
def test_what_cannot_be_asked_for(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "cornell-box", *words]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert said in line
