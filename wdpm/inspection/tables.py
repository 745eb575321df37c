"""An inspection as tables on the terminal."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from wdpm.cluster.plan.effects_in_words import Effect, LightUse
from wdpm.inspection.inspect import Inspection
from wdpm.report.tables import format_bytes

LIGHTS_SHOWN = 12
"""The strongest; JSON has them all."""

_MAPS = ("global", "caustic", "volume")


def print_inspection(inspection: Inspection, console: Console) -> None:
    """Print all of it."""
    for part in inspection_parts(inspection):
        console.print(part, highlight=False)


def inspection_parts(inspection: Inspection) -> list[Table | str]:
    """All of it in order: tables, and lines in rich's markup."""
    spared = any(not effect.called and not effect.on for effect in inspection.effects)
    return [
        _facts(inspection),
        _plan(inspection),
        *([_spared(inspection)] if spared else []),
        f"\ncompiled in: {', '.join(inspection.features) or 'nothing but diffuse surfaces'}",
        _lights(inspection),
        *map(escape, _dark(inspection.lights)),
        _slaves(inspection),
        *(f"chosen: {escape(line)}" for line in inspection.chose),
        *(f"approximated: {escape(line)}" for line in inspection.approximated),
        *(f"[yellow]warning:[/] {escape(line)}" for line in (*inspection.left_out, *inspection.warnings)),
    ]


def _facts(inspection: Inspection) -> Table:
    facts = Table(title=inspection.name, title_justify="left", title_style="bold", show_header=False, box=None)
    made = [number for number, count in enumerate(inspection.photons) if count]
    paths = [f"{count:,} paths {words}" for count, words in zip(inspection.paths, _MAPS, strict=False) if count]
    rows = {
        "triangles": f"{inspection.triangles:,} in {inspection.meshes:,} meshes",
        "materials": f"{inspection.materials:,}, {inspection.textures:,} textures, {inspection.media:,} media",
        "image": f"{inspection.size[0]} x {inspection.size[1]}",
        "extent": f"{inspection.extent:g} from its centre",
        "photons": ", ".join(f"{inspection.photons[n]:,} {_MAPS[n]}" for n in made) or "none",
        "photon paths": ", ".join(paths) or "none",
        "gather radius": ", ".join(f"{inspection.radius[n]:.4g} {_MAPS[n]}" for n in made) or "none",
        "kernels": f"{inspection.modules} modules for these effects",
    }
    if inspection.dropped:
        rows["left out"] = ", ".join(f"{count:,} triangles: {cause}" for cause, count in inspection.dropped.items())
    for name, value in rows.items():
        facts.add_row(name, escape(value))
    return facts


def _plan(inspection: Inspection) -> Table:
    """What the scene calls for, or is compiled in anyway."""
    table = _table("Plan: what the scene calls for")
    for column in ("effect", "called for", "because of", "switches on"):
        table.add_column(column, overflow="fold")
    for effect in sorted(inspection.effects, key=lambda effect: not effect.called):
        if effect.called or effect.on:
            cells = (effect.words, _state(effect), effect.reason or "-", effect.switches_on)
            table.add_row(*map(escape, cells), style="yellow" if effect.left_out else "")
    return table


def _spared(inspection: Inspection) -> Table:
    """What is off because nothing calls for it."""
    table = _table("Not called for, and so off")
    for column in ("effect", "called for", "would switch on"):
        table.add_column(column, overflow="fold")
    for effect in inspection.effects:
        if not effect.called and not effect.on:
            table.add_row(escape(effect.words), _state(effect), escape(effect.switches_on))
    return table


def _state(effect: Effect) -> str:
    if effect.called and effect.spared:
        return "yes, but off"
    if effect.called:
        return "yes" if effect.on else "LEFT OUT"
    return "no, but on" if effect.on else "no"


def _lights(inspection: Inspection) -> Table:
    caustic = any(light.caustic_photons is not None for light in inspection.lights)
    photons = caustic or any(inspection.paths)
    table = _table("Lights: power" + (", and shares of the photons by measured use" if photons else ""))
    table.add_column("light", overflow="fold")
    of_photons = ["photons by use"] * photons + ["caustic photons by use"] * caustic
    for column in ("power [W]", "by power", *of_photons):
        table.add_column(column, justify="right")
    strongest = sorted(inspection.lights, key=lambda light: -light.power)
    for light in strongest[:LIGHTS_SHOWN]:
        cells = [light.name, f"{light.power:.4g}", f"{light.by_power:.1%}"]
        if photons:
            cells.append(f"{light.photons:.1%}")
        if caustic:
            cells.append(f"{light.caustic_photons or 0.0:.1%}")
        table.add_row(*map(escape, cells))
    if len(strongest) > LIGHTS_SHOWN:
        rest = strongest[LIGHTS_SHOWN:]
        sums = [sum(light.power for light in rest), sum(light.by_power for light in rest)]
        cells = [f"{len(rest):,} more", f"{sums[0]:.4g}", f"{sums[1]:.1%}"]
        if photons:
            cells.append(f"{sum(light.photons for light in rest):.1%}")
        if caustic:
            cells.append(f"{sum(light.caustic_photons or 0.0 for light in rest):.1%}")
        table.add_row(*cells)
    return table


def _dark(lights: tuple[LightUse, ...]) -> list[str]:
    return [f"no photons for light {light.name}: {light.why_none}" for light in lights if light.why_none]


def _slaves(inspection: Inspection) -> Table:
    teams = 1 + max(share.team for share in inspection.slaves)
    table = _table("What each slave would hold" + (f": {teams} copies of the scene" if teams > 1 else ""))
    for column in ("slave", "team", "cells", "triangles", "photons", "ghosts", "most memory", "sent first"):
        table.add_column(column, justify="right")
    for share in inspection.slaves:
        shares = (f"{amount:.1%}" for amount in (share.triangles, share.photons, share.ghosts))
        sizes = (format_bytes(share.memory), format_bytes(share.received))
        table.add_row(str(share.slave), str(share.team), str(share.cells), *shares, *sizes)
    return table


def _table(title: str) -> Table:
    return Table(title=f"\n{title}", title_justify="left", title_style="bold", box=None, padding=(0, 2, 0, 0))
