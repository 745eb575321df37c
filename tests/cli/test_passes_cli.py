"""`wdpm render --passes`: files beside the image, going on after an interruption, and what a person is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from command_line import refusal

from wdpm.cli import main
from wdpm.cli.journals import places_of
from wdpm.cluster.allotment import Allotment
from wdpm.images import files
from wdpm.images.image import load
from wdpm.progress import SilentProgress
from wdpm.rendering import passes
from wdpm.rendering.pass_progress import PassProgress
from wdpm.rendering.passes import PassPlan, PassRenderer
from wdpm.report.report import from_dict
from wdpm.scenes.errors import ClusterError

SMALL = ["--size", "16x12", "--photons", "1000", "--k", "20", "--spp", "6", "--passes", "3", "-q"]


def words(output: Path, *more: str) -> list[str]:
    return ["render", "cornell-box", *SMALL, "-o", str(output), *more]


def render(output: Path, *more: str) -> int:
    return main.main(words(output, *more))


def fail_at(monkeypatch: pytest.MonkeyPatch, number: int, error: BaseException) -> None:
    """Have pass `number` fail."""
    whole = PassRenderer.render

    def failing(self: PassRenderer, plan: PassPlan, *samples: Allotment) -> Any:
        if plan.number == number:
            raise error
        return whole(self, plan, *samples)

    monkeypatch.setattr(passes.PassRenderer, "render", failing)


def test_the_image_has_error_layers_and_leaves_no_journal(tmp_path: Path) -> None:
    output = tmp_path / "box.exr"
    assert render(output, "--passes", "4") == 0
    image = load(output)
    assert {"noise", "bias"} <= image.layers.keys()
    assert image.metadata["settings"]["passes"] == 4
    report = from_dict(image.metadata["report"])
    assert report.error is not None
    assert len(report.passes) == 4
    assert not places_of(output).passes.exists()


@pytest.mark.parametrize(
    ("error", "code"), [(KeyboardInterrupt(), 130), (ClusterError("slave 1 (here, process 7) is lost"), 1)]
)
def test_an_interrupted_render_says_how_to_go_on(
    error: BaseException,
    code: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    output, whole = tmp_path / "box.exr", tmp_path / "whole.exr"
    with monkeypatch.context() as patched:
        fail_at(patched, 2, error)
        assert render(output) == code
    told = capsys.readouterr().err
    assert f"{places_of(output).passes} keeps the passes so far; the same command with --resume goes on" in told
    assert not output.exists()
    assert render(output, "--resume") == 0
    assert render(whole) == 0
    assert load(output).digest() == load(whole).digest()
    assert not places_of(output).passes.exists()


def test_what_a_killed_render_left_half_written_goes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was killed while it wrote the mean of its passes; another one that runs has a file of that kind as well."""
    output = tmp_path / "box.exr"
    parts = [files._temporary(places_of(output).passes) for _ in range(2)]
    with monkeypatch.context() as patched:
        patched.setattr(files.os, "getpid", lambda: 2**22 + 1)  # more than any process has
        parts.append(files._temporary(places_of(output).passes))
    for part in parts:
        part.touch()
    assert render(output) == 0
    assert sorted(path for path in tmp_path.iterdir() if path != output) == sorted(parts[:2])


def test_passes_that_are_kept_can_be_added_to(tmp_path: Path) -> None:
    output, whole = tmp_path / "box.exr", tmp_path / "whole.exr"
    assert render(output, "--keep-passes") == 0
    assert places_of(output).passes.exists()
    assert render(output, "--passes", "5", "--spp", "10", "--resume") == 0
    assert not places_of(output).passes.exists()
    assert render(whole, "--passes", "5", "--spp", "10") == 0
    assert load(output).digest() == load(whole).digest()


def test_an_image_that_cannot_be_written_costs_no_pass(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "box.exr"

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("wdpm.images.files.write_whole", full)
        assert render(output) == 2
    assert "no space left on device" in capsys.readouterr().err
    assert render(output, "--resume") == 0
    assert load(output).metadata["settings"]["passes"] == 3


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--passes", "9"], "passes is 9, more than spp, which is 6; each pass needs a sample of its own"),
        (["--passes", "0"], "--passes"),
    ],
)
def test_mistakes_are_one_line(
    more: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in refusal(words(tmp_path / "box.exr", *more), capsys)
    assert list(tmp_path.iterdir()) == []


class Told(SilentProgress):
    """What a person is told, in order."""

    def __init__(self) -> None:
        self.phases: list[tuple[str, int | None]] = []
        self.advanced: list[int] = []

    def start(self, phase: str, total: int | None = None) -> None:
        self.phases.append((phase, total))
        self.advanced = []

    def advance(self, amount: int = 1) -> None:
        self.advanced.append(amount)


@pytest.mark.parametrize("divided", [1, 2, 7])
def test_progress_is_one_phase_over_all_passes(divided: int) -> None:
    told = Told()
    progress = PassProgress(told, buckets=2, passes=3)
    progress.start("partition", 1)
    progress.advance(1)
    assert told.advanced == [1]
    for number in range(3):
        progress.start("photons", 100)
        progress.advance(100)
        progress.start("map", 1)
        progress.start("render", divided)
        for _ in range(divided):
            progress.advance(1)
        assert sum(told.advanced) == 2 * (number + 1)
    assert told.phases == [("partition", 1), ("passes", 6)]


def test_what_was_done_of_a_pass_that_begins_anew_counts_once() -> None:
    told = Told()
    progress = PassProgress(told, buckets=4, passes=2)
    progress.start("render", 8)
    for _ in range(5):
        progress.advance(1)
    assert sum(told.advanced) == 2
    progress.start("render", 8)  # a slave was lost; five buckets are kept
    progress.advance(5)
    assert sum(told.advanced) == 2
    progress.advance(3)
    assert sum(told.advanced) == 4
    progress.start("render", 6)
    progress.advance(6)
    assert sum(told.advanced) == 8
    assert min(told.advanced) >= 0
