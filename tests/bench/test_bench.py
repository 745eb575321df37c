"""`wdpm bench`: every benchmark at the least size. What is asserted is what the tables say, never a time."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from wdpm.bench import caustic, indirect, kernels, mitsuba, paper, photons
from wdpm.bench.commands import arguments
from wdpm.bench.rows import Rows
from wdpm.cli import main
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import Indirect, RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.local_backend import backend_here
from wdpm.progress import SilentProgress
from wdpm.rendering.backend import Backend, Backends
from wdpm.rendering.in_process import InProcess, render_in_process
from wdpm.report.grid import Grid
from wdpm.scenes.errors import ImageError, WdpmError
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Scene

LIGHT_LOAD = kernels.Load(
    rays=64, seconds=0.0, photons=500, neighbours=((5, 4), (50, 4)), rounds=1, photon_rounds=1, photon_task_paths=1000
)

SCENE_XML = """\
<scene version="3.0.0">
  <sensor type="perspective">
    <float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><rfilter type="box"/></film>
  </sensor>
  <shape type="rectangle">
    <transform name="to_world"><scale value="3"/><translate z="-1"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></bsdf>
  </shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="0.4"/></transform>
    <emitter type="area"><rgb name="radiance" value="3"/></emitter>
  </shape>
  <shape type="rectangle">
    <transform name="to_world"><rotate y="1" angle="180"/><scale value="0.4"/><translate x="1.2" z="1"/></transform>
    <emitter type="area"><rgb name="radiance" value="9"/></emitter>
  </shape>
</scene>
"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    """A wall, a lamp that is seen in the middle of the image, and one that shines on the wall."""
    file = tmp_path / "scene.xml"
    file.write_text(SCENE_XML)
    return file


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

    for module, name in ((kernels, "_compile"), (paper, "measure"), (indirect, "measure")):
        monkeypatch.setattr(module, name, timed)
    monkeypatch.chdir(tmp_path)
    for what in ("kernels", "paper", "indirect"):
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


# ---- caustic ------------------------------------------------------------------------------------------------------


def caustic_figures(scene_file: Path, error: float = 0.01) -> caustic.CausticFigures:
    rounds = tuple(caustic.Round(seconds, error, 10.0, 0.1) for seconds in (1.0, 2.0, 30.0))
    bound = caustic.Bound(Path("reference.exr"), (0, 0, 4, 4), 0.02)
    return caustic.CausticFigures(mitsuba.Setup(scene_file, mitsuba_spp=64), bound, "3", rounds)


def test_mitsubas_time_follows_from_its_error(scene_file: Path) -> None:
    figures = caustic_figures(scene_file)
    assert figures.mitsuba_seconds == pytest.approx(50.0)  # five times the error wants five times the samples
    assert figures.ratio == pytest.approx(2.0 / 50.0)
    grid = figures.grid()
    assert [row[0].partition(",")[0] for row in grid.rows] == ["wdpm", "Mitsuba 3 path", "the same", "wdpm / Mitsuba"]
    assert grid.rows[2] == ("the same, 320 samples (1 / samples)", "50.0 s", "0.02")
    assert len(grid.notes) == 1
    assert json.loads(json.dumps(figures.to_dict()))["ratio"] == figures.ratio


def test_a_bound_that_is_missed_is_told(scene_file: Path) -> None:
    figures = caustic_figures(scene_file, error=0.03)
    assert not figures.reached
    assert "the ratio says nothing" in figures.grid().notes[1]


def test_caustic_bench_by_turns(scene_file: Path, tmp_path: Path) -> None:
    pytest.importorskip("mitsuba")
    reference = tmp_path / "reference.npy"
    np.save(reference, np.full((12, 16, 3), 0.1, np.float32))
    bound = caustic.Bound(reference, (2, 2, 14, 10), 1e9)
    settings = RenderSettings(spp=4, photons=500, k=5)
    try:
        figures = caustic.measure(scene_file, bound, settings, 4, InProcess(), SilentProgress(), rounds=1)
    except WdpmError as error:
        if "llvm" not in str(error).lower():
            raise
        pytest.skip(f"Mitsuba has no LLVM here: {error}")
    assert figures.reached
    assert figures.rounds[0].wdpm_error == pytest.approx(figures.rounds[0].mitsuba_error, rel=0.3)


def test_caustic_bench_says_what_is_wrong(scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def error_of(*arguments: str) -> str:
        assert main.main(["bench", "caustic", *arguments]) == 2
        return [line for line in capsys.readouterr().err.splitlines() if line.startswith("wdpm: error: ")][-1]

    reference = tmp_path / "reference.npy"
    np.save(reference, np.zeros((4, 6, 3), np.float32))
    assert "expected a Mitsuba scene" in error_of("cornell-box", "--reference", str(reference))
    here = [str(scene_file), "--reference", str(reference)]
    assert "expected a positive relMSE" in error_of(*here, "--error", "0")
    pytest.importorskip("mitsuba")
    assert "region 0,0,9,9 is empty or not within the image of 6x4" in error_of(*here, "--region", "0,0,9,9")


# ---- mitsuba ------------------------------------------------------------------------------------------------------


def test_the_edges_of_emitters_are_left_out(scene_file: Path) -> None:
    scene = load(scene_file, size=(24, 24))
    edges = mitsuba.emitter_edges(scene, InProcess(), RenderSettings())
    assert edges.shape == (24, 24)
    assert not edges[0].any()  # wall
    assert not edges[12, 12]  # within the lamp
    row = np.flatnonzero(edges[12])
    assert set(np.diff(row)) - {1}  # an edge on either side of the lamp, and a gap between them
    clean, dirty = np.zeros((24, 24, 3), np.float32), np.zeros((24, 24, 3), np.float32)
    dirty[edges] = 1.0
    dirty[0, 0, 0] = 2.0
    errors = mitsuba.errors_of([clean, dirty], clean, edges)
    kept = 3 * (~edges).sum()
    assert errors.rmse_no_edges == pytest.approx(np.sqrt(4.0 / kept / 2))
    assert errors.rmse == pytest.approx(np.sqrt((4.0 + 3 * edges.sum()) / (3 * 24 * 24) / 2))


def test_mitsuba_and_wdpm_by_turns(scene_file: Path, tmp_path: Path) -> None:
    pytest.importorskip("mitsuba")
    settings = RenderSettings(spp=4, photons=500, k=5)
    setup = mitsuba.Setup(scene_file, 16, 12, settings, mitsuba_spp=4, rounds=2)
    reference = tmp_path / "reference.npy"
    np.save(reference, np.full((12, 16, 3), 0.1, np.float32))
    try:
        figures = mitsuba.measure(setup, reference, InProcess(), SilentProgress())
    except WdpmError as error:
        if "llvm" not in str(error).lower():
            raise
        pytest.skip(f"Mitsuba has no LLVM here: {error}")
    assert len(figures.rounds) == 2
    assert figures.ratio == pytest.approx(np.mean([each.wdpm_s / each.mitsuba_s for each in figures.rounds]))
    assert figures.wdpm is not None
    assert figures.mitsuba is not None
    # The same scene through the same camera: the wall and the lamp are where they should be for both.
    assert figures.wdpm.rmse == pytest.approx(figures.mitsuba.rmse, rel=0.1)
    assert figures.edge_pixels is not None
    assert 0 < figures.edge_pixels < 1
    grid = figures.grid()
    assert [row[0].partition(" ")[0] for row in grid.rows] == ["wdpm,", "Mitsuba", "wdpm"]
    assert json.loads(json.dumps(figures.to_dict()))["setup"]["settings"]["photons"] == 500


def test_without_a_reference_there_are_no_errors(scene_file: Path) -> None:
    rounds = (mitsuba.Round(3.0, 2.0), mitsuba.Round(1.0, 2.0), mitsuba.Round(2.0, 2.0))
    figures = mitsuba.MitsubaFigures(mitsuba.Setup(scene_file), "3", rounds, None, None, None)
    assert figures.ratio == 1.0
    assert figures.grid().rows[-1] == ("wdpm / Mitsuba", "1.00", "-", "-")
    assert "round by round: 1.50 0.50 1.00" in figures.grid().notes[0]
    assert "--reference" in figures.grid().notes[1]


def test_mitsuba_bench_says_what_is_wrong(
    scene_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def error_of(*arguments: str) -> str:
        assert main.main(["bench", "mitsuba", *arguments]) == 2
        return [line for line in capsys.readouterr().err.splitlines() if line.startswith("wdpm: error: ")][-1]

    assert "'cornell-box' cannot be rendered by both: expected a Mitsuba scene" in error_of("cornell-box")
    hide(monkeypatch, mitsuba, "mitsuba")
    assert error_of(str(scene_file)).endswith("Mitsuba 3 is not installed: pip install 'wdpm[peers]'")
    monkeypatch.setattr(mitsuba, "find_spec", lambda name: name)
    reference = tmp_path / "reference.npy"
    np.save(reference, np.zeros((4, 6, 3), np.float32))
    said = error_of(str(scene_file), "--reference", str(reference))
    assert "is 6x4, and the render 512x512: use --size 6x4" in said


def test_a_mitsuba_process_that_dies_is_one_line(
    scene_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "peer.py"
    monkeypatch.setattr(mitsuba.mitsuba_peer, "__file__", str(program))
    setup = mitsuba.Setup(scene_file)
    program.write_text("import sys; sys.exit('out of luck')\n")
    with pytest.raises(WdpmError, match="Mitsuba's process ended: out of luck"), mitsuba.MitsubaProcess(setup):
        pass
    program.write_text('input(); print(\'{"error": "no LLVM"}\', flush=True)\n')
    with (
        pytest.raises(WdpmError, match=r"Mitsuba says: no LLVM \(DRJIT_LIBLLVM_PATH names"),
        mitsuba.MitsubaProcess(setup),
    ):
        pass


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
        ["bench", "mitsuba"],
        ["bench", "mitsuba", "a.xml", "--rounds", "0"],
        ["bench", "caustic", "a.xml"],
        ["bench", "effects", "--plot", "figures.png"],
        ["bench", "kernels", "--json", "figures.txt"],
        ["bench", "kernels", "--markdown", "no/such/folder/table.md"],
    ],
)
def test_a_mistyped_line_is_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code: Any = main.main(arguments)
    except SystemExit as exit:
        code = exit.code
    assert code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("wdpm: error: ")
    assert err.count("\n") == 1


def test_an_edge_everywhere_is_an_error() -> None:
    black = np.zeros((1, 1, 3), np.float32)
    with pytest.raises(ImageError, match="every pixel lies at an emitter's edge"):
        mitsuba.errors_of([black], black, np.ones((1, 1), np.bool_))


def test_slave_counts_are_taken_once() -> None:
    assert arguments.slave_counts("4,0,4,2") == (4, 0, 2)
