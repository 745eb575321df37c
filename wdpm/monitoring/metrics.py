"""Metrics of a cluster for Prometheus, at http://HOST:PORT/metrics."""

from __future__ import annotations

from typing import Any

from wdpm.cluster.cluster_events import ClusterEvent
from wdpm.monitoring.metrics_server import MetricsServer
from wdpm.scenes.errors import SettingsError

SECONDS = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
"""Bounds of the buckets of times of tasks [s]."""

STATISTICS = ("triangles", "peak_memory_bytes", "bytes_in", "bytes_out", "rays_in", "rays_out", "busy_s")
"""Of a slave's statistics, those that are worth a curve."""


class Metrics:
    """Counts what happens, and serves the counts.

    Args:
        port: 0 takes a free one.

    Raises:
        SettingsError: prometheus-client is not installed, or nobody can listen there.
    """

    def __init__(self, host: str, port: int) -> None:
        try:
            from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, make_wsgi_app
        except ModuleNotFoundError:
            raise SettingsError("metrics need prometheus-client: pip install 'wdpm[metrics]'") from None
        self._registry = registry = CollectorRegistry()
        options: dict[str, Any] = {"registry": registry}
        self._slaves = Gauge("wdpm_slaves", "Slaves that have joined and are not known to be lost", **options)
        self._lost = Counter("wdpm_slaves_lost", "Slaves that were lost, or left", **options)
        self._refused = Counter("wdpm_slaves_refused", "Slaves that were not let join", **options)
        self._phase = Gauge("wdpm_phase", "1 for the phase that a render is in", ["phase"], **options)
        self._units = Gauge("wdpm_phase_units", "Units of work of the phase", **options)
        self._done = Gauge("wdpm_phase_units_done", "Units of work of the phase that are done", **options)
        self._tasks = Counter("wdpm_tasks", "Tasks that were handed out", ["kind", "slave"], **options)
        self._seconds = Histogram(
            "wdpm_task_seconds", "Time from a task's handing out to its result", ["kind"], buckets=SECONDS, **options
        )
        self._sent = Counter("wdpm_cell_bytes_sent", "Bytes of triangles sent to slaves", ["slave"], **options)
        self._received = Counter("wdpm_result_bytes_received", "Bytes of results of tasks", ["slave"], **options)
        self._images = Counter("wdpm_images", "Images, or passes, that are rendered", **options)
        self._statistics = {
            name: Gauge(f"wdpm_slave_{name}", f"A slave's {name}, as it last said", ["slave"], **options)
            for name in STATISTICS
        }
        self._joined: set[object] = set()
        try:
            self._server = MetricsServer(host, port, make_wsgi_app(registry))
        except OSError as error:
            raise SettingsError(f"cannot serve metrics at {host}:{port}: {error.strerror}") from None
        self.port: int = self._server.server_port

    def __call__(self, event: ClusterEvent) -> None:
        """Count it."""
        facts = event.facts
        match event.name:
            case "joined":
                self._joined.add(facts["slave"])
            case "lost" | "left":
                if facts["slave"] in self._joined:
                    self._joined.discard(facts["slave"])
                    self._lost.inc()
            case "refused":
                self._refused.inc()
            case "phase":
                self._begin_phase(str(facts["phase"]), facts["units"])
            case "progress":
                self._done.inc(float(facts["units"]))
            case "rendered":
                self._begin_phase("idle", 0)
                self._images.inc()
            case "task" | "task done" | "cell sent" | "statistics":
                self._of_slave(event, str(facts["slave"]))
        self._slaves.set(len(self._joined))

    def _begin_phase(self, phase: str, units: Any) -> None:
        self._phase.clear()
        self._phase.labels(phase).set(1)
        self._units.set(units)
        self._done.set(0)

    def _of_slave(self, event: ClusterEvent, slave: str) -> None:
        facts = event.facts
        match event.name:
            case "task":
                self._tasks.labels(facts["kind"], slave).inc()
            case "task done":
                self._seconds.labels(facts["kind"]).observe(float(facts["seconds_taken"]))
                self._received.labels(slave).inc(float(facts["bytes"]))
            case "cell sent":
                self._sent.labels(slave).inc(float(facts["bytes"]))
            case "statistics":
                for name, gauge in self._statistics.items():
                    if name in facts:
                        gauge.labels(slave).set(float(facts[name]))

    def close(self) -> None:
        """Serve nothing any more."""
        self._server.close()
