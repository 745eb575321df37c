"""`wdpm bench predict`: its shares, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import wdpm
from wdpm.bench import predict
from wdpm.bench.predict import PredictFigures, Run, measure
from wdpm.bench.rows import Rows
from wdpm.progress import SilentProgress
from wdpm.rendering.in_process import InProcess
from wdpm.scenes.errors import SettingsError

RUN = Run(
    scene="hall",
    seed=0,
    target=0.02,
    true=0.015,
    estimated=0.016,
    high=0.019,
    reached=True,
    predicted=10.0,
    taken=12.0,
    pilot=5.0,
    wall=20.0,
    how={"passes": 4, "spp": 8, "indirect": "map", "photons": 1000, "k": 50},
)


def test_shares_count_what_they_say() -> None:
    slow = replace(RUN, taken=40.0)
    worse = replace(RUN, true=0.03)
    honest = replace(RUN, true=0.03, reached=False)
    spent = replace(RUN, true=0.004)
    figures = PredictFigures("cpu", 2, (RUN, slow, worse, honest, spent))
    assert RUN.ratio == pytest.approx(1.2)
    assert RUN.whole_ratio == pytest.approx(17 / 15)
    assert figures.time_share == pytest.approx(4 / 5)
    assert figures.error_share == pytest.approx(4 / 5)  # one that says that it is not reached has not lied
    assert figures.spending_share == pytest.approx(4 / 5)
    assert figures.to_dict()["error_share"] == figures.error_share
    assert len(figures.grid().rows) == 5


def test_a_run_is_held_against_the_reference_beside_the_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = tmp_path / "box.obj"
    scene.write_text("v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nf 1 2 3 4\n")
    with pytest.raises(SettingsError, match=r"reference\.exr"):
        measure([scene], InProcess(), SilentProgress())
    with pytest.raises(SettingsError, match="no scene"):
        measure([], InProcess(), SilentProgress())
    small = replace(wdpm.load("cornell-box").camera, width=12, height=12)
    image = wdpm.render(replace(wdpm.load("cornell-box"), camera=small), photons=0, spp=1, threads=1)
    image.save(tmp_path / "reference.exr")
    with pytest.raises(SettingsError, match=r"12x12 pixels are no whole number of squares of 5x5; give another"):
        measure([scene], InProcess(), SilentProgress(), smaller=5)
    rows = Rows(tmp_path / "rows.jsonl")
    found = measure([scene], InProcess(threads=1), SilentProgress(), targets=(0.9,), smaller=2, rows=rows)
    (run,) = found.runs
    assert run.scene == tmp_path.name
    assert run.true > 0
    assert run.wall > 0
    assert run.pilot > 0
    assert len(found.grid().rows) == 1
    kept = Rows(tmp_path / "rows.jsonl", resume=True)
    monkeypatch.setattr(predict, "render_until", None)  # nothing is rendered again
    again = measure([scene], InProcess(threads=1), SilentProgress(), targets=(0.9,), smaller=2, rows=kept)
    assert again.to_dict() == found.to_dict()
