"""Python's collector is off while a command starts, and on again from the render on, whatever happened."""

from __future__ import annotations

import gc
import subprocess
import sys
from collections.abc import Iterator

import pytest

from wdpm import starting
from wdpm.cli import main
from wdpm.rendering.in_process import InProcess


@pytest.fixture(autouse=True)
def collector_as_before() -> Iterator[None]:
    yield
    starting.let_collector_go()
    gc.unfreeze()
    assert gc.isenabled()


def test_it_is_off_until_it_is_let_go() -> None:
    starting.hold_off_collector()
    starting.hold_off_collector()
    assert not gc.isenabled()
    starting.let_collector_go()
    assert gc.isenabled()
    assert gc.get_freeze_count() > 0


def test_who_has_it_off_keeps_it_off() -> None:
    gc.disable()
    try:
        starting.hold_off_collector()
        starting.let_collector_go()
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


@pytest.mark.parametrize("name", ["zmq", "imageio"])
def test_a_render_without_slaves_does_not_load_what_it_does_not_need(name: str) -> None:
    code = f"import sys, wdpm.cli.main, wdpm.cli.result, wdpm.clusters; sys.exit({name!r} in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
