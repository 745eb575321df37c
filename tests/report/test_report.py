"""The report: it survives JSON, and says on the terminal what it must."""

from __future__ import annotations

from dataclasses import replace

import pytest
from rich.console import Console

from wdpm.report.report import (
    EnergyLedger,
    KernelReport,
    LightPhotons,
    PhotonCounts,
    Report,
    SlaveReport,
    from_dict,
)
from wdpm.report.tables import format_bytes, format_seconds, print_report
from wdpm.scenes.errors import ImageError


@pytest.fixture
def report() -> Report:
    slaves = tuple(
        SlaveReport(f"slave-{i}", 2, 20_000 + i, 60_000, 5_000, 1_234, 2_345, 3_000_000, 4_000, 12.5, 300 * 2**20)
        for i in range(4)
    )
    return Report(
        phases={"render": 75.0, "load": 0.25},
        triangles=80_000,
        photons=PhotonCounts(250_000, 180_000, 250_412, (LightPhotons("lamp [1]", 180_000, 250_412, 12.5),)),
        slaves=slaves,
        gathers=123_456,
        gathers_truncated=7,
        energy=EnergyLedger(10.0, 7.0, 2.0, 1.0),
        warnings=("mesh [x]: 3 triangles without area dropped",),
        settings={"spp": 16, "radius": None},
        versions={"wdpm": "0.1.0"},
    )


def printed(report: Report, width: int = 80) -> str:
    console = Console(width=width, no_color=True)
    with console.capture() as capture:
        print_report(report, console)
    return capture.get()


def test_json_and_back(report: Report) -> None:
    assert from_dict(report.to_dict()) == report
    assert from_dict(report.to_dict()) == report
    assert from_dict(Report().to_dict()) == Report()
    full = replace(report, volume=PhotonCounts(1, 1, 1, (LightPhotons("l", 1, 1, 2.0, 0.5),)), left_out=("media",))
    assert from_dict(full.to_dict()) == full


def test_whole_seconds_come_back_as_floats(report: Report) -> None:
    data = report.to_dict()
    data["slaves"][0]["busy_s"] = 12
    assert isinstance(from_dict(data).slaves[0].busy_s, float)


def test_figures_that_are_not_finite_never_reach_a_file(report: Report) -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        replace(report, phases={"render": float("nan")}).to_json()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gather": 1}, "Report has no field 'gather'"),
        ({"gathers": "many"}, "must be int"),
        ({"gathers": True}, "must be int"),
        ({"slaves": {}}, "must be a list"),
        ({"slaves": [{"slave": "a"}]}, "missing"),
        ({"energy": 3}, "EnergyLedger must be an object"),
        (
            {"photons": {"lights": [{"name": "a", "paths": 1, "stored": 1, "flux": 1.0, "use": "much"}]}},
            "must be float",
        ),
    ],
)
def test_another_report_is_refused(report: Report, change: dict[str, object], message: str) -> None:
    with pytest.raises(ImageError, match=message):
        from_dict(report.to_dict() | change)


def test_the_tables_fit_a_terminal_and_say_what_they_must(report: Report) -> None:
    text = printed(report)
    assert max(map(len, text.splitlines())) <= 80
    for words in ("250,000 asked for, 180,000 paths shot, 250,412 stored", "7 with fewer photons than k"):
        assert words in text
    assert "0 gathers left the band" in text
    assert "samples that were not finite: 0" in text
    assert "warning: mesh [x]: 3 triangles" in text
    assert "the ledger closes to 0.0e+00" in text


def test_shares_are_of_the_whole_scene(report: Report) -> None:
    row = next(line for line in printed(report).splitlines() if line.startswith("slave-0"))
    assert row.split() == ["slave-0", "2", "20,000", "25.0%", "60,000", "5,000", "26.0%"]


def test_phases_are_in_their_order_with_the_total(report: Report) -> None:
    rows = [" ".join(line.split()) for line in printed(report).splitlines()]
    first = rows.index("load 0.25 s 0.3%")
    assert rows[first : first + 3] == ["load 0.25 s 0.3%", "render 1 min 15 s 99.7%", "total 1 min 15 s"]


def test_a_long_name_of_a_slave_gives_way_to_the_numbers(report: Report) -> None:
    long = replace(report.slaves[0], slave="render-node-0123456789.example.org:41234")
    text = printed(replace(report, slaves=(long, *report.slaves[1:])))
    assert max(map(len, text.splitlines())) <= 80
    for number in ("20,000", "25.0%", "60,000", "300.0 MB"):
        assert number in text


def test_idle_time_and_batches_are_told_of_slaves_that_counted_them(report: Report) -> None:
    assert "their time" not in printed(report)
    assert "sent (half" not in printed(report)
    counted = replace(
        report.slaves[0],
        spent_s={"computing": 6.0, "no task": 1.0, "no rays": 2.0, "phase end": 0.5, "sending": 0.5},
        messages={"PeerBatches": 1_400, "TaskDone": 6},
        batches_by_rays={"0": 400, "256": 300, "2048": 600, "65536": 100},
        batches_by_bytes={"0": 800, "65536": 600},
    )
    told = replace(report, slaves=(counted, *report.slaves[1:]))
    assert from_dict(told.to_dict()) == told
    text = printed(told)
    assert max(map(len, text.splitlines())) <= 80
    rows = [" ".join(line.split()) for line in text.splitlines()]
    assert "slave time computing no task no rays phase end sending" in rows
    assert "slave-0 10.0 s 60.0% 10.0% 20.0% 5.0% 5.0%" in rows
    assert "slave-0 1,406 1,400 512 131,072 1 B 128.0 KB" in rows
    assert "slave-1 0 0 - - - -" in rows


def test_a_render_without_slaves_has_no_tables_of_them_and_one_light_has_no_shares(report: Report) -> None:
    text = printed(replace(report, slaves=report.slaves[:1]))
    assert "Slaves" not in text
    assert "by light" not in text
    assert "memory: 300.0 MB at most, 80,000 triangles" in text


def test_what_is_empty_is_left_out() -> None:
    text = printed(Report())
    assert "Slaves" not in text
    assert "by light" not in text
    assert "energy" not in text


def test_broken_samples_are_told_by_cause(report: Report) -> None:
    assert "not finite: 3 zero pdf" in printed(replace(report, nonfinite={"zero pdf": 3, "light": 0}))


def test_maps_that_a_scene_has_are_told_by_light(report: Report) -> None:
    lights = (LightPhotons("strong [1]", 900, 10, 90.0, 0.01), LightPhotons("weak", 100, 990, 10.0, 0.99))
    text = printed(replace(report, caustics=PhotonCounts(1000, 1000, 1000, lights)))
    assert "Photons by light: caustic map" in text
    assert "Photons by light: volume map" not in text
    rows = [line.split() for line in text.splitlines()]
    assert ["weak", "10", "100", "990", "99.0%", "99.0%"] in rows
    assert ["strong", "[1]", "90", "900", "10", "1.0%", "1.0%"] in rows  # a name is no markup
    assert "caustic photons: 1,000 asked for, 1,000 paths shot, 1,000 stored" in text
    # 60,000 and 5,000 ghosts of 251,412 photons in both maps
    assert ["slave-0", "2", "20,000", "25.0%", "60,000", "5,000", "25.9%"] in rows


def test_many_lights_are_added_up(report: Report) -> None:
    lights = tuple(LightPhotons(f"lamp {i}", 10, 5, float(i), 0.01) for i in range(100))
    text = printed(replace(report, photons=PhotonCounts(500, 1000, 500, lights)))
    assert ["88", "more", "3828", "880", "440", "88.0%", "88.0%"] in [line.split() for line in text.splitlines()]


def test_what_is_wrong_is_loud(report: Report) -> None:
    fine = printed(replace(report, vertices=10, beams=20))
    assert "10 vertices beyond the first surface, 0 paths cut at the limit" in fine
    assert "beams through media: 20, 0 contributions clamped\n" in fine
    bad = replace(report, vertices=10, chains_cut=1, beams=20, beams_clamped=3, left_out=("caustics",))
    text = printed(bad)
    assert "3 contributions clamped: too bright to be added exactly" in " ".join(text.split())
    assert "LEFT OUT: caustics" in text
    console = Console(width=80, force_terminal=True)
    with console.capture() as capture:
        print_report(bad, console)
    assert "\x1b[1;31m3 contributions clamped" in capture.get()


def test_kernels_and_approximations_are_told(report: Report) -> None:
    kernels = KernelReport(("conductor", "media"), False, 9, 8, 3)
    text = printed(replace(report, kernels=kernels, approximated=("it is [blurred]",)))
    assert "kernels: 9 in 8 modules, 3 compiled now; effects: conductor, media" in text
    assert "approximated: it is [blurred]" in text
    assert "effects: all" in printed(replace(report, kernels=replace(kernels, all_effects=True)))


def test_the_ledger() -> None:
    assert EnergyLedger(10, 7, 2, 0.5).imbalance == pytest.approx(0.05)
    assert EnergyLedger().imbalance == 0


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0.000 s"),
        (-1e-9, "0.000 s"),
        (0.0123, "0.012 s"),
        (3.456, "3.46 s"),
        (59.94, "59.9 s"),
        (63, "1 min 03 s"),
        (7500, "2 h 05 min"),
    ],
)
def test_seconds_in_words(seconds: float, text: str) -> None:
    assert format_seconds(seconds) == text


@pytest.mark.parametrize(("count", "text"), [(0, "0 B"), (999, "999 B"), (1000, "1.0 KB"), (300 * 2**20, "300.0 MB")])
def test_bytes_in_words(count: int, text: str) -> None:
    assert format_bytes(count) == text
