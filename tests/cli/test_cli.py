"""The command line: what is typed reaches what computes, and every mistake is one line and exit code 2."""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import exit_code, refusal

from wdpm.cli import compare, main
from wdpm.cli import options as cli_options
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import RenderSettings, Routing
from wdpm.images.image import Image, load
from wdpm.rendering.backend import Backend
from wdpm.rendering.compiling import Compiling
from wdpm.rendering.in_process import InProcess
from wdpm.report.report import Report, from_dict
from wdpm.scenes.errors import ClusterEndedError, ClusterError, MasterLostError, SceneError
from wdpm.scenes.model.scene import Camera, FilterKind, PixelFilter, Scene

COMMANDS = list(main.COMMANDS)


def scene(samples: int | None = None, max_depth: int | None = None) -> Scene:
    return Scene("a scene", (), (), (), Camera(np.eye(4), 40.0), samples, max_depth)


class Renderer:
    """Stands for the loader and for all that renders: remembers what it was asked for and gives a small image.

    Attributes:
        loaded, rendered: arguments of the loader and of render_in_passes.
        backend: arguments of what makes a backend.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from wdpm import clusters, local_backend
        from wdpm.cli import scene as loading
        from wdpm.rendering import passes

        self.scene = scene()
        self.pixels = np.full((2, 3, 3), 0.5, dtype=np.float32)
        self.loaded: dict[str, Any] = {}
        self.rendered: dict[str, Any] = {}
        self.backend: dict[str, Any] = {}
        monkeypatch.setattr(loading, "load", self.load)
        monkeypatch.setattr(passes, "render_in_passes", self.render)
        monkeypatch.setattr(local_backend, "backend_here", self.make_backend)
        monkeypatch.setattr(clusters.Cluster, "listen", self.listen)
        monkeypatch.setattr(clusters, "check_listening", lambda *_: None)

    def load(self, name: str, **options: Any) -> Scene:
        self.loaded = {"scene": name, **options}
        return self.scene

    def make_backend(self, **options: Any) -> InProcess:
        self.backend = options
        return InProcess()

    def listen(self, bind: str, slaves: int, **options: Any) -> InProcess:
        return self.make_backend(bind=bind, slaves=slaves, **options)

    def render(self, source: Callable[[], Scene], _: Backend, settings: RenderSettings, **options: Any) -> Image:
        self.rendered = {"scene": source(), "settings": settings, **options}
        return self.image()

    def image(self) -> Image:
        return Image({"beauty": self.pixels}, {"report": Report(phases={"render": 1.5}).to_dict()})


@pytest.fixture
def renderer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Renderer:
    monkeypatch.chdir(tmp_path)
    return Renderer(monkeypatch)


# ---- help and mistakes --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command_has_examples(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code([command, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"  wdpm {command} " in text.split("examples:")[1]
    assert "None" not in text


def test_the_first_page_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"\n    {command} " in text for command in COMMANDS)
    assert exit_code([]) == 2
    assert capsys.readouterr().err == text


@pytest.mark.parametrize("command", ["render", "bench"])
def test_help_needs_nothing_that_computes(command: str) -> None:
    code = (
        "import sys\n"
        "from wdpm.cli.main import main\n"
        f"try: main(['{command}', '--help'])\n"
        "except SystemExit: pass\n"
        "print(sorted({'warp', 'zmq', 'rich'} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "[]\n"


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code(["--version"]) == 0
    assert capsys.readouterr().out.startswith("wdpm ")


@pytest.mark.parametrize(
    "arguments",
    [
        ["paint"],
        ["render"],
        ["render", "x", "--colour", "red"],
        ["render", "x", "--phot", "10"],  # no abbreviations
        ["render", "x", "--size", "0x512"],
        ["render", "x", "--photons", "lots"],
        ["render", "x", "--spp", "0"],
        ["render", "x", "--routing", "scenic"],
        ["render", "x", "-D", "spp"],
        ["master", "x"],
        ["master", "x", "--slaves", "0"],
        ["master", "x", "--slaves", "2", "--keys", "k", "--insecure"],
        ["slave", "localhost"],
        ["slave", "tcp://localhost:7117", "--memory", "8"],
        ["bench", "everything"],
        ["compare", "a.exr"],
    ],
)
def test_a_mistyped_line_is_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert refusal(arguments, capsys)


def test_errors_and_interruption_have_their_exit_codes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def raises(error: BaseException) -> Any:
        def command(_: argparse.Namespace) -> int:
            raise error

        return command

    monkeypatch.setattr(compare, "run", raises(SceneError("no lamp", "a.xml", 3)))
    assert exit_code(["compare", "a", "b"]) == 2
    assert capsys.readouterr().err == "wdpm: error: a.xml:3: no lamp\n"
    monkeypatch.setattr(compare, "run", raises(KeyboardInterrupt()))
    assert exit_code(["compare", "a", "b"]) == 130
    assert capsys.readouterr().err == "wdpm: interrupted\n"
    for error, code in (
        (MasterLostError("the master has gone"), 75),
        (ClusterEndedError("no image"), 1),
        (ClusterError("a slave failed"), 1),
    ):
        monkeypatch.setattr(compare, "run", raises(error))
        assert exit_code(["compare", "a", "b"]) == code
        assert capsys.readouterr().err == f"wdpm: error: {error}\n"


# ---- render and master --------------------------------------------------------------------------------------------


def test_every_setting_has_an_option_and_none_is_unknown() -> None:
    assert {option.field for option in cli_options.SETTING_OPTIONS} == {f.name for f in fields(RenderSettings)}


def test_defaults_are_those_of_the_settings(renderer: Renderer) -> None:
    assert exit_code(["render", "cornell-box", "--quiet"]) == 0
    assert renderer.rendered["settings"] == RenderSettings()
    assert renderer.backend["slaves"] == 0
    assert renderer.backend["device"] == "cpu"
    assert renderer.backend["threads"] is None, "all there are"
    assert renderer.backend["compiling"] is Compiling.BESIDE
    assert renderer.loaded == {
        "scene": "cornell-box",
        "defines": {},
        "size": None,
        "lenient": False,
        "camera": None,
        "frame": None,
        "time": None,
    }
    assert load("cornell-box.exr").shape == (2, 3)


def test_every_option_arrives(renderer: Renderer) -> None:
    line = (
        "render a.xml --photons 1M --k 80 --radius 0.5 --spp 64 --light-samples 4 --max-depth 7 --seed 3 --bucket 16 "
        "--routing merge --band 0.5 --inexact --slaves 4 --threads 3 --device cuda:0 -D a=1 -D b=x --size 64x32 "
        "--lenient --camera left --compile first -q"
    )
    assert exit_code(line.split()) == 0
    assert renderer.rendered["settings"] == RenderSettings(
        photons=1_000_000,
        k=80,
        radius=0.5,
        spp=64,
        light_samples=4,
        max_depth=7,
        seed=3,
        bucket=16,
        routing=Routing.MERGE,
        band=0.5,
        inexact=True,
    )
    assert {name: renderer.backend[name] for name in ("slaves", "threads", "device", "compiling")} == {
        "slaves": 4,
        "threads": 3,
        "device": "cuda:0",
        "compiling": Compiling.FIRST,
    }
    assert renderer.loaded == {
        "scene": "a.xml",
        "defines": {"a": "1", "b": "x"},
        "size": (64, 32),
        "lenient": True,
        "camera": "left",
        "frame": None,
        "time": None,
    }


def test_negative_pixels_and_hdr_files_do_not_go_together(
    renderer: Renderer, capsys: pytest.CaptureFixture[str]
) -> None:
    camera = Camera(np.eye(4), 40.0, filter=PixelFilter(FilterKind.LANCZOS, 3.0))
    renderer.scene = Scene("a scene", (), (), (), camera)
    assert exit_code(["render", "a.xml", "-o", "a.hdr", "-q"]) == 2
    assert "negative lobes" in capsys.readouterr().err
    assert renderer.rendered == {}
    assert exit_code(["render", "a.xml", "-o", "a.exr", "-q"]) == 0


def test_what_the_scene_asks_for_lies_between_default_and_option(renderer: Renderer) -> None:
    renderer.scene = scene(samples=128, max_depth=5)
    exit_code(["render", "a.xml", "-q"])
    assert (renderer.rendered["settings"].spp, renderer.rendered["settings"].max_depth) == (128, 5)
    exit_code(["render", "a.xml", "-q", "--spp", "2", "--max-depth", "9"])
    assert (renderer.rendered["settings"].spp, renderer.rendered["settings"].max_depth) == (2, 9)


def test_several_outputs_and_the_report(renderer: Renderer, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code(["render", "a.xml", "-o", "a.exr", "-o", "a.png", "--report", "a.json"]) == 0
    assert np.array_equal(load("a.exr").pixels, renderer.pixels)
    assert load("a.png").shape == (2, 3)
    report = from_dict(json.loads(Path("a.json").read_text()))
    assert list(report.phases) == ["load", "render"]
    assert load("a.exr").metadata["report"] == report.to_dict()
    out, err = capsys.readouterr()
    assert out.startswith("wrote a.exr\nwrote a.png\n")
    assert "0 gathers left the band" in out
    assert err.startswith("load ...\n")


def test_pictures_are_exposed_and_a_dark_one_is_told_of(renderer: Renderer, capsys: pytest.CaptureFixture[str]) -> None:
    renderer.pixels = np.full((2, 3, 3), 0.18 / 4, dtype=np.float32)
    assert exit_code(["render", "a.xml", "-o", "a.exr", "-o", "a.png"]) == 0
    assert "wrote a.png at +0 stops: it is dark; --exposure auto would take +2\n" in capsys.readouterr().out
    dark = load("a.png").pixels
    assert exit_code(["render", "a.xml", "-o", "a.exr", "-o", "b.png", "--exposure", "auto"]) == 0
    assert "wrote b.png at +2 stops\n" in capsys.readouterr().out
    assert load("b.png").pixels == pytest.approx(4 * dark, rel=0.02)
    assert load("a.exr").metadata["look"] == {"exposure": 2.0, "transform": "standard"}
    assert np.array_equal(load("a.exr").pixels, renderer.pixels)


def test_quiet_is_quiet(renderer: Renderer, capsys: pytest.CaptureFixture[str]) -> None:  # noqa: ARG001
    assert exit_code(["render", "a.xml", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["rendr", "a.xml"], "there is no command 'rendr'; did you mean \"render\"? (see wdpm --help)"),
        (["xyzzy"], "there is no command 'xyzzy' (see wdpm --help)"),
        (["render", "a.xml", "--sps=4"], 'arguments: --sps=4; did you mean "--spp"? (see wdpm render --help)'),
        (["render", "a.xml", "b.xml"], "unrecognized arguments: b.xml (see wdpm render --help)"),
        (["bench", "peers", "a.xml", "--sample", "3"], 'did you mean "--samples"? (see wdpm bench peers --help)'),
    ],
)
def test_what_is_misspelt_is_named_with_what_was_meant(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code(words) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.endswith(message)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "a.bmp"], "unknown extension '.bmp'"),
        (["-o", "a.exr", "-o", "nowhere/a.png"], "there is no folder nowhere"),
        (["--report", "a.txt"], "unknown extension '.txt': must be one of .json"),
        (["--save-cache", "nowhere/records"], "there is no folder nowhere"),
        (["--save-cache", "."], "is a folder"),
        (
            ["--save-cache", "b.exr", "-o", "a.exr", "-o", "./b.exr"],
            "cannot hold both the image and irradiance records",
        ),
        (["--load-cache", "a.exr"], "cannot hold both the image and irradiance records"),
        (["--save-cache", "a.json", "--report", "a.json"], "cannot hold both the report and irradiance records"),
        (["--band", "0.5"], "use --inexact"),
        (["--radius", "-1"], "radius is -1.0"),
    ],
)
def test_what_cannot_work_is_told_before_the_scene_is_read(
    options: list[str], message: str, renderer: Renderer, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code(["render", "a.xml", *options]) == 2
    assert message in capsys.readouterr().err
    assert renderer.loaded == {}


def test_a_picture_that_cannot_be_written_does_not_cost_the_others(
    renderer: Renderer, capsys: pytest.CaptureFixture[str]
) -> None:
    renderer.pixels = np.full((2, 3, 3), np.nan, dtype=np.float32)
    assert exit_code(["render", "a.xml", "-q", "-o", "a.png", "-o", "a.exr"]) == 2
    assert capsys.readouterr().err.startswith("wdpm: error: a.png: 6 pixels are NaN")
    assert load("a.exr").shape == (2, 3)


def test_an_image_whose_place_is_gone_is_kept_elsewhere(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from wdpm.rendering import passes

    def render(*arguments: Any, **options: Any) -> Image:
        Path("out").rmdir()
        return renderer.render(*arguments, **options)

    Path("out").mkdir()
    Path("kept").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(Path("kept").resolve()))
    monkeypatch.setattr(passes, "render_in_passes", render)
    assert exit_code(["render", "a.xml", "-q", "-o", "out/a.png"]) == 2
    err = capsys.readouterr().err
    [kept] = Path("kept").glob("*/a.exr")
    assert err.startswith("wdpm: error: out/a.png: cannot be written: no such file")
    assert err.endswith(f"the image is kept in {kept.resolve()}\n")
    assert load(kept).shape == (2, 3)


def test_an_image_that_nowhere_takes_is_one_line(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from wdpm.rendering import passes

    def render(*arguments: Any, **options: Any) -> Image:
        Path("out").rmdir()
        monkeypatch.setattr(tempfile, "tempdir", str(Path("gone").resolve()))
        return renderer.render(*arguments, **options)

    Path("out").mkdir()
    monkeypatch.setattr(passes, "render_in_passes", render)
    assert exit_code(["render", "a.xml", "-q", "-o", "out/a.png"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("wdpm: error: out/a.png: cannot be written: no such file")
    assert err.count("\n") == 1


def test_a_full_disk_is_found_before_the_render(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    full = shutil.disk_usage(".")._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: full)
    assert exit_code(["render", "a.xml", "-q", "-o", "a.exr"]) == 2
    assert "has 1000 bytes left" in capsys.readouterr().err
    assert renderer.rendered == {}


def test_records_that_cannot_be_written_cost_neither_image_nor_report(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from wdpm.rendering import passes
    from wdpm.rendering.cache_file import CacheNotWrittenError

    def failing(*_: Any, **__: Any) -> Image:
        raise CacheNotWrittenError("a.rec: cannot be written", renderer.image())

    monkeypatch.setattr(passes, "render_in_passes", failing)
    assert exit_code(["render", "a.xml", "-q", "-o", "a.exr", "--report", "a.json", "--save-cache", "a.rec"]) == 2
    assert capsys.readouterr().err == "wdpm: error: a.rec: cannot be written\n"
    assert load("a.exr").shape == (2, 3)
    assert from_dict(json.loads(Path("a.json").read_text())).phases["render"] == 1.5


def test_a_picture_that_cannot_be_written_does_not_cost_the_report(
    renderer: Renderer, capsys: pytest.CaptureFixture[str]
) -> None:
    renderer.pixels = np.full((2, 3, 3), np.nan, dtype=np.float32)
    assert exit_code(["render", "a.xml", "-q", "-o", "a.png", "-o", "b.png", "--report", "a.json"]) == 2
    err = capsys.readouterr().err
    assert err.count("pixels are NaN") == 2
    assert err.count("\n") == 1
    assert Path("a.json").exists()


def test_the_master_gets_its_options(renderer: Renderer) -> None:
    line = (
        "master a.xml -q --slaves 3..5 --copies none --bind tcp://10.0.0.1:7000 --keys folder --spp 2 --join-timeout 2m"
    )
    assert exit_code(line.split()) == 0
    expected = {"keys": Path("folder"), "insecure": False, "join_timeout": 120.0, "observers": ()}
    expected |= {"bind": "tcp://10.0.0.1:7000", "slaves": 3, "most": 5, "copies": Copies.NONE}
    assert renderer.backend == expected
    assert renderer.rendered["settings"].spp == 2


def test_the_slave_gets_its_options(monkeypatch: pytest.MonkeyPatch) -> None:
    from wdpm import serving
    from wdpm.cluster.slave.process import PATIENCE_S

    asked: dict[str, Any] = {}
    monkeypatch.setattr(serving, "security_of", lambda *security: security)
    monkeypatch.setattr(serving, "serve", lambda *where, **options: asked.update(where=where, **options))
    words = ["slave", "tcp://10.0.0.1:7000", "--threads", "2", "--memory", "8G", "--insecure", "--rejoin", "1.5h"]
    assert exit_code(words) == 0
    assert asked == {
        "where": ("tcp://10.0.0.1:7000", ("tcp://10.0.0.1:7000", None, True)),
        "threads": 2,
        "device": "cpu",
        "memory": 8 * 2**30,
        "patience": PATIENCE_S,
        "rejoin": 5400.0,
        "wait_for_kernels": True,
        "life_line": False,
    }


@pytest.mark.parametrize(
    ("name", "output"),
    [
        ("scenes/hall.xml", "hall.exr"),
        ("atrium:2M", "atrium.exr"),
        ("cornell-box", "cornell-box.exr"),
        ("a.b.ply", "a.b.exr"),
    ],
)
def test_the_default_output(name: str, output: str) -> None:
    from wdpm.cli.result import default_output

    assert default_output(name) == Path(output)
