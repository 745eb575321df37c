"""Options of commands that lead a cluster: who is told what happens to it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from wdpm.cluster.cluster_events import ClusterObserver
from wdpm.view.address import view_address


def add_monitoring_options(parser: argparse.ArgumentParser) -> None:
    """--log and --metrics."""
    group = parser.add_argument_group("monitoring (docs/monitoring.md; changes no bit of the image)")
    group.add_argument(
        "--log", type=Path, metavar="FILE", help="append what happens to the cluster to a file, a JSON object a line"
    )
    group.add_argument(
        "--metrics",
        type=view_address,
        metavar="[HOST:]PORT",
        help="serve metrics for Prometheus there (HOST: 127.0.0.1), without a password",
    )


@contextmanager
def observers(args: argparse.Namespace) -> Iterator[tuple[ClusterObserver, ...]]:
    """Those that `args` ask for, while a command runs.

    Raises:
        SettingsError: the log cannot be written, or the metrics cannot be served.
    """
    with ExitStack() as stack:
        asked: list[ClusterObserver] = []
        if args.log is not None:
            from wdpm.cli.result import output_paths
            from wdpm.images.files import check_apart
            from wdpm.monitoring.json_log import JsonLog

            check_apart([*output_paths(args), ("the log", args.log)])

            log = JsonLog(args.log, _tell)
            stack.callback(log.close)
            asked.append(log)
        if args.metrics is not None:
            from wdpm.monitoring.metrics import Metrics

            metrics = Metrics(args.metrics.host, args.metrics.port)
            stack.callback(metrics.close)
            asked.append(metrics)
            _tell(f"metrics: http://{replace(args.metrics, port=metrics.port)}/metrics")
        yield tuple(asked)


def _tell(text: str) -> None:
    print(f"wdpm: {text}", file=sys.stderr, flush=True)
