"""`wdpm bench`: every benchmark at the least size. What is asserted is what the tables say, never a time."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from command_line import refusal
from rich.console import Console

from wdpm.bench import kernels, paper, photons
from wdpm.bench.commands import arguments
from wdpm.bench.rows import Rows
from wdpm.cli import main
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import Indirect, RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.local_backend import backend_here
from wdpm.progress import SilentProgress
from wdpm.rendering.backend import Backend, Backends
from wdpm.rendering.in_process import render_in_process
from wdpm.report.grid import Grid
from wdpm.scenes.model.scene import Scene

LIGHT_LOAD = kernels.Load(
    rays=64, seconds=0.0, photons=500, neighbours=((5, 4), (50, 4)), rounds=1, photon_rounds=1, photon_task_paths=1000
)


def hide(monkeypatch: pytest.MonkeyPatch, module: Any, *missing: str) -> None:
    """Have packages look as if they were not installed."""
    real = module.find_spec
    monkeypatch.setattr(module, "find_spec", lambda name: None if name in missing else real(name))


# ---- tables -------------------------------------------------------------------------------------------------------


def test_a_table_has_the_same_cells_on_the_terminal_and_in_markdown() -> None:
    grid = Grid("a | b", ("what", "how much"), (("[red]", "1.5"), ("a|b", "2")), ("a note",))
    assert grid.markdown() == (
        "## a | b\n\n| what | how much |\n| --- | ---: |\n| [red] | 1.5 |\n| a\\|b | 2 |\n\na note\n"
    )
    console = Console(width=80, record=True, file=sys.stderr)
    grid.print(console)
    words = console.export_text().split()
    assert words == ["a", "|", "b", "what", "how", "much", "[red]", "1.5", "a|b", "2", "a", "note"]


def test_no_word_of_a_table_is_broken_in_a_narrow_terminal() -> None:
    stream = io.StringIO()
    columns = ("scene", *(f"efficiency {number}" for number in range(9)))
    Grid("", columns, (("box", *["100,000 KB"] * 9),)).print(Console(file=stream, width=40))
    lines = [line for line in stream.getvalue().splitlines() if line.strip()]
    assert [line.split() for line in lines] == [" ".join(columns).split(), ["box", *["100,000", "KB"] * 9]]


def test_a_table_wants_full_rows() -> None:
    with pytest.raises(ValueError, match="a row of 1 cells in a table of 2 columns"):
        Grid("", ("a", "b"), (("1",),))


# ---- kernels ------------------------------------------------------------------------------------------------------


def test_kernels_are_compared_by_turns() -> None:
    pytest.importorskip("embreex")
    figures = kernels.measure(SilentProgress(), LIGHT_LOAD)
    work = [figure.work for figure in figures.figures]
    assert [line.partition(" in ")[0] for line in work[:4]] == ["closest hit", "any hit"] * 2
    assert work[4:] == [
        "5 nearest of 500 photons, coherent",
        "5 nearest of 500 photons, incoherent",
        "50 nearest of 500 photons, coherent",
        "50 nearest of 500 photons, incoherent",
        "map of 500 photons",
        "photons traced and stored in cornell-box",
    ]
    floors = [figure.floor_ratio for figure in figures.figures]
    assert floors == [1.0, None, 0.7, None, None, None, 1.7, 1.7, None, None]
    for figure in figures.figures[:-1]:
        assert figure.seconds is not None
        assert figure.peer_seconds is not None
        assert figure.ratio == figure.peer_seconds / figure.seconds
    assert figures.figures[-1].ratio is None
    rows = figures.grid().rows
    assert rows[0][1].endswith(" M/s")
    assert rows[0][2].startswith("Embree ")
    assert rows[4][2].startswith("cKDTree ")
    assert rows[8][4] == "0.36 µs *"
    assert rows[9][4] == "2.00 M/s *"
    assert json.loads(json.dumps(figures.to_dict()))["figures"][0]["ratio"] == figures.figures[0].ratio


def test_libraries_that_are_missing_cost_their_lines_only(monkeypatch: pytest.MonkeyPatch) -> None:
    hide(monkeypatch, kernels, "embreex", "scipy")
    rows = kernels.measure(SilentProgress(), LIGHT_LOAD).grid().rows
    assert [row[0] for row in rows] == [
        "closest hit and any hit: Embree not installed: pip install 'wdpm[peers]'",
        "5 nearest of 500 photons: SciPy not installed: pip install scipy",
        "50 nearest of 500 photons: SciPy not installed: pip install scipy",
        "map of 500 photons: SciPy not installed: pip install scipy",
        "photons traced and stored in cornell-box",
    ]


def test_a_scene_that_is_not_there_is_found_before_anything_is_timed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def timed(*_: Any, **__: Any) -> Any:
        raise AssertionError("too late")

    for module, name in ((kernels, "_compile"), (paper, "measure")):
        monkeypatch.setattr(module, name, timed)
    monkeypatch.chdir(tmp_path)
    for what in ("kernels", "paper"):
        assert main.main(["bench", what, "cornell-box", "nope.xml"]) == 2
        assert "nope.xml: no such file" in capsys.readouterr().err


def test_kernels_are_timed_without_words_of_warp(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    import warp as wp

    monkeypatch.setattr(wp.config, "log_level", wp.LOG_INFO)
    hide(monkeypatch, kernels, "embreex", "scipy")
    monkeypatch.setattr(kernels, "Load", lambda **_: LIGHT_LOAD)
    monkeypatch.setattr(photons, "seconds_per_photon", lambda *_: 1e-6)
    assert main.main(["bench", "kernels"]) == 0
    assert wp.config.log_level == wp.LOG_WARNING
    assert "Module " not in capfd.readouterr().err


@pytest.mark.parametrize(
    ("figure", "below"),
    [
        (kernels.Figure("w", True, 2.0, "p", 1.0, floor_ratio=0.6), True),
        (kernels.Figure("w", True, 2.0, "p", 1.0, floor_ratio=0.5), False),
        (kernels.Figure("w", True, 2.0, floor_seconds=1.9), True),
        (kernels.Figure("w", True, 2.0, floor_seconds=2.0), False),
        (kernels.Figure("w", True, None, "p", missing="pip"), False),
    ],
)
def test_what_is_below_its_floor_is_named(figure: kernels.Figure, below: bool) -> None:
    assert ("Below its floor: w." in kernels.KernelFigures(0.0, (figure,)).grid().notes) == below


# ---- paper --------------------------------------------------------------------------------------------------------


def in_memory(spoil: int | None = None) -> Callable[[Scene, RenderSettings, int], Image]:
    """A renderer without sockets; one pixel is off by 0.5 with `spoil` slaves."""

    def render(scene: Scene, settings: RenderSettings, slaves: int) -> Image:
        image = render_in_process(scene, settings, workers=max(slaves, 1), threads=1)
        if slaves != spoil:
            return image
        beauty = image.pixels.copy()
        beauty[0, 0, 0] += 0.5
        return replace(image, layers={**image.layers, "beauty": beauty})

    return render


def cluster_here(slaves: int, copies: Copies, /) -> Backend:
    return backend_here(slaves, copies=copies)


def measure_paper(**options: Any) -> paper.SceneFigures:
    small = {"size": (12, 8), "spp": 1, "photons": 600, "k": 5}
    slaves, routings = options.pop("slaves", (2, 0, 4)), options.pop("routings", (Routing.FORWARD,))
    backends = options.pop("backends", cluster_here)
    return paper.measure("cornell-box", slaves, routings, backends, SilentProgress(), **small, **options)


def test_the_papers_table() -> None:
    figures = measure_paper(routings=tuple(Routing), render=in_memory())
    assert [(run.slaves, run.routing) for run in figures.runs] == [
        (0, None),
        (2, "forward"),
        (2, "merge"),
        (4, "forward"),
        (4, "merge"),
    ]
    alone = figures.runs[0]
    assert (alone.photons, alone.triangles, alone.speed_up, alone.bytes) == ((1.0,), (1.0,), 1.0, 0)
    for run in figures.runs[1:]:
        assert len(run.photons) == len(run.triangles) == run.slaves
        assert sum(run.photons) >= 1.0  # every photon has an owner, and may have ghosts
        assert 0 < max(run.triangles) <= 1.0
        assert run.bytes > 0
        assert (run.mse, run.max_abs, run.bits_equal) == (0.0, 0.0, True)
    grid = figures.grid(cores=2)
    assert grid.title.startswith("cornell-box: ")
    assert grid.title.endswith(" photons, k 5, 12x8, 1 samples")
    assert [row[0] for row in grid.rows] == ["0", "2 forward", "2 merge", "4 forward", "4 merge"]
    assert {row[-1] for row in grid.rows} == {"equal"}
    assert grid.notes[-1].startswith("Cores are shared: this machine has 2 cores for 4 slaves, ")
    assert len(figures.grid(cores=4).notes) == 1
    assert json.loads(json.dumps(figures.to_dict()))["runs"][1]["slaves"] == 2


def test_a_bit_that_differs_is_seen() -> None:
    figures = measure_paper(slaves=(2,), render=in_memory(spoil=2))
    run = figures.runs[1]
    assert not run.bits_equal
    assert run.max_abs == pytest.approx(0.5)
    assert run.mse == pytest.approx(0.25 / (12 * 8 * 3))
    assert figures.grid().rows[1][-1] == "DIFFER"


@pytest.mark.sockets
def test_the_papers_table_over_sockets() -> None:
    figures = measure_paper(slaves=(2,), backends=cluster_here)
    run = figures.runs[1]
    assert run.bits_equal
    assert len(run.photons) == 2
    assert max(run.photons) < 1.0  # the scene is cut between them, as in the paper


# ---- command line -------------------------------------------------------------------------------------------------


def test_results_are_printed_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    figure = kernels.Figure("work", True, 1e-6, "peer", 2e-6)
    monkeypatch.setattr(kernels, "measure", lambda *_: kernels.KernelFigures(0.5, (figure,)))
    data, text = tmp_path / "f.json", tmp_path / "f.md"
    assert main.main(["bench", "kernels", "--json", str(data), "--markdown", str(text)]) == 0
    out = capsys.readouterr().out
    assert "work" in out
    assert "Measured on " in out
    written = json.loads(data.read_text())
    assert written["kernels"]["figures"][0]["ratio"] == 2.0
    assert written["machine"]["cores"] >= 1
    assert "| work | 1.00 M/s | peer 0.50 M/s | 2.00 | - |" in text.read_text()


def test_options_of_the_papers_table_reach_the_renders(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[Any] = []

    def measure(
        name: str, slaves: Any, routings: Any, backends: Backends, _: Any, **options: Any
    ) -> paper.SceneFigures:
        assert isinstance(options.pop("rows"), Rows)
        asked.append((name, slaves, routings, options | {"threads": backends(0).threads}))
        return paper.SceneFigures(name, 1, 1, 1, 1, 1, 1, ())

    monkeypatch.setattr(paper, "measure", measure)
    line = "bench paper atrium:9k --slaves 1,8 --routing both --size 6x4 --spp 2 --photons 1k --threads 2"
    assert main.main([*line.split(), "--indirect", "cache"]) == 0
    assert main.main(["bench", "paper", "--threads", "1"]) == 0
    capsys.readouterr()
    small = {"size": (6, 4), "threads": 2, "spp": 2, "photons": 1000}
    chosen = {**small, "copies": Copies.NONE, "indirect": Indirect.CACHE}
    assert asked[0] == ("atrium:9k", (1, 8), (Routing.FORWARD, Routing.MERGE), chosen)
    assert [name for name, *_ in asked[1:]] == ["cornell-box", "atrium:100k"]
    others = {"size": None, "threads": 1, "copies": Copies.NONE, "indirect": Indirect.MAP}
    assert asked[1][1:] == ((0, 2, 4), (Routing.FORWARD,), others)


@pytest.mark.parametrize(
    "arguments",
    [
        ["bench"],
        ["bench", "paper", "--slaves", "2,x"],
        ["bench", "paper", "--slaves", ""],
        ["bench", "paper", "--routing", "scenic"],
        ["bench", "peers"],
        ["bench", "predict", "cornell-box"],
        ["bench", "peers", "a.xml", "--rounds", "0"],
        ["bench", "effects", "--plot", "figures.png"],
        ["bench", "kernels", "--json", "figures.txt"],
        ["bench", "kernels", "--markdown", "no/such/folder/table.md"],
    ],
)
def test_a_mistyped_line_is_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert refusal(arguments, capsys)


def test_slave_counts_are_taken_once() -> None:
    assert arguments.slave_counts("4,0,4,2") == (4, 0, 2)
