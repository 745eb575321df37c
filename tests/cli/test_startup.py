"""Python's collector is off while a command starts, and on again from the render on, whatever happened."""

from __future__ import annotations

import gc
import subprocess
import sys
from collections.abc import Iterator

import pytest

from wdpm import startup
from wdpm.cli import main
from wdpm.rendering.in_process import InProcess


@pytest.fixture(autouse=True)
def collector_as_before() -> Iterator[None]:
    yield
    startup.let_collector_go()
    gc.unfreeze()
    assert gc.isenabled()


def test_it_is_off_until_it_is_let_go() -> None:
    startup.hold_off_collector()
    startup.hold_off_collector()
    assert not gc.isenabled()
    startup.let_collector_go()
    assert gc.isenabled()
    assert gc.get_freeze_count() > 0


def test_who_has_it_off_keeps_it_off() -> None:
    gc.disable()
    try:
        startup.hold_off_collector()
        startup.let_collector_go()
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_it_is_on_in_a_render(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    on: dict[str, bool] = {}
    prepare, run = InProcess.prepare, InProcess.run

    def prepared(self: InProcess, *arguments: object) -> object:
        on["before"] = gc.isenabled()
        return prepare(self, *arguments)  # type: ignore[arg-type]

    def ran(self: InProcess, *arguments: object) -> object:
        on["in the render"] = gc.isenabled()
        return run(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(InProcess, "prepare", prepared)
    monkeypatch.setattr(InProcess, "run", ran)
    line = f"render cornell-box --size 8x8 --spp 1 --photons 500 --indirect map --all-effects -q -o {tmp_path}/a.pfm"
    assert main.main(line.split()) == 0
    assert on == {"before": False, "in the render": True}


def test_it_is_on_after_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["render", "no-such-scene.xml", "-q"]) == 2
    assert gc.isenabled()
    assert "no such file" in capsys.readouterr().err


NOT_FOR_ANY = ("imageio", "trimesh", "scipy", "aiohttp", "wdpm.bench", "wdpm.accuracy", "wdpm.scenes.gltf")
"""Modules that no render of a Mitsuba file and no slave has a use for."""

NOT_FOR_A_RENDER = (*NOT_FOR_ANY, "zmq", "wdpm.serving", "wdpm.view.page", "wdpm.replaying")

NOT_FOR_A_SLAVE = (
    *NOT_FOR_ANY,
    "PIL",
    "OpenEXR",
    "rich",
    "wdpm.cluster.master",
    "wdpm.goal",
    "wdpm.report",
    "wdpm.scenes.images",
    "wdpm.scenes.mitsuba",
    "wdpm.scenes.spectra",
)


def loaded_by(program: str) -> set[str]:
    """Modules, and the packages that they lie in, that a program of Python has imported when it ends."""
    code = f"import sys\n{program}\nprint('LOADED', *sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.rpartition("LOADED ")[2].split())


def test_a_render_without_slaves_loads_nothing_that_it_does_not_need(tmp_path: object) -> None:
    line = f"render cornell-box --size 8x8 --spp 1 --photons 500 --indirect map --all-effects -q -o {tmp_path}/a.png"
    loaded = loaded_by(f"from wdpm.cli.main import main\nassert main({line.split()}) == 0")
    assert "wdpm.kernels.photons.gather" in loaded
    assert not loaded & {*NOT_FOR_A_RENDER, "wdpm.scenes.mitsuba"}


def test_a_render_of_a_mitsuba_file_loads_no_other_reader() -> None:
    loaded = loaded_by("import wdpm.cli.result, wdpm.cli.goal, wdpm.clusters, wdpm.scenes.mitsuba.read")
    assert not loaded & {*NOT_FOR_A_RENDER, "wdpm.scenes.builtin.atrium"}


def test_a_slave_loads_nothing_that_it_does_not_need() -> None:
    program = "from wdpm.cli.main import make_parser\nmake_parser('slave')"
    loaded = loaded_by(f"{program}\nimport wdpm.serving, wdpm.cluster.work.worker, wdpm.cluster.work.cell")
    assert "zmq" in loaded
    assert not loaded & set(NOT_FOR_A_SLAVE)


@pytest.mark.parametrize("words", [["--help"], ["render", "--help"], ["slave", "--help"]])
def test_help_loads_nothing_that_computes(words: list[str]) -> None:
    loaded = loaded_by(f"from wdpm.cli.main import main\ntry: main({words})\nexcept SystemExit: pass")
    assert "wdpm.cli.render" in loaded or "wdpm.cli.slave" in loaded
    assert not loaded & {"warp", "zmq", "PIL", "OpenEXR", "rich"}
