"""`wdpm bench peers`: what is tried, what is confirmed and what is said of it, at the least size; never a time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wdpm.bench.commands import arguments
from wdpm.bench.commands import peers as peers_command
from wdpm.bench.peers import measure as peers
from wdpm.bench.peers import mitsuba_program
from wdpm.bench.peers.figures import PeerFigures, Reached, Try
from wdpm.bench.peers.grid import DEFAULTS, FAMILIES, FEW_PATHS, WAYS, Family, Member, Way
from wdpm.bench.peers.guess import guesses
from wdpm.bench.peers.law import Point
from wdpm.bench.peers.mitsuba import Cost, MitsubaProcess, Setup
from wdpm.bench.peers.target import Bounds, RelMse, Target
from wdpm.bench.rows import Rows
from wdpm.cli import main
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.images.image import Image
from wdpm.progress import SilentProgress
from wdpm.rendering.backend import Backend
from wdpm.rendering.in_process import InProcess
from wdpm.scenes.errors import SettingsError, WdpmError

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
    <transform name="to_world"><rotate y="1" angle="180"/><scale value="0.4"/><translate x="1.2" z="1"/></transform>
    <emitter type="area"><rgb name="radiance" value="9"/></emitter>
  </shape>
</scene>
"""

FEW = Family("few", (100, 400), (1, 2))


def even(error: float) -> RelMse:
    """Of an image whose pixels are all equally far off."""
    return RelMse(error, error)


def grey(value: float) -> np.ndarray:
    return np.full((6, 8, 3), value, np.float32)


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    """A lit wall, and a grey reference of 8x6 beside it."""
    (tmp_path / "scene.xml").write_text(SCENE_XML)
    Image({"beauty": grey(1.0)}).save(tmp_path / "reference.exr")
    return tmp_path / "scene.xml"


class FakeMitsuba:
    """Renders grey images: relMSE 1 / samples against a reference of 1."""

    version = "0"
    asked: list[int]

    def __init__(self, _: Any) -> None:
        FakeMitsuba.asked = []

    def __enter__(self) -> FakeMitsuba:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def render(self, spp: int, seed: int) -> tuple[np.ndarray, Cost]:
        FakeMitsuba.asked.append(seed)
        return off_by(1 / spp), Cost(spp / 4, spp / 2)


def off_by(rel_mse: float) -> np.ndarray:
    return grey(1.0 + (1.01 * rel_mse) ** 0.5)


class Fakes:
    """wdpm with errors and times that the settings name; what was rendered is kept."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, unlucky: tuple[int, int] | None = None) -> None:
        self.rendered: list[RenderSettings] = []
        self.unlucky_spp: set[int] = set()
        self.lucky: tuple[int, int] | None = None
        self._now = 0.0
        self._unlucky = unlucky
        monkeypatch.setattr(peers, "MitsubaProcess", FakeMitsuba)
        monkeypatch.setattr(peers, "render_in_passes", self.render)
        monkeypatch.setattr(peers.time, "perf_counter", lambda: self._now)
        monkeypatch.setattr(peers, "cpu_seconds", lambda: 2 * self._now)
        monkeypatch.setattr(peers, "find_spec", lambda name: name)

    def render(self, _: Any, backend: Backend, settings: RenderSettings) -> Image:
        assert backend.threads == 2
        self.rendered.append(settings)
        work = settings.spp * (settings.photons if settings.integrator is Integrator.PHOTONS else 50)
        self._now += work / 100
        error = 10 / work
        if (settings.spp, settings.photons) == self._unlucky and settings.seed:
            error *= 100
        if settings.spp in self.unlucky_spp and settings.seed:
            error *= 100
        if (settings.spp, settings.photons) == self.lucky and settings.seed:
            error /= 100
        chosen = {"integrator": settings.integrator.value, "indirect": settings.indirect.value}
        if settings.integrator is Integrator.AUTO:
            chosen = {"integrator": "photons", "indirect": "map" if settings.spp < 4 else "cache"}
        return Image({"beauty": off_by(error)}, {"settings": chosen})

    def measure(self, scene_file: Path, bounds: Bounds, *families: Family, rows: Rows | None = None) -> PeerFigures:
        return self.measure_ways(scene_file, bounds, Way("grid", families or (FEW,)), rows=rows)

    def measure_ways(self, scene_file: Path, bounds: Bounds, *ways: Way, rows: Rows | None = None) -> PeerFigures:
        reference = scene_file.with_name("reference.exr")
        backend = InProcess(threads=2)
        return peers.measure(scene_file, reference, bounds, backend, SilentProgress(), ways=ways, rows=rows)


# ---- the grid -----------------------------------------------------------------------------------------------------


def test_every_member_is_a_choice_of_settings() -> None:
    members = [member for family in FAMILIES for member in family.members()]
    assert len({member.name for member in members}) == len(members)
    for member in members:
        settings = member.settings(7, 5)
        assert (settings.photons, settings.spp, settings.seed, settings.max_depth) == (
            member.photons,
            member.spp,
            7,
            5,
        )
        assert settings.spp >= settings.passes
    (least, *_) = DEFAULTS.members()
    assert least.settings(7, 5) == RenderSettings(spp=1, seed=7, max_depth=5)
    assert least.name == "defaults, 1 samples"
    assert {member.settings(0, None).indirect for member in members} == {Indirect.MAP, Indirect.GATHER, Indirect.CACHE}


def test_members_come_after_those_with_less_work() -> None:
    for family in FAMILIES:
        members = list(family.members())
        for i, later in enumerate(members):
            assert not any(earlier.adds_to(later) for earlier in members[:i])
    assert Member(FEW, 400, 2).adds_to(Member(FEW, 400, 1))
    assert not Member(FEW, 100, 2).adds_to(Member(FEW, 400, 1))
    assert not Member(Family("other", (100, 400), (1, 2)), 400, 2).adds_to(Member(FEW, 100, 1))


# ---- guesses ------------------------------------------------------------------------------------------------------


def test_a_guess_lies_between_what_misses_and_what_reaches() -> None:
    many = Family("many", (100, 400), (4, 64))
    tries = [
        Try(Member(many, 100, 4), even(0.16), Cost(1.0, 2.0)),
        Try(Member(many, 100, 64), even(0.01), Cost(16.0, 32.0)),
        Try(Member(many, 400, 4), even(0.03), Cost(4.0, 8.0)),
        Try(Member(FEW, 100, 1), even(0.9), Cost(0.1, 0.2)),
    ]
    between, grid = guesses(tries, Target(0.04))
    assert between.member == Member(many, 100, 17)  # 16, and a margin
    assert between.cpu_s == pytest.approx(8)
    assert between.enough_spp == 64
    assert (grid.member, grid.cpu_s) == (Member(many, 400, 4), 8.0)
    assert [guess.member for guess in guesses(tries, Target(0.01))] == [Member(many, 100, 64)]
    assert not list(guesses(tries, Target(0.001)))


# ---- measuring ----------------------------------------------------------------------------------------------------


def test_the_least_that_reaches_an_error_is_confirmed(scene_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fakes = Fakes(monkeypatch)
    figures = fakes.measure(scene_file, Bounds((0.02, 0.2), rounds=3))
    assert [each.target.error for each in figures.reached] == [0.2, 0.02]  # falling
    loose, tight = figures.reached
    assert loose.wdpm is not None
    assert tight.wdpm is not None
    assert (loose.wdpm.member, tight.wdpm.member) == (Member(FEW, 100, 1), Member(FEW, 400, 2))
    assert loose.wdpm.errors.whole == pytest.approx(0.1, rel=1e-4)
    assert loose.wdpm.cost == Cost(pytest.approx(1), pytest.approx(2))
    assert loose.ratio == Cost(pytest.approx(1 / (5 / 4)), pytest.approx(2 / (5 / 2)))
    assert tight.ratio == Cost(pytest.approx(8 / (50 / 4)), pytest.approx(16 / (50 / 2)))
    seeds = [settings.seed for settings in fakes.rendered]
    assert seeds == [peers.WARM_SEED, 0, 0, 0, 0, 1, 2, 3, 1, 2, 3]
    assert len(FakeMitsuba.asked) == len(set(FakeMitsuba.asked)) == 1 + 3 + 6  # warm, 8 to 128, turns
    assert Target(0.0).law(figures.points).constant == pytest.approx(1, rel=1e-3)


def test_a_comparison_that_was_stopped_goes_on(
    scene_file: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    fakes = Fakes(monkeypatch)
    bounds, file = Bounds((0.02, 0.2), rounds=3), tmp_path / "rows.jsonl"
    whole = fakes.measure(scene_file, bounds, rows=Rows(file))
    lines = file.read_text().splitlines(keepends=True)
    assert len(lines) == 1 + 3 + 4 + 3 * 2 * 2  # head, Mitsuba, the grid, turns of both
    file.write_text("".join(lines[:6]))
    fakes.rendered.clear()
    again = fakes.measure(scene_file, bounds, rows=Rows(file, resume=True))
    assert again.to_dict() == whole.to_dict()
    assert len(fakes.rendered) == 1 + 2 + 6  # warm, the rest of the grid, turns
    assert file.read_text().splitlines(keepends=True) == lines


def test_a_lucky_render_does_not_count(scene_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures = Fakes(monkeypatch, unlucky=(1, 100)).measure(scene_file, Bounds((0.2,)))
    chosen = figures.reached[0].wdpm
    assert chosen is not None
    assert chosen.member == Member(FEW, 100, 2)
    assert figures.tries[0].errors.whole < 0.2


def test_what_reaches_an_error_with_one_seed_alone_is_said_to(
    scene_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is not the best of what missed the error: that has other seeds."""
    fakes = Fakes(monkeypatch)
    fakes.unlucky_spp = set(range(1, 9))
    figures = fakes.measure(scene_file, Bounds((0.02,)))
    (reached,) = figures.reached
    assert min(done.errors.whole for done in figures.tries) < 0.02
    assert reached.wdpm is None
    assert reached.rejected is not None
    assert reached.rejected.errors.whole > 0.02
    nearest = f"the best has {reached.rejected.errors.whole:.3g} ({reached.rejected.member.name})."
    missed = "-: of grid nothing tried reaches it with other seeds, as one did with the first; " + nearest
    assert figures.grid().notes[-1] == missed


def test_what_was_confirmed_for_another_error_counts(scene_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though with the first seed it missed this one."""
    fakes = Fakes(monkeypatch)
    fakes.lucky = (2, 400)
    figures = fakes.measure(scene_file, Bounds((0.02, 0.001)))
    near, far = figures.reached
    assert near.wdpm is not None
    assert far.wdpm is not None
    assert far.wdpm.member == Member(FEW, 400, 2)


def test_what_is_slower_than_enough_is_not_tried(scene_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures = Fakes(monkeypatch).measure(scene_file, Bounds((0.2,)))
    assert [each.member for each in figures.tries] == [Member(FEW, 100, 1)]
    assert figures.skipped == (Member(FEW, 400, 1), Member(FEW, 100, 2), Member(FEW, 400, 2))


def test_what_takes_too_long_is_not_tried(scene_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures = Fakes(monkeypatch).measure(scene_file, Bounds((1e-9,), limit_s=3))
    assert [each.member for each in figures.tries] == [Member(FEW, 100, 1), Member(FEW, 400, 1), Member(FEW, 100, 2)]
    assert figures.skipped == (Member(FEW, 400, 2),)
    assert {point.spp for point in figures.points} == {8}
    assert figures.reached[0].wdpm is None
    assert figures.reached[0].ratio is None
    assert figures.reached[0].mitsuba.extrapolated


def test_a_way_that_the_scene_does_not_take_is_told(scene_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fakes = Fakes(monkeypatch)

    def refuse(scene: Any, backend: Backend, settings: RenderSettings) -> Image:
        if settings.indirect is Indirect.CACHE:
            raise SettingsError("no cache here")
        return fakes.render(scene, backend, settings)

    monkeypatch.setattr(peers, "render_in_passes", refuse)
    figures = fakes.measure(scene_file, Bounds((0.02,)), Family("c", (100,), (1, 2), indirect=Indirect.CACHE), FEW)
    assert figures.refused == {"c": "no cache here"}
    assert "c: not rendered: no cache here" in figures.grid().notes
    assert len(figures.tries) == 4


def test_only_the_region_counts(scene_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reference = np.concatenate([grey(1.0)[:3], grey(50.0)[3:]])
    Image({"beauty": reference}).save(scene_file.with_name("reference.exr"))
    figures = Fakes(monkeypatch).measure(scene_file, Bounds((0.2,), (0, 0, 8, 3)))
    assert figures.reached[0].wdpm is not None
    assert "of pixels (0, 0, 8, 3)" in figures.grid().notes[0]


def test_the_table_and_the_json(scene_file: Path) -> None:
    points = (Point(8, even(0.125), Cost(2.0, 4.0)), Point(32, even(0.03125), Cost(8.0, 16.0)))
    loose, tight, theirs = Target(0.05), Target(0.005), Target(0.03125, trimmed=True, spp=32)
    law = loose.law(points)
    chosen = Try(Member(FEW, 400, 2), even(0.042), Cost(1.0, 1.6))
    plain = Try(Member(DEFAULTS, 0, 4), RelMse(0.05, 0.03), Cost(2.0, 2.0), "photons, cache")
    own = law.beyond(0.03125)
    figures = PeerFigures(
        scene_file,
        scene_file.with_name("reference.exr"),
        (8, 6),
        2,
        Bounds((0.05, 0.005), trim=0.001, samples=(32,)),
        "3",
        (chosen, plain),
        (),
        {},
        points,
        (Way("grid", (FEW,)), *WAYS[1:3]),
        (
            Reached(loose, "grid", chosen, None, law.to(0.05)),
            Reached(tight, "grid", None, None, law.to(0.005)),
            Reached(theirs, "defaults", plain, None, law.with_samples(32)),
            Reached(theirs, "path", None, own, law.with_samples(32)),
        ),
    )
    grid = figures.grid()
    reached, missed, by_default, by_path = grid.rows
    assert reached == (
        *("0.05", "few, 2 samples, 0k photons", "0.042", "1.00 s", "1.60 s"),
        *("20 samples", "5.00 s", "10.0 s", "0.20", "0.16", "-"),
    )
    assert missed == ("0.005", "-", "-", "-", "-", "200 samples*", "50.0 s*", "1 min 40 s*", "-", "-", "-")
    assert by_default == (
        *("0.0312 trimmed (32 samples)", "defaults, 4 samples (photons, cache)", "0.03", "2.00 s", "2.00 s"),
        *("32 samples", "8.00 s", "16.0 s", "0.25", "0.12", "0.12"),
    )
    assert by_path[1:5] == ("path, 32 samples*", "-", "8.00 s*", "16.0 s*")
    assert by_path[-1] == "1.00"
    assert grid.notes[-1] == "-: of grid nothing tried reaches it; the best has 0.042 (few, 2 samples, 0k photons)."
    assert "Trimmed: without the worst 0.10% of the pixels." in grid.notes[0]
    written = json.loads(json.dumps(figures.to_dict(), allow_nan=False))
    assert written["reached"][0]["ratio"] == {"wall_s": pytest.approx(0.2), "cpu_s": pytest.approx(0.16)}
    assert written["reached"][1]["wdpm"] is None
    assert written["reached"][2]["of_path"]["cpu_s"] == pytest.approx(0.125)
    assert written["reached"][2]["wdpm"]["chose"] == "photons, cache"
    assert written["tries"][0]["indirect"] == "map"
    assert written["mitsuba"][0]["spp"] == 8


# ---- errors that Mitsuba has, and errors without the worst pixels --------------------------------------------------


def test_defaults_and_paths_go_for_the_errors_that_mitsuba_has(
    scene_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fakes = Fakes(monkeypatch)
    figures = fakes.measure_ways(scene_file, Bounds((), samples=(32, 512), limit_s=100.0, rounds=1), *WAYS[1:3])
    assert [(each.target.spp, each.target.by_law, each.way) for each in figures.reached] == [
        (32, False, "defaults"),
        (32, False, "path"),
        (512, True, "defaults"),  # which Mitsuba would take 256 s for
        (512, True, "path"),
    ]
    near, own, far, own_far = figures.reached
    assert near.mitsuba.spp == 32
    assert near.mitsuba.cost.cpu_s == pytest.approx(16)
    assert near.wdpm is not None
    assert near.wdpm.chose == "photons, cache"
    assert near.wdpm.member.spp == 7  # 6.4, and a margin
    assert own.wdpm is not None
    assert own.wdpm.member == Member(FEW_PATHS, 0, 7)
    assert figures.of_path(near) == Cost(pytest.approx(1), pytest.approx(1))
    assert far.wdpm is not None
    assert far.wdpm.errors.whole <= far.target.error
    assert own_far.by_law is not None
    assert own_far.by_law.spp == pytest.approx(512 * 0.2, rel=1e-3)
    # By more samples other records are used, so that they were loaded before a time counts.
    at_four = [settings for settings in fakes.rendered if settings.spp == 4 and settings.seed == 0]
    assert len(at_four) == 2 + 1  # and one of path tracing


def test_what_paths_take_beyond_the_limit_is_told_by_their_law(
    scene_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = Fakes(monkeypatch).measure_ways(scene_file, Bounds((1e-4,), limit_s=1), WAYS[2])
    (reached,) = figures.reached
    assert reached.wdpm is None
    assert reached.by_law is not None
    assert reached.by_law.spp == pytest.approx(0.2 / 1e-4, rel=1e-3)
    assert figures.grid().rows[0][1] == "path, 2,000 samples*"
    assert figures.skipped == (Member(FEW_PATHS, 0, 16),)


def test_both_for_real(scene_file: Path, tmp_path: Path) -> None:
    pytest.importorskip("mitsuba")
    bounds = Bounds((1e9,), rounds=1)
    try:
        figures = peers.measure(
            scene_file,
            tmp_path / "reference.exr",
            bounds,
            InProcess(),
            SilentProgress(),
            ways=(Way("grid", (Family("few", (500,), (4,)),)),),
        )
    except WdpmError as error:
        if "llvm" not in str(error).lower():
            raise
        pytest.skip(f"Mitsuba has no LLVM here: {error}")
    chosen = figures.reached[0].wdpm
    assert chosen is not None
    assert chosen.cost.cpu_s > 0
    assert figures.points[-1].cost.cpu_s > 0
    # The wall is as bright for both: they are equally far from a grey image.
    assert chosen.errors.whole == pytest.approx(figures.points[-1].error.whole, rel=0.2)


def test_a_mitsuba_process_that_dies_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "peer.py"
    monkeypatch.setattr(mitsuba_program, "__file__", str(program))
    process = MitsubaProcess(Setup(tmp_path / "scene.xml", 4, 4))
    program.write_text("import sys; sys.exit('out of luck')\n")
    with pytest.raises(WdpmError, match="Mitsuba's process ended: out of luck"), process:
        pass
    program.write_text('input(); print(\'{"error": "no LLVM"}\', flush=True)\n')
    with pytest.raises(WdpmError, match=r"Mitsuba says: no LLVM \(DRJIT_LIBLLVM_PATH names"), process:
        pass


# ---- command line -------------------------------------------------------------------------------------------------


def test_errors_are_a_list() -> None:
    assert arguments.relative_errors("0.05,0.01") == (0.05, 0.01)
    assert Bounds((0.01, 0.05, 0.01)).errors == (0.05, 0.01)


def test_ways_are_a_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert peers_command._ways("path,defaults,path") == ("path", "defaults")
    with pytest.raises(SystemExit):
        main.main(["bench", "peers", "scene.xml", "--ways", "fast"])
    assert "'fast' is no way; expected some of grid,defaults,path,map,gather,cache" in capsys.readouterr().err


def test_peers_bench_says_what_is_wrong(
    scene_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def error_of(*arguments: str) -> str:
        assert main.main(["bench", "peers", *arguments]) == 2
        return [line for line in capsys.readouterr().err.splitlines() if line.startswith("wdpm: error: ")][-1]

    monkeypatch.setattr(peers, "find_spec", lambda name: name)
    here = str(scene_file)
    other = tmp_path / "other"
    other.mkdir()
    assert "give --reference FILE" in error_of(here, str(other / "scene.xml"))
    assert "expected a Mitsuba scene" in error_of("cornell-box", "--reference", str(tmp_path / "reference.exr"))
    assert "no such file" in error_of(str(other / "scene.xml"), "--reference", str(tmp_path / "reference.exr"))
    assert "--reference is of one scene, and there are 2" in error_of(here, here, "--reference", "x.exr")
    assert "expected a positive relMSE" in error_of(here, "--errors", "0.1,-1")
    assert "trim is 0.5; expected a share of the pixels, 0 to 0.1" in error_of(here, "--trim", "0.5")
    assert "region 0,0,9,9 is empty or not within the image of 8x6" in error_of(here, "--region", "0,0,9,9")
    Image({"beauty": grey(np.nan)}).save(other / "reference.exr")
    assert "144 values are not finite" in error_of(here, "--reference", str(other / "reference.exr"))
    monkeypatch.setattr(peers, "find_spec", lambda _: None)
    assert "Mitsuba 3 is not installed: pip install 'wdpm[peers]'" in error_of(here)


def test_all_scenes_are_looked_at_before_the_first_is_rendered(
    scene_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fakes = Fakes(monkeypatch)
    assert main.main(["bench", "peers", str(scene_file), str(tmp_path / "missing" / "scene.xml")]) == 2
    assert "missing" in capsys.readouterr().err
    assert not fakes.rendered
