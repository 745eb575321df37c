"""A report as tables on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from wdpm.report import PHASES, Report

if TYPE_CHECKING:
    from rich.console import Console

_BYTE_UNITS = ("B", "KB", "MB", "GB", "TB")


def print_report(report: Report, console: Console) -> None:
    """Print all that the report holds; what is empty is left out."""
    console.print(_times(report))
    if report.photons.lights:
        console.print(_lights(report))
    if report.slaves:
        console.print(_held(report))
        console.print(_did(report))
    console.print()
    for line in _counts(report):
        console.print(line, highlight=False)
    for warning in report.warnings:
        console.print(f"[yellow]warning:[/] {escape(warning)}", highlight=False)


def format_bytes(count: int) -> str:
    """Bytes for people, in powers of 1024: 12.3 MB."""
    value = float(count)
    for unit in _BYTE_UNITS[:-1]:
        if value < 999.95:
            return f"{value:.0f} {unit}" if unit == "B" else f"{value:.1f} {unit}"
        value /= 1024
    return f"{value:.1f} {_BYTE_UNITS[-1]}"


def format_seconds(seconds: float) -> str:
    """A length of time for people: 0.012 s, 3.4 s, 12 min 03 s, 2 h 05 min."""
    if seconds < 60:
        return f"{seconds:.3f} s" if seconds < 0.0995 else f"{seconds:.2f} s" if seconds < 9.995 else f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def _times(report: Report) -> Table:
    order = [phase for phase in PHASES if phase in report.phases]
    order += [phase for phase in report.phases if phase not in PHASES]
    total = sum(report.phases.values())
    table = _table("Time", "phase", "time", "share")
    for phase in order:
        seconds = report.phases[phase]
        table.add_row(escape(phase), format_seconds(seconds), _percent(seconds, total))
    table.add_row("total", format_seconds(total), "")
    return table


def _lights(report: Report) -> Table:
    table = _table("Photons by light", "light", "power [W]", "paths shot", "stored")
    for light in report.photons.lights:
        table.add_row(escape(light.name), f"{light.flux:.4g}", f"{light.paths:,}", f"{light.stored:,}")
    return table


def _held(report: Report) -> Table:
    title = "Slaves: what they held (shares of the scene's triangles and of all stored photons)"
    table = _table(title, "slave", "cells", "triangles", "share", "photons", "ghosts", "share")
    for slave in report.slaves:
        table.add_row(
            escape(slave.slave),
            f"{slave.cells}",
            f"{slave.triangles:,}",
            _percent(slave.triangles, report.triangles),
            f"{slave.photons:,}",
            f"{slave.ghosts:,}",
            _percent(slave.photons + slave.ghosts, report.photons.stored),
        )
    return table


def _did(report: Report) -> Table:
    table = _table("Slaves: what they did", "slave", "rays in", "rays out", "received", "sent", "busy", "peak memory")
    for slave in report.slaves:
        table.add_row(
            escape(slave.slave),
            f"{slave.rays_in:,}",
            f"{slave.rays_out:,}",
            format_bytes(slave.bytes_in),
            format_bytes(slave.bytes_out),
            format_seconds(slave.busy_s),
            format_bytes(slave.peak_memory_bytes),
        )
    return table


def _counts(report: Report) -> list[str]:
    """One line for each thing that is counted."""
    photons, energy = report.photons, report.energy
    lines = [
        f"photons: {photons.asked:,} asked for, {photons.paths:,} paths shot, {photons.stored:,} stored",
        f"gathers: {report.gathers:,}, {report.gathers_truncated:,} with fewer photons than k, "
        f"{report.gathers_left_band:,} gathers left the band",
    ]
    if energy.emitted > 0:
        shares = ", ".join(
            f"{_percent(getattr(energy, name), energy.emitted)} {words}"
            for name, words in (
                ("absorbed", "absorbed"),
                ("escaped", "escaped"),
                ("travelling", "cut at the depth limit"),
            )
        )
        lines.append(f"energy of the photons: {shares}; the ledger closes to {energy.imbalance:.1e}")
    causes = ", ".join(f"{count:,} {escape(cause)}" for cause, count in report.nonfinite.items() if count)
    lines.append(f"[red]samples that were not finite: {causes}[/]" if causes else "samples that were not finite: 0")
    return lines


def _percent(part: float, whole: float) -> str:
    return f"{part / whole:.1%}" if whole else "-"


def _table(title: str, name: str, *numbers: str) -> Table:
    """A table without lines: a name on the left, which gives way on a narrow terminal, and numbers, which do not."""
    table = Table(title=f"\n{title}", title_justify="left", title_style="bold", box=None, padding=(0, 2, 0, 0))
    table.add_column(name, overflow="fold")
    for number in numbers:
        table.add_column(number, justify="right", no_wrap=True)
    return table
