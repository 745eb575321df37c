"""The report: it survives JSON, and says on the terminal what it must."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from rich.console import Console

from wdpm.report import EnergyLedger, LightPhotons, PhotonCounts, Report, SlaveReport, from_dict, from_json
from wdpm.report_tables import format_bytes, format_seconds
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
        report.print(console)
    return capture.get()


def test_json_and_back(report: Report) -> None:
    assert from_json(report.to_json()) == report
    assert from_dict(report.to_dict()) == report
    assert from_json(Report().to_json()) == Report()


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
    ],
)
def test_another_report_is_refused(report: Report, change: dict[str, object], message: str) -> None:
    with pytest.raises(ImageError, match=message):
        from_json(json.dumps(report.to_dict() | change))


def test_what_is_not_json_is_refused() -> None:
    with pytest.raises(ImageError, match="not a report of wdpm"):
        from_json("{")


def test_the_tables_fit_a_terminal_and_say_what_they_must(report: Report) -> None:
    text = printed(report)
    assert max(map(len, text.splitlines())) <= 80
    for words in ("250,000 asked for, 180,000 paths shot, 250,412 stored", "7 with fewer photons than k"):
        assert words in text
    assert "0 gathers left the band" in text
    assert "samples that were not finite: 0" in text
    assert "lamp [1]" in text  # a name is no markup
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
    text = printed(replace(report, slaves=(long,)))
    assert max(map(len, text.splitlines())) <= 80
    for number in ("20,000", "25.0%", "60,000", "300.0 MB"):
        assert number in text


def test_what_is_empty_is_left_out() -> None:
    text = printed(Report())
    assert "Slaves" not in text
    assert "by light" not in text
    assert "energy" not in text


def test_broken_samples_are_told_by_cause(report: Report) -> None:
    assert "not finite: 3 zero pdf" in printed(replace(report, nonfinite={"zero pdf": 3, "light": 0}))


def test_the_ledger() -> None:
    assert EnergyLedger(10, 7, 2, 0.5).imbalance == pytest.approx(0.05)
    assert EnergyLedger().imbalance == 0


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0.000 s"),
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
