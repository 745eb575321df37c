"""`wdpm bench indirect`: what is rendered, in which order, and what is said of it; never a time."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from wdpm.bench import indirect
from wdpm.bench.indirect import REFERENCE_SEED, WAYS, Choice, Found, IndirectFigures, Sweep
from wdpm.bench.indirect_plot import plot
from wdpm.bench.mitsuba import WARM_SEED, Cost
from wdpm.cli import main
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.images.image import Image
from wdpm.progress import SilentProgress
from wdpm.rendering.in_process import InProcess
from wdpm.report.report import FinalGatherReport, Report
from wdpm.scenes.errors import ImageError
from wdpm.scenes.model.scene import Scene

SIZE = (8, 6)
SWEEP = Sweep(spp=(1, 4), photons=(100, 400), rounds=2, reference_spp=9)
OFFSETS = {Indirect.MAP: 0.4, Indirect.GATHER: 0.2, Indirect.CACHE: 0.1}


def grey(value: float) -> Image:
    return Image({"beauty": np.full((SIZE[1], SIZE[0], 3), value, np.float32)})


class FakeRenderer:
    """Grey images: 1 from the path tracer, and others off by their way's offset over the root of the samples."""

    def __init__(self) -> None:
        self.asked: list[RenderSettings] = []

    def __call__(self, scene: Scene, settings: RenderSettings) -> Image:
        self.asked.append(settings)
        assert (scene.camera.width, scene.camera.height) == SIZE
        path = settings.integrator is Integrator.PATH
        image = grey(1.0 if path else 1.0 + OFFSETS[settings.indirect] / math.sqrt(settings.spp))
        gathered = FinalGatherReport(records=7) if settings.indirect is Indirect.CACHE else None
        account = Report(phases={"compile": 3.0}, final_gather=gathered)
        return replace(image, metadata={"report": account.to_dict()})


def measured(renderer: FakeRenderer, reference: Path | None = None) -> IndirectFigures:
    return indirect.measure("cornell-box", reference, SWEEP, InProcess(), SilentProgress(), size=SIZE, render=renderer)


def test_every_choice_is_rendered_by_turns_after_all_is_warm() -> None:
    renderer = FakeRenderer()
    figures = measured(renderer)
    warm, reference, turns = renderer.asked[:3], renderer.asked[3], renderer.asked[4:]
    assert [each.indirect for each in warm] == list(WAYS)
    assert all((each.seed, each.spp, each.photons) == (WARM_SEED, 1, 100) for each in warm)
    assert (reference.integrator, reference.spp, reference.seed) == (Integrator.PATH, 9, REFERENCE_SEED)
    assert [each.seed for each in turns] == [0] * 12 + [1] * 12
    first = [Choice(each.indirect, each.photons, each.spp) for each in turns[:12]]
    assert first == [each.choice for each in figures.found]
    assert len(set(first)) == 12
    assert figures.compiled == {way.value: 3.0 for way in WAYS}


def test_errors_energy_and_records_are_those_of_the_images() -> None:
    for each in measured(FakeRenderer()).found:
        error = OFFSETS[each.choice.way] / math.sqrt(each.choice.spp)
        assert each.rmse == pytest.approx(error, rel=1e-5)
        assert each.rel_mse == pytest.approx(error**2 / 1.01, rel=1e-5)
        assert each.energy == pytest.approx(1 + error, rel=1e-5)
        assert each.records == (7 if each.choice.way is Indirect.CACHE else 0)


def test_a_reference_file_gives_the_size_and_spares_the_path_tracer(tmp_path: Path) -> None:
    file = tmp_path / "reference.exr"
    grey(1.0).save(file)
    renderer = FakeRenderer()
    figures = indirect.measure("cornell-box", file, SWEEP, InProcess(), SilentProgress(), render=renderer)
    assert (figures.size, figures.reference) == (SIZE, str(file))
    assert all(each.integrator is not Integrator.PATH for each in renderer.asked)
    (tmp_path / "scene.xml").write_text("<scene/>")
    assert indirect.reference_beside(str(tmp_path / "scene.xml")) == file
    assert indirect.reference_beside(str(tmp_path / "other.xml")) is None


@pytest.mark.parametrize("value", [0.0, math.nan])
def test_a_reference_that_measures_nothing_is_refused_before_anything_is_rendered(tmp_path: Path, value: float) -> None:
    file = tmp_path / "reference.exr"
    grey(value).save(file)
    renderer = FakeRenderer()
    with pytest.raises(ImageError, match=r"reference\.exr: has values that are not finite, or is black"):
        measured(renderer, file)
    assert not renderer.asked


def figures_of(*points: tuple[Indirect, float, float]) -> IndirectFigures:
    """From way, CPU time and RMSE; the samples count up within a way."""
    found = tuple(
        Found(Choice(way, 100, number + 1), Cost(cpu, cpu), rmse, rmse**2, 1.0, 0.0)
        for number, (way, cpu, rmse) in enumerate(points)
    )
    return IndirectFigures("box", "a file", SIZE, 1, Sweep(photons=(100,)), {}, found)


def test_the_time_to_an_error_is_that_of_the_fastest_choice_that_reaches_it() -> None:
    figures = figures_of(
        (Indirect.MAP, 1.0, 0.3),
        (Indirect.MAP, 4.0, 0.2),
        (Indirect.GATHER, 9.0, 0.15),
        (Indirect.CACHE, 3.0, 0.2),
        (Indirect.CACHE, 2.0, 0.1),
    )
    fastest = figures.least_to(Indirect.CACHE, 0.2)
    assert fastest is not None
    assert fastest.cost.cpu_s == 2.0
    assert figures.least_to(Indirect.MAP, 0.15) is None
    rows = figures.grids()[1].rows
    assert [row[0].split(",")[0] for row in rows] == ["0.20000", "0.15000", "0.10000"]
    assert [row[1] for row in rows] == [rows[0][1], "not reached", "not reached"]
    assert rows[2][2] == "not reached"


def test_the_plot_has_a_mark_for_each_choice() -> None:
    points = [(way, time, 1.0 / time) for way in WAYS for time in (1.0, 2.0, 5.0)]
    root = ElementTree.fromstring(plot([figures_of(*points)]))
    marks = [each for each in root.iter() if each.get("class") == "mark"]
    assert len(marks) == len(points)
    across = [float(each.attrib["cx"]) for each in marks]
    assert across[:3] == sorted(across[:3])
    assert float(marks[0].attrib["cy"]) < float(marks[2].attrib["cy"])  # a larger error is further up


def test_a_run_writes_its_figures_and_its_plot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figures, drawn = tmp_path / "figures.json", tmp_path / "plot.svg"
    line = ["bench", "indirect", "cornell-box", "--size", "8x8", "--spp", "1,2", "--photons", "500", "--rounds", "1"]
    line += ["--reference-spp", "4", "--threads", "1", "--json", str(figures), "--plot", str(drawn)]
    assert main.main(line) == 0
    (scene,) = json.loads(figures.read_text())["indirect"]
    assert [(each["way"], each["spp"]) for each in scene["found"]] == [(way.value, n) for way in WAYS for n in (1, 2)]
    assert all((each["records"] > 0) == (each["way"] == "cache") for each in scene["found"])
    assert scene["reference"] == "path tracing of our own, 4 samples"
    assert drawn.read_text().startswith("<svg")
    assert "CPU time to an error" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (["a.xml", "b.xml", "--reference", "r.exr"], "--reference is of one scene"),
        (["cornell-box", "--reference", "r.exr", "--size", "8x8"], "leave --size out"),
        (["cornell-box", "--spp", "4,0"], "argument --spp: must be at least 1"),
        (["cornell-box", "--plot", "plot.png"], "plot.png"),
        (["nowhere.xml"], "nowhere.xml"),
    ],
)
def test_bad_input_is_one_line(more: list[str], expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main.main(["bench", "indirect", *more])
    except SystemExit as exit_:
        code = int(str(exit_.code))
    assert code == 2
    assert expected in capsys.readouterr().err
