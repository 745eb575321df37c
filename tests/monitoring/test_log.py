"""What happens to a cluster is told, in order and at once; whoever cannot listen any more disturbs nobody."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from fake_worker import make_session, triangles
from master_driver import EPOCH, A, B, Driver, hello, tasks_of
from slow_slaves import AGREED

from wdpm.cli.main import main
from wdpm.cluster.cluster_events import ClusterEvent
from wdpm.cluster.limits import ClusterLimits
from wdpm.cluster.master import events as m
from wdpm.cluster.master.event_log import EventLog
from wdpm.cluster.master.server import MasterServer
from wdpm.cluster.messages import protocol as p
from wdpm.cluster.task import PhotonsTraced
from wdpm.monitoring.json_log import JsonLog
from wdpm.scenes.errors import ClusterError, SettingsError

PAGE = Path(__file__).resolve().parents[2] / "docs" / "monitoring.md"


class Told:
    """A master whose events are told."""

    def __init__(self) -> None:
        self.events: list[ClusterEvent] = []
        self._driver = Driver()
        self._event_log = EventLog([self.events.append])

    def __call__(self, event: m.Event) -> list[m.Instruction]:
        instructions = self._driver(event)
        self._event_log.tell(event, instructions, self._driver.now)
        return instructions

    def says(self, identity: bytes, message: p.FromSlave) -> list[m.Instruction]:
        return self(m.SlaveSaid(identity, message))

    def of(self, name: str) -> list[dict[str, Any]]:
        """The facts of all events of a name."""
        return [dict(event.facts) for event in self.events if event.name == name]

    def to_photons(self) -> list[m.Instruction]:
        """As far as the first photon tasks."""
        for number, identity in enumerate((A, B)):
            self.says(identity, hello(number))
        self(m.Begin(make_session(2, 2, paths=450)))
        for cell, identity in enumerate((A, B)):
            self(m.PartitionMade(cell, triangles(3)))
            self.says(identity, p.PartitionReceived(EPOCH, cell))
        self.says(A, p.Ready(EPOCH))
        return self.says(B, p.Ready(EPOCH))


def test_slaves_that_join_and_do_not() -> None:
    told = Told()
    told.says(A, hello(7))
    told.says(B, hello(8, {"code": "2"}))
    assert told.of("joined") == [{"slave": 0, "host": "host", "process": 7, "threads": 1, "memory": 0}]
    [refused] = told.of("refused")
    assert refused["process"] == 8
    assert "versions differ" in refused["reason"]


def test_cells_tasks_and_their_times() -> None:
    told = Told()
    out = told.to_photons()
    assert [(sent["slave"], sent["cell"], sent["triangles"]) for sent in told.of("cell sent")] == [(0, 0, 3), (1, 1, 3)]
    assert told.of("cell sent")[0]["bytes"] == sum(array.nbytes for array in vars(triangles(3)).values())
    task = tasks_of(out, A)[0]
    assert {"slave": 0, "task": task.number, "kind": "photons"} in told.of("task")
    told.says(A, p.TaskDone(EPOCH, PhotonsTraced(task.number, task.stop - task.start, 1.0)))
    [done] = told.of("task done")
    assert (done["slave"], done["task"], done["kind"], done["bytes"]) == (0, task.number, "photons", 0)
    assert 0 < done["seconds_taken"] < 0.01
    assert [phase["phase"] for phase in told.of("phase")] == ["partition", "photons"]
    assert told.of("progress")[-1] == {"units": task.stop - task.start}


@pytest.mark.parametrize(
    ("event", "name", "facts"),
    [
        (m.SlaveLost(B, "gone"), "lost", {"slave": 1, "reason": "gone"}),
        (m.SlaveSaid(B, p.Failed("no memory")), "left", {"slave": 1, "reason": "no memory"}),
        (m.SlaveSaid(B, p.PeerGone(0)), "peer gone", {"slave": 1, "peer": 0}),
        (m.ProcessEnded(1, "killed", 1), "process ended", {"process": 1, "reason": "killed"}),
        (m.Close("done", True), "closed", {"reason": "done", "completed": True}),
    ],
)
def test_ends(event: m.Event, name: str, facts: dict[str, Any]) -> None:
    told = Told()
    told.to_photons()
    told(event)
    assert told.of(name) == [facts]


def test_strangers_are_no_slaves() -> None:
    told = Told()
    told.says(b"stranger", p.Failed("x"))
    told(m.SlaveLost(b"stranger", "gone"))
    assert told.events == []


def test_numbers_that_json_does_not_know_are_left_out() -> None:
    told = Told()
    told.to_photons()
    told.says(A, p.Statistics(EPOCH, {"busy_s": float("nan"), "triangles": 3, "cells": [0]}))
    assert told.of("statistics") == [{"slave": 0, "triangles": 3}]


def test_a_log_is_lines_of_json_which_are_there_at_once(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    path.write_text('{"event": "of a render before"}\n')
    log = JsonLog(path, pytest.fail)
    log(ClusterEvent("joined", {"slave": 0, "host": "m\u00fcller\n"}))
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    log.close()
    assert [line["event"] for line in lines] == ["of a render before", "joined"]
    assert lines[1]["host"] == "m\u00fcller\n"
    assert lines[1]["seconds"] >= 0
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}\+00:00", lines[1]["time"])


def test_a_full_disk_ends_the_log_and_not_the_render() -> None:
    said: list[str] = []
    log = JsonLog(Path("/dev/full"), said.append)
    for _ in range(3):
        log(ClusterEvent("note", {"text": "x"}))
    log.close()
    assert said == ["the log /dev/full ends here: No space left on device"]


def test_a_log_that_cannot_be_opened(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SettingsError, match="cannot write the log"):
        JsonLog(tmp_path, pytest.fail)
    assert main(["master", "no-such-scene.xml", "--slaves", "1", "--log", str(tmp_path)]) == 2
    assert "cannot write the log" in capsys.readouterr().err


@pytest.mark.sockets
def test_a_master_tells(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    log = JsonLog(path, pytest.fail)
    limits = ClusterLimits(join_timeout_s=0.2)
    with (
        MasterServer("tcp://127.0.0.1:0", 1, limits=limits, agreed=AGREED, observers=[log]) as master,
        pytest.raises(ClusterError, match="no slave has joined"),
    ):
        master.render(make_session(1, 1))
    log.close()
    names = [json.loads(line)["event"] for line in path.read_text().splitlines()]
    assert names == ["begun", "broken", "closed"]


def test_the_page_lists_all_events() -> None:
    listed = set(re.findall(r"^\| ([a-z, ]+?) \|", PAGE.read_text(), re.MULTILINE)) - {"event", "metric"}
    listed = {name for entry in listed for name in entry.split(", ")}
    code = (Path(__file__).resolve().parents[2] / "cluster" / "master" / "event_log.py").read_text()
    told = Counter(re.findall(r'ClusterEvent\(\s*"([a-z ]+)"', code))
    assert set(told) == listed
