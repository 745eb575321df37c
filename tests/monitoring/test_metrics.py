"""Metrics are what happened, as Prometheus reads them."""

from __future__ import annotations

import argparse
import re
import socket
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from io import StringIO
from pathlib import Path

import pytest
from patience import WAIT_S

from wdpm.cli.monitoring import observers
from wdpm.cluster.cluster_events import ClusterEvent
from wdpm.monitoring import metrics_server
from wdpm.monitoring.metrics import Metrics
from wdpm.monitoring.metrics_server import AT_ONCE
from wdpm.scenes.errors import SettingsError
from wdpm.view.address import ViewAddress

pytestmark = pytest.mark.processes

parser = pytest.importorskip("prometheus_client.parser", reason="the extra `metrics` is not installed")


@pytest.fixture
def metrics() -> Iterator[Metrics]:
    served = Metrics("127.0.0.1", 0)
    yield served
    served.close()


def read(metrics: Metrics) -> dict[tuple[str, ...], float]:
    """Name and labels of each sample -> its value."""
    with urllib.request.urlopen(f"http://127.0.0.1:{metrics.port}/metrics", timeout=WAIT_S) as page:
        families = list(parser.text_string_to_metric_families(page.read().decode()))
    return {(s.name, *s.labels.values()): s.value for family in families for s in family.samples}


ALL = {
    "wdpm_slaves",
    "wdpm_slaves_lost_total",
    "wdpm_slaves_refused_total",
    "wdpm_phase",
    "wdpm_phase_units",
    "wdpm_phase_units_done",
    "wdpm_tasks_total",
    "wdpm_task_seconds",
    "wdpm_cell_bytes_sent_total",
    "wdpm_result_bytes_received_total",
    "wdpm_images_total",
    "wdpm_slave_triangles",
    "wdpm_slave_peak_memory_bytes",
    "wdpm_slave_bytes_in",
    "wdpm_slave_bytes_out",
    "wdpm_slave_rays_in",
    "wdpm_slave_rays_out",
    "wdpm_slave_busy_s",
}


def test_the_page_lists_all_metrics(metrics: Metrics) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "monitoring.md").read_text()
    assert set(re.findall(r"`(wdpm_\w+)`", page)) == ALL
    families = list(metrics._registry.collect())
    named = {family.name + ("_total" if family.type == "counter" else "") for family in families}
    assert named == ALL


def test_slaves_come_and_go(metrics: Metrics) -> None:
    for number in (0, 1):
        metrics(ClusterEvent("joined", {"slave": number}))
    metrics(ClusterEvent("left", {"slave": 1, "reason": "x"}))
    metrics(ClusterEvent("lost", {"slave": 1, "reason": "x"}))
    metrics(ClusterEvent("refused", {"reason": "x"}))
    now = read(metrics)
    assert now["wdpm_slaves",] == 1
    assert now["wdpm_slaves_lost_total",] == 1
    assert now["wdpm_slaves_refused_total",] == 1


def test_a_phase_and_its_work(metrics: Metrics) -> None:
    metrics(ClusterEvent("phase", {"phase": "photons", "units": 10}))
    metrics(ClusterEvent("progress", {"units": 4}))
    now = read(metrics)
    assert now["wdpm_phase", "photons"] == 1
    assert (now["wdpm_phase_units",], now["wdpm_phase_units_done",]) == (10, 4)
    metrics(ClusterEvent("rendered"))
    now = read(metrics)
    assert ("wdpm_phase", "photons") not in now
    assert (now["wdpm_phase", "idle"], now["wdpm_images_total",]) == (1, 1)


def test_tasks_and_bytes(metrics: Metrics) -> None:
    metrics(ClusterEvent("task", {"slave": 0, "task": 1, "kind": "bucket"}))
    done = {"slave": 0, "task": 1, "kind": "bucket", "seconds_taken": 0.2, "bytes": 64}
    metrics(ClusterEvent("task done", done))
    metrics(ClusterEvent("cell sent", {"slave": 0, "bytes": 140}))
    metrics(ClusterEvent("statistics", {"slave": 0, "bytes_out": 7}))
    metrics(ClusterEvent("note", {"text": "x"}))
    now = read(metrics)
    assert now["wdpm_tasks_total", "bucket", "0"] == 1
    assert now["wdpm_task_seconds_sum", "bucket"] == 0.2
    assert now["wdpm_task_seconds_bucket", "bucket", "0.1"] == 0
    assert now["wdpm_task_seconds_bucket", "bucket", "0.3"] == 1
    assert now["wdpm_result_bytes_received_total", "0"] == 64
    assert now["wdpm_cell_bytes_sent_total", "0"] == 140
    assert now["wdpm_slave_bytes_out", "0"] == 7


def test_visitors_do_not_take_all_files_of_the_render(metrics: Metrics, monkeypatch: pytest.MonkeyPatch) -> None:
    """One too many is hung up on, one that says nothing is hung up on later, and nothing is said of either."""
    monkeypatch.setattr(metrics_server._Visit, "timeout", 0.5)
    told = StringIO()
    monkeypatch.setattr(sys, "stderr", told)
    visitors = [socket.create_connection(("127.0.0.1", metrics.port), timeout=WAIT_S) for _ in range(AT_ONCE + 1)]
    with suppress(ConnectionResetError):
        assert visitors[-1].recv(1) == b""
    for visitor in visitors:
        with suppress(ConnectionResetError):
            assert visitor.recv(1) == b""
        visitor.close()
    assert read(metrics)
    assert told.getvalue() == ""


def test_what_nobody_can_answer_is_told_to_the_visitor_alone(metrics: Metrics, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some versions of prometheus-client raise then."""
    told = StringIO()
    monkeypatch.setattr(sys, "stderr", told)
    asked = urllib.request.Request(
        f"http://127.0.0.1:{metrics.port}/metrics", headers={"Accept": "application/openmetrics-text; version=x"}
    )
    with suppress(urllib.error.HTTPError), urllib.request.urlopen(asked, timeout=WAIT_S):
        pass
    assert read(metrics)
    assert told.getvalue() == ""


def test_the_address_that_a_person_is_told_can_be_opened(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = argparse.Namespace(log=None, metrics=ViewAddress("::1", 0))
    try:
        with observers(arguments):
            url = capsys.readouterr().err.removeprefix("wdpm: metrics: ").strip()
            assert urllib.request.urlopen(url, timeout=WAIT_S).status == 200
    except SettingsError as error:
        pytest.skip(f"this machine has no IPv6: {error}")


def test_a_port_that_is_taken() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(SettingsError, match=f"cannot serve metrics at 127.0.0.1:{port}: Address already in use"):
            Metrics("127.0.0.1", port)


def test_without_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    with pytest.raises(SettingsError, match=r"pip install 'wdpm\[metrics\]'"):
        Metrics("127.0.0.1", 0)
