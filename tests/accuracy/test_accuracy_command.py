"""What `wdpm accuracy` says of itself, and which options --predict refuses."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from wdpm.accuracy.predict import Foretold, Predictions
from wdpm.cli import main
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.goal.goal import Metric
from wdpm.goal.schedule import Schedule
from wdpm.goal.trial import Trial


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--seeds", "3"], "--seeds"),
        (["--clock", "wall"], "--clock"),
        (["--budget", "5m"], "--budget"),
        (["--trim", "0"], "--trim"),
        (["--reference-time", "3s"], "--reference-time"),
        (["-o", "folder"], "--output"),
        (["--slaves", "2"], "--slaves"),
        (["--reference", "c.exr", "--sweep", "k=5,9"], "--sweep, --reference"),
    ],
)
def test_predictions_refuse_options_of_sweeps(
    options: list[str], named: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("wdpm.cli.scene.load", lambda *_, **__: pytest.fail("loaded"))
    assert main.main(["accuracy", "cornell-box", "--predict", *options]) == main.EXIT_BAD_INPUT
    error = capsys.readouterr().err.strip()
    assert f"--predict makes no sweep, and has no use for these: leave {named} out" in error
    assert "\n" not in error


@pytest.mark.parametrize(("integrator", "photons"), [(Integrator.PATH, "none"), (Integrator.PHOTONS, "250,000")])
def test_predictions_of_path_tracing_show_no_photons(integrator: Integrator, photons: str) -> None:
    settings = RenderSettings(integrator=integrator)
    schedule = Schedule(settings, Trial(settings, 0.0, 1.0, 1.0, 0.1, 0.1, 0.0), 2.0, 0.1, 0.1)
    text = io.StringIO()
    Predictions(Metric.RELMSE, {0.1: Foretold.of(schedule)}, 1.0, 1.0).print(Console(file=text, width=120))
    row = text.getvalue().splitlines()[1]
    assert photons in row
    assert ("250,000" in row) == (photons != "none")


def test_help_tells_which_settings_are_not_swept_by_default(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main.main(["accuracy", "--help"])
    text = " ".join(capsys.readouterr().out.split()).replace("- ", "-")
    assert "except caustic-k, caustic-radius, volume-samples, volume-radius)" in text


def swept(capsys: pytest.CaptureFixture[str], folder: Path, *options: str) -> tuple[str, str]:
    """What a small sweep says on standard output, and of its plan on standard error."""
    small = ["accuracy", "cornell-box", "--size", "12x10", "--spp", "2", "--reference-time", "0.01s", "-o", str(folder)]
    assert main.main([*small, *options]) == 0
    said = capsys.readouterr()
    return said.out, said.err


def test_shadow_rays_are_swept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, plan = swept(capsys, tmp_path, "--photons", "800", "--sweep", "light-samples=1,4")
    assert "plan: 2 points" in plan
    assert "light-samples: 1, 4" in plan


def test_the_base_of_path_tracing_has_no_photons(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result, plan = swept(capsys, tmp_path, "--integrator", "path", "--sweep", "spp=1,4")
    assert "base: path tracing, 2 samples, 0 slaves" in plan
    assert "photons, k" not in plan + result
