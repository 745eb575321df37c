"""From the result of a session, or of several passes, to an image with a report."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from enum import Enum
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.session import SessionResult
from wdpm.cluster.work import guards
from wdpm.images.image import Image
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP, VOLUME_MAP
from wdpm.rendering.pass_plan import samples_of
from wdpm.rendering.prepare import Prepared
from wdpm.report.report import (
    PACKAGES,
    EnergyLedger,
    ErrorReport,
    FinalGatherReport,
    LightPhotons,
    PassReport,
    PhotonCounts,
    Report,
    SlaveReport,
)


def image_of(
    prepared: Prepared, result: SessionResult, passes: tuple[PassReport, ...] = (), error: ErrorReport | None = None
) -> Image:
    """The image of a finished session, or of several passes together, with settings and report."""
    report = report_of(prepared, result, passes, error)
    header = prepared.header.entries(result.layers["beauty"]) | {
        "settings": report.settings,
        "report": report.to_dict(),
    }
    if report.left_out:
        header["left_out"] = list(report.left_out)
    return Image(result.layers, header)


def report_of(
    prepared: Prepared, result: SessionResult, passes: tuple[PassReport, ...] = (), error: ErrorReport | None = None
) -> Report:
    """What a render tells about itself.

    Args:
        result: of the only session, or of all passes added up.
        passes: of a render in several.
    """
    times = max(len(passes), 1)
    slaves = result.statistics
    world = prepared.session.world
    paths = max(world.global_map.paths * times, 1)
    flux = world.unit**2 / paths  # of what was added up over all paths, in the scene's units
    absorbed, escaped, cut = np.array(result.counted["energy"]) * flux
    of_slaves = [slave["guards"] for slave in slaves]
    acted = guards.added([*of_slaves, result.counted["guards"], {guards.DROPPED: prepared.dropped}])
    counts = _photon_counts(prepared, result, times)
    return Report(
        phases={**prepared.seconds, **result.seconds, "partition": _sum_of("partition", prepared, result)},
        triangles=prepared.triangles,
        photons=counts[GLOBAL_MAP],
        caustics=counts[CAUSTIC_MAP],
        volume=counts[VOLUME_MAP],
        slaves=tuple(_slave_report(slave) for slave in slaves),
        kernels=prepared.kernels,
        vertices=sum(slave["vertices"] for slave in slaves),
        chains_cut=acted.get(guards.PATHS_CUT, 0),
        beams=sum(slave["beams"] for slave in slaves),
        beams_clamped=acted.get(guards.BEAMS_CLAMPED, 0),
        gathers=sum(slave["gathers"] for slave in slaves),
        gathers_truncated=sum(slave["gathers_truncated"] for slave in slaves),
        gathers_left_band=sum(slave["gathers_left_band"] for slave in slaves),
        gathers_s=sum(slave.get("gathers_s", 0.0) for slave in slaves),
        final_gather=_final_gather(prepared, result),
        nonfinite={
            cause.removeprefix(guards.NOT_FINITE): count
            for cause, count in acted.items()
            if cause.startswith(guards.NOT_FINITE)
        },
        guards=acted,
        energy=EnergyLedger(result.emitted * flux, float(absorbed), float(escaped), float(cut)),
        chose=prepared.chose,
        left_out=prepared.left_out,
        approximated=prepared.approximated,
        warnings=prepared.warnings + _uncounted(result) + _unshared(slaves),
        passes=passes,
        sampled=_sampled(result),
        error=error,
        settings=_settings(prepared, passes),
        versions={name: metadata.version(name) for name in PACKAGES} | {"python": platform.python_version()},
    )


def _uncounted(result: SessionResult) -> tuple[str, ...]:
    """Whose counts of rays and gathers the report has not."""
    missing = "what {} of rays and gathers is missing in this report"
    of_slave, before = missing.format("it had counted"), missing.format("was counted before")
    return (
        *(f"{slave} was lost; {of_slave}" for slave in result.lost),
        *(f"{slave} was still at work when all was rendered; {of_slave}" for slave in result.unheard),
        *([f"some of the image was finished before this render went on; {before}"] if result.went_on else ()),
    )


def _unshared(slaves: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Slaves that had to make by themselves what those of one machine make once."""
    alone = sum(slave["made_alone"] > 0 for slave in slaves)
    if not alone:
        return ()
    why = "its system lets them map no memory of each other, or has none left"
    return (f"{alone} slaves could not share trees and maps with others on their machine, and made their own: {why}",)


def _sum_of(phase: str, prepared: Prepared, result: SessionResult) -> float:
    return prepared.seconds.get(phase, 0.0) + result.seconds.get(phase, 0.0)


def _sampled(result: SessionResult) -> tuple[int, ...]:
    """Fewest and most samples of a pixel, where these differ; none otherwise."""
    samples = result.layers.get("samples")
    return () if samples is None else (int(samples.min()), int(samples.max()))


def _settings(prepared: Prepared, passes: tuple[PassReport, ...]) -> dict[str, Any]:
    camera = prepared.session.view.camera
    values = {k: v.value if isinstance(v, Enum) else v for k, v in asdict(prepared.settings).items()}
    if passes:  # a render that went on may have more than were asked for at first
        values |= samples_of([each.spp for each in passes], given=bool(prepared.settings.pass_samples))
    world = prepared.session.world
    planned = {"gather_radius": world.global_map.radius * world.unit, "cells": world.top_tree.cells}
    return values | {"width": camera.width, "height": camera.height} | planned


def _photon_counts(prepared: Prepared, result: SessionResult, times: int) -> list[PhotonCounts]:
    """Of the global, the caustic and the volume map, each made so many times."""
    world = prepared.session.world
    lights = world.lights
    stored, shot = (np.array(result.counted[name], np.int64) for name in ("stored_by_light", "paths_by_light"))
    power = np.bincount(lights.light, lights.power, minlength=len(lights.names)) * world.unit**2
    asked = (prepared.settings.photons, prepared.settings.caustic_photons, prepared.settings.volume_photons)
    use = _use_of_lights(result)
    counts = []
    for number, plan in enumerate(world.maps):
        passed = shot[1 if number == CAUSTIC_MAP else 0]
        counts.append(
            PhotonCounts(
                asked=asked[number] * times if plan.paths else 0,
                paths=plan.paths * times,
                stored=int(stored[number].sum()),
                lights=tuple(
                    LightPhotons(
                        name,
                        int(passed[i]),
                        int(stored[number][i]),
                        float(power[i]),
                        float(use[number][i]),
                    )
                    for i, name in enumerate(lights.names)
                ),
            )
        )
    return counts


def _use_of_lights(result: SessionResult) -> NDArray[np.float64]:
    """The flux of each light's photons as a share of all in a map, shape [maps, lights]."""
    flux = np.array(result.counted["flux_by_light"], np.float64)
    whole = flux.sum(axis=1, keepdims=True)
    share = np.divide(flux, whole, out=np.zeros_like(flux), where=whole > 0)
    rounded: NDArray[np.float64] = np.round(share, 9)
    return rounded  # sums of floats over slaves differ in their last bits, reports should not


def _slave_report(slave: dict[str, Any]) -> SlaveReport:
    counted = {name: slave[name] for name in ("triangles", "rays_in", "rays_out")}
    counted |= {name: sum(slave[name]) for name in ("photons", "ghosts", "copies")}
    used = {name: slave[name] for name in ("bytes_in", "bytes_out", "busy_s", "peak_memory_bytes")}
    used |= {name: slave.get(name, {}) for name in ("spent_s", "messages")}
    used |= {name: _ascending(slave.get(name, {})) for name in ("batches_by_rays", "batches_by_bytes")}
    records = slave.get("records", 0)
    return SlaveReport(slave=f"slave {slave['slave']}", cells=len(slave["cells"]), records=records, **counted, **used)


def _ascending(by_power: Mapping[str, int]) -> dict[str, int]:
    return {power: by_power[power] for power in sorted(by_power, key=int)}


def _final_gather(prepared: Prepared, result: SessionResult) -> FinalGatherReport | None:
    """What final gathering did; None where there is none."""
    if not prepared.settings.final_gathers:
        return None

    def total(name: str) -> Any:
        return sum(slave.get(name, 0) for slave in result.statistics)

    counted = {
        field.name: total(f"final_gather_{field.name}")
        for field in fields(FinalGatherReport)
        if field.name in ("rays", "short", "unread", "read_s", "interpolated", "uncovered", "interpolated_s")
    }
    return FinalGatherReport(
        points=total("irradiance_points"),
        points_s=total("irradiance_s"),
        records=len(result.records),
        record_rays=result.record_rays,
        records_s=result.seconds.get("records", 0.0),
        **counted,
    )
