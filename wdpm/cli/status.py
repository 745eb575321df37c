"""`wdpm status`: how far a master is, and who works for it."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wdpm import values

if TYPE_CHECKING:
    from wdpm.cluster.messages.protocol import SlaveStatus, StatusReport

_EXAMPLES = """\
examples:
  wdpm status tcp://127.0.0.1:7117
  wdpm status tcp://192.168.1.10:7117 --keys cluster-keys --json
  wdpm keys add-reader cluster-keys grafana     (keys that only look)"""


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command to the parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "status",
        help="ask a running master how far it is",
        description="Ask a running master how far it is and who works for it. Changes nothing, and takes no place of a "
        "slave. Exit code 75 if no master answers.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("address", type=values.address, metavar="tcp://HOST:PORT", help="address of the master")
    parser.add_argument(
        "--keys", type=Path, metavar="FOLDER", help="keys of a reader (wdpm keys add-reader), a slave or the master"
    )
    parser.add_argument("--json", action="store_true", help="as JSON, for programs")
    parser.add_argument(
        "--timeout",
        type=values.duration,
        default=5.0,
        metavar="TIME",
        help="how long to wait for an answer (default: 5s)",
    )
    return parser


def run(args: argparse.Namespace) -> int:
    """Ask and print; returns the exit code."""
    from wdpm.cluster.status_query import ask_status
    from wdpm.cluster.transport.zeromq.key_files import reader_keys

    keys = None if args.keys is None else reader_keys(args.keys)
    report = ask_status(args.address, keys, args.timeout)
    if args.json:
        print(json.dumps({**asdict(report), "left_s": seconds_left(report)}))
    else:
        print_status(report)
    return 0


def seconds_left(report: StatusReport) -> float | None:
    """Of the phase, if it goes on as it did so far [s]."""
    if not report.units or not report.done:
        return None
    return report.phase_s * max(report.units / report.done - 1.0, 0.0)


def print_status(report: StatusReport) -> None:
    """For a person."""
    from rich.console import Console
    from rich.table import Table

    from wdpm.report.tables import print_whole

    left = seconds_left(report)
    share = f" {report.done:,} of {report.units:,} ({report.done / report.units:.0%})" if report.units else ""
    time = "" if left is None else f", about {left:.0f} s left of it"
    print(f"{report.phase}:{share or ' ...'}, for {report.phase_s:.0f} s{time}; images or passes done: {report.images}")
    print(
        f"slaves: {len(report.slaves)} of {report.expected} (at most {report.most}); {report.joined} joined, "
        f"{report.lost} lost, {report.refused} refused; tasks handed out again: {report.retried}"
    )
    if not report.slaves:
        return
    table = Table(box=None)
    for name in ("slave", "host", "process"):
        table.add_column(name)
    for name in (
        "threads",
        "memory",
        "now",
        "peak",
        "cores",
        "in",
        "out",
        "team",
        "cells",
        "tasks",
        "done",
        "s a task",
    ):
        table.add_column(name, justify="right")
    table.add_column("silent", justify="right")
    for slave in report.slaves:
        each = f"{slave.busy_s / slave.done:.2f}" if slave.done else "-"
        peak = _size(slave.peak_memory) if slave.peak_memory else "-"
        team = "-" if slave.team < 0 else str(slave.team)
        counts = map(str, (slave.cells, slave.tasks, slave.done))
        who = (str(slave.number), slave.host, str(slave.process), str(slave.threads))
        now, *load = _now(slave)
        table.add_row(*who, _size(slave.memory), now, peak, *load, team, *counts, each, f"{slave.silent_s:.1f} s")
    print_whole(table, Console())


def _now(slave: SlaveStatus) -> tuple[str, ...]:
    """Memory in use, cores, bytes in and out a second."""
    if slave.now is None:
        return ("-",) * 4
    rates = (f"{rate / 1e6:.1f} MB/s" for rate in (slave.now.received, slave.now.sent))
    return (_size(slave.now.memory), f"{slave.now.cores:.1f}", *rates)


def _size(count: int) -> str:
    return f"{count / 2**30:.1f} GiB"
