"""A report as tables on the terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from wdpm.report.report import (
    PHASES,
    ErrorFigure,
    ErrorReport,
    FinalGatherReport,
    KernelReport,
    LightPhotons,
    PassReport,
    PhotonCounts,
    Report,
    SlaveReport,
)

LIGHTS_SHOWN = 12
"""The strongest; JSON has them all."""

_BYTE_UNITS = ("B", "KB", "MB", "GB", "TB")


def print_whole(table: Table, console: Console) -> None:
    """Print a table with no heading or figure cut or broken, however narrow a terminal is, or a file that has no width.

    A terminal breaks lines that are too long for it, and these can be read; columns of two letters cannot.
    """
    needed = console.measure(table, options=console.options.update(width=1000)).maximum
    before, console.width = console.width, max(console.width, needed)
    console.print(table)
    console.width = before


def print_report(report: Report, console: Console) -> None:
    """Print all that the report holds; what is empty is left out."""
    for table in report_tables(report):
        console.print(table)
    console.print()
    for line in report_lines(report):
        console.print(line, highlight=False)


def report_tables(report: Report) -> list[Table]:
    """Times, photons by light where there are several, and what slaves held and did, where there are any."""
    tables = [_times(report)]
    tables += [_lights(words, counts) for words, counts in _maps(report) if len(counts.lights) > 1 and counts.paths]
    if report.slaves and _alone(report) is None:
        tables += [_held(report), _did(report)]
    if any(slave.spent_s for slave in report.slaves):
        tables.append(_spent(report.slaves))
    if any(slave.messages for slave in report.slaves):
        tables.append(_sent(report.slaves))
    return tables


def report_lines(report: Report) -> list[str]:
    """All else, a line each, in rich's markup."""
    return [
        *_counts(report),
        *(f"approximated: {escape(line)}" for line in report.approximated),
        *(f"chosen: {escape(line)}" for line in report.chose),
        *(f"[bold red]LEFT OUT:[/] {escape(line)}" for line in report.left_out),
        *(f"[yellow]warning:[/] {escape(warning)}" for warning in report.warnings),
    ]


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
        digits = 3 if seconds < 0.0995 else 2 if seconds < 9.995 else 1
        return f"{seconds:z.{digits}f} s"
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


def _maps(report: Report) -> tuple[tuple[str, PhotonCounts], ...]:
    return ("global map", report.photons), ("caustic map", report.caustics), ("volume map", report.volume)


def _lights(words: str, counts: PhotonCounts) -> Table:
    """One line a light, strongest first."""
    table = _table(f"Photons by light: {words}", "light", "power [W]", "paths shot", "stored", "share", "of the flux")
    strongest = sorted(counts.lights, key=lambda light: -light.flux)
    shown = strongest if len(strongest) <= LIGHTS_SHOWN + 1 else strongest[:LIGHTS_SHOWN]
    for light in shown:
        table.add_row(escape(light.name), *_light_cells((light,), counts))
    if len(shown) < len(strongest):
        rest = strongest[LIGHTS_SHOWN:]
        table.add_row(f"{len(rest):,} more", *_light_cells(rest, counts))
    return table


def _light_cells(lights: Sequence[LightPhotons], counts: PhotonCounts) -> tuple[str, ...]:
    stored = sum(light.stored for light in lights)
    uses = [light.use for light in lights if light.use is not None]
    return (
        f"{sum(light.flux for light in lights):.4g}",
        f"{sum(light.paths for light in lights):,}",
        f"{stored:,}",
        _percent(stored, counts.stored),
        f"{sum(uses):.1%}" if uses else "-",
    )


def _alone(report: Report) -> SlaveReport | None:
    """What computed all in the process that was asked; None where slaves did."""
    only = report.slaves[0] if len(report.slaves) == 1 else None
    return None if only is None or only.spent_s else only


def _held(report: Report) -> Table:
    title = "Slaves: scene and photons held (shares of all triangles and of all stored photons)"
    records = ("records",) if any(slave.records for slave in report.slaves) else ()
    copies = ("copies",) if any(slave.copies for slave in report.slaves) else ()
    table = _table(title, "slave", "cells", "triangles", "share", "photons", *copies, "ghosts", "share", *records)
    for slave in report.slaves:
        table.add_row(
            escape(slave.slave),
            f"{slave.cells}",
            f"{slave.triangles:,}",
            _percent(slave.triangles, report.triangles),
            f"{slave.photons:,}",
            *([f"{slave.copies:,}"] if copies else []),
            f"{slave.ghosts:,}",
            _percent(slave.held, report.stored),
            *([f"{slave.records:,}"] if records else []),
        )
    return table


def _did(report: Report) -> Table:
    table = _table(
        "Slaves: work and traffic", "slave", "rays in", "rays out", "received", "sent", "busy", "peak memory"
    )
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


def _spent(slaves: Sequence[SlaveReport]) -> Table:
    """Shares of the wall-clock time of each slave."""
    what = list(dict.fromkeys(name for slave in slaves for name in slave.spent_s))
    table = _table("Slaves: time spent (computing, or waiting by cause)", "slave", "time", *map(escape, what))
    for slave in slaves:
        whole = sum(slave.spent_s.values())
        shares = [_percent(slave.spent_s.get(name, 0.0), whole) for name in what]
        table.add_row(escape(slave.slave), format_seconds(whole), *shares)
    return table


def _sent(slaves: Sequence[SlaveReport]) -> Table:
    """How many messages and batches, and the powers of two that half of the batches, and all, are below."""
    title = "Slaves: messages sent (half of the batches, and all, have fewer rays and bytes than)"
    table = _table(title, "slave", "messages", "batches", "rays: half", "all", "bytes: half", "all")
    for slave in slaves:
        table.add_row(
            escape(slave.slave),
            f"{sum(slave.messages.values()):,}",
            f"{sum(slave.batches_by_rays.values()):,}",
            *_half_and_all(slave.batches_by_rays, "{:,}".format),
            *_half_and_all(slave.batches_by_bytes, format_bytes),
        )
    return table


def _half_and_all(by_power: Mapping[str, int], shown: Callable[[int], str]) -> tuple[str, str]:
    """The least powers of two that half of all, and all, are below."""
    powers = sorted(int(power) for power, count in by_power.items() if count)
    if not powers:
        return "-", "-"
    half = sum(by_power.values()) / 2
    median = next(power for power in powers if sum(by_power[str(p)] for p in powers if p <= power) >= half)
    return shown(max(2 * median, 1)), shown(max(2 * powers[-1], 1))


def _counts(report: Report) -> list[str]:
    """One line for each thing that is counted; what is wrong is red."""
    energy = report.energy
    lines = [
        f"{name}: {counts.asked:,} asked for, {counts.paths:,} paths shot, {counts.stored:,} stored"
        for name, counts in zip(("photons", "caustic photons", "volume photons"), _counted(report), strict=True)
        if counts.paths or name == "photons"
    ]
    lines.append(
        f"gathers: {report.gathers:,}, {report.gathers_truncated:,} with fewer photons than k, "
        f"{report.gathers_left_band:,} gathers left the band"
    )
    if report.vertices:
        cut = f"{report.chains_cut:,} paths cut at the limit"
        cut = f"[bold red]{cut}[/]" if report.chains_cut else cut
        lines.append(f"camera paths: {report.vertices:,} vertices beyond the first surface, {cut}")
    if report.final_gather is not None:
        lines += _final_gather(report.final_gather)
    if report.beams:
        clamped = f"{report.beams_clamped:,} contributions clamped"
        if report.beams_clamped:
            clamped = f"[bold red]{clamped}: too bright to be added exactly, so light is lost[/]"
        lines.append(f"beams through media: {report.beams:,}, {clamped}")
    if report.passes:
        lines.append(_passes(report.passes, report.sampled))
    if report.error is not None:
        lines += _error(report.error)
    if report.kernels.kernels:
        lines.append(_kernels(report.kernels))
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
    if (alone := _alone(report)) is not None:
        lines.append(f"memory: {format_bytes(alone.peak_memory_bytes)} at most, {report.triangles:,} triangles")
    causes = ", ".join(f"{count:,} {escape(cause)}" for cause, count in report.nonfinite.items() if count)
    lines.append(f"[red]samples that were not finite: {causes}[/]" if causes else "samples that were not finite: 0")
    acted = ", ".join(f"{count:,} {escape(cause)}" for cause, count in report.guards.items() if count)
    lines.append(f"[red]guards: {acted}[/]" if acted else "guards: none acted")
    return lines


def _final_gather(done: FinalGatherReport) -> list[str]:
    """What gather rays and irradiance records did, and what each cost."""
    lines = [
        f"irradiance at photons: {done.points:,}" + _each(done.points_s, done.points),
        f"gather rays: {done.rays:,}, of which {_percent(done.short, done.rays)} were short and went on, "
        f"{_percent(done.unread, done.rays)} found no irradiance and went on",
    ]
    if done.records:
        lines.append(
            f"irradiance records: {done.records:,}, {done.record_rays:,} gather rays"
            + _each(done.records_s, done.records if done.record_rays else 0)
        )
        lines.append(f"interpolations: {done.interpolated:,}; {done.uncovered:,} places that no record reached")
    return lines


def _each(seconds: float, count: int) -> str:
    """What one of many cost, to be said after their number; nothing where that is not known."""
    return f", {1e6 * seconds / count:,.2f} us each" if count and seconds else ""


def _passes(passes: Sequence[PassReport], sampled: Sequence[int]) -> str:
    seconds = sum(sum(each.seconds.values()) for each in passes)
    samples = sum(each.spp for each in passes)
    how = f" on average, {sampled[0]:,} to {sampled[1]:,} by adaptive sampling" if sampled else " in all"
    return (
        f"passes: {len(passes)}, {samples:,} samples a pixel{how}, {format_seconds(seconds / len(passes))} each; "
        f"gather radius {passes[0].radius:.4g} in the first, {passes[-1].radius:.4g} in the last"
    )


def _error(error: ErrorReport) -> list[str]:
    """What the passes tell about the error: estimates, each with its interval of 95 %."""
    return [
        f"estimated {name}: {_figure(parts.total or parts.noise, root)}"
        + (f"; noise {_figure(parts.noise, root)}" if parts.total else " by noise")
        + (f"; bias {_figure(parts.bias, root)}" if parts.bias else "; bias: not known from fewer than 3 passes")
        for name, parts, root in (("relMSE", error.rel_mse, False), ("RMSE", error.mse, True))
    ]


def _figure(figure: ErrorFigure, root: bool) -> str:
    value, low, high = (math.sqrt(x) if root else x for x in (figure.value, figure.low, figure.high))
    return f"{value:.3g} ({low:.3g} to {high:.3g})"


def _counted(report: Report) -> tuple[PhotonCounts, ...]:
    return report.photons, report.caustics, report.volume


def _kernels(kernels: KernelReport) -> str:
    names = ", ".join(kernels.features) or "none but diffuse surfaces"
    effects = "all" if kernels.all_effects else names
    made = f"{kernels.compiled} compiled now" if kernels.compiled else "none compiled now"
    if kernels.standing_in:
        made += f", {kernels.standing_in} began with all effects, as their own were not compiled"
    return f"kernels: {kernels.kernels} in {kernels.modules} modules, {made}; effects: {effects}"


def _percent(part: float, whole: float) -> str:
    return f"{part / whole:.1%}" if whole else "-"


def _table(title: str, name: str, *numbers: str) -> Table:
    """A table without lines: a name on the left, which gives way on a narrow terminal, and numbers, which do not."""
    table = Table(title=f"\n{title}", title_justify="left", title_style="bold", box=None, padding=(0, 2, 0, 0))
    table.add_column(name, overflow="fold")
    for number in numbers:
        table.add_column(number, justify="right", no_wrap=True)
    return table
