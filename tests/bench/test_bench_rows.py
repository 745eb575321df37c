"""Rows of benchmarks: what is measured is kept at once, and is not measured again."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from wdpm.bench import paper, scaling
from wdpm.bench.rows import Rows
from wdpm.cli import main
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import Indirect, Routing
from wdpm.images.image import Image
from wdpm.progress import SilentProgress
from wdpm.rendering.backend import Backend
from wdpm.rendering.in_process import InProcess
from wdpm.scenes.errors import ClusterError, SettingsError

SMALL: dict[str, Any] = {"size": (8, 8), "photons": 200, "spp": 1, "indirect": Indirect.MAP}


def test_a_row_is_written_when_it_is_measured(tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    rows = Rows(file)
    assert rows.measured({"scene": "a", "slaves": 2}, lambda: {"seconds": 1.5}) == {"seconds": 1.5}
    assert json.loads(file.read_text().splitlines()[1]) == {
        "of": {"scene": "a", "slaves": 2},
        "figures": {"seconds": 1.5},
    }
    assert rows.has({"slaves": 2, "scene": "a"})
    assert not rows.has({"slaves": 4, "scene": "a"})


def never() -> dict[str, Any]:
    raise AssertionError("it was measured again")


def test_resuming_measures_nothing_again(tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    Rows(file).measured({"n": 1}, lambda: {"x": [1, 2.5, None]})
    again = Rows(file, resume=True)
    assert again.measured({"n": 1}, never) == {"x": [1, 2.5, None]}
    again.measured({"n": 2}, lambda: {"x": 3})
    assert Rows(file, resume=True).measured({"n": 2}, never) == {"x": 3}


def test_what_a_killed_process_left_half_written_is_dropped(tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    rows = Rows(file)
    rows.measured({"n": 1}, lambda: {"x": 1})
    with file.open("a") as stream:
        stream.write('{"of": {"n": 2}, "fig')
    again = Rows(file, resume=True)
    assert again.has({"n": 1})
    assert again.measured({"n": 2}, lambda: {"x": 2}) == {"x": 2}
    assert [json.loads(line).get("figures") for line in file.read_text().splitlines()] == [None, {"x": 1}, {"x": 2}]


def test_rows_of_others_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    Rows(file)
    with pytest.raises(SettingsError, match=r"is there already; give --resume"):
        Rows(file)
    file.write_text(file.read_text().replace('"cores": ', '"cores": 9'))
    with pytest.raises(SettingsError, match="of another machine, or of other versions"):
        Rows(file, resume=True)
    file.write_text("not rows\n")
    with pytest.raises(SettingsError, match="no rows of a benchmark"):
        Rows(file, resume=True)
    with pytest.raises(SettingsError, match="give --rows"):
        Rows(resume=True)


class Stopped(BaseException):
    """Stands for Ctrl-C."""


def test_the_paper_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    rendered: list[int] = []

    def backends(slaves: int, copies: Copies = Copies.AUTO, cores: int | None = None) -> Backend:  # noqa: ARG001
        return InProcess(threads=1)

    def render(scene: Any, settings: Any, slaves: int) -> Image:
        if slaves == 4 and len(rendered) < 3:
            raise Stopped
        rendered.append(slaves)
        return paper._render(scene, settings, 0, backends)

    def run(rows: Rows) -> paper.SceneFigures:
        return paper.measure(
            "cornell-box", (0, 2, 4), (Routing.FORWARD,), backends, SilentProgress(), render=render, rows=rows, **SMALL
        )

    with pytest.raises(Stopped):
        run(Rows(file))
    assert len(file.read_text().splitlines()) == 3
    assert rendered == [0, 2]
    rendered.append(-1)
    figures = run(Rows(file, resume=True))
    assert rendered == [0, 2, -1, 0, 4]  # the image to compare with is needed once more
    assert [each.slaves for each in figures.runs] == [0, 2, 4]
    assert all(each.bits_equal for each in figures.runs)
    count = len(rendered)
    assert run(Rows(file, resume=True)).to_dict() == figures.to_dict()
    assert len(rendered) == count
    assert figures.grid().rows[0][0] == "0"


def test_scaling_goes_on_too(tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    made: list[int] = []

    def backends(slaves: int, *_: object) -> Backend:
        made.append(slaves)
        return InProcess(threads=1)

    def run(rows: Rows) -> scaling.Scaling:
        return scaling.measure("cornell-box", (2,), (Copies.AUTO,), backends, SilentProgress(), rows=rows, **SMALL)

    first = run(Rows(file))
    assert made == [0, 2]
    assert run(Rows(file, resume=True)).to_dict() == first.to_dict()
    assert made == [0, 2]


def test_scaling_gives_slaves_so_much_memory(tmp_path: Path) -> None:
    """Figures of slaves with another amount of it are others."""
    file = tmp_path / "rows.jsonl"
    made: list[tuple[int, object]] = []

    def backends(slaves: int, *terms: object) -> Backend:
        made.append((slaves, terms[2] if len(terms) > 2 else None))
        return InProcess(threads=1)

    def run(memory: int | None) -> scaling.Scaling:
        rows = Rows(file, resume=file.exists())
        return scaling.measure(
            "cornell-box", (2,), (Copies.AUTO,), backends, SilentProgress(), memory=memory, rows=rows, **SMALL
        )

    first = run(700 << 20)
    assert made == [(0, None), (2, 700 << 20)]
    assert [row[1] for row in first.grid().rows] == ["-", "auto, 700.0 MB"]
    assert run(700 << 20).to_dict() == first.to_dict()
    assert len(made) == 2
    assert run(None).grid().rows[1][1] == "auto"
    assert made[2:] == [(0, None), (2, None)]  # the image to compare with is needed once more


def test_a_slave_that_is_lost_makes_no_figure() -> None:
    """Its CPU time would be missing, and what is left would stand in the row of as many slaves."""

    class Lossy(InProcess):
        left = 3

        @property
        def processes(self) -> tuple[int, ...]:
            self.left = max(self.left - 1, 1)
            return (os.getpid(),) * self.left

    with pytest.raises(ClusterError, match="1 of 2 slaves were lost, and their CPU time with them; measure again"):
        scaling.measure("cornell-box", (2,), (Copies.AUTO,), lambda *_: Lossy(threads=1), SilentProgress(), **SMALL)


def test_mistakes_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["bench", "paper", "--resume"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert main.main(["bench", "paper", "--rows", str(tmp_path / "rows.txt")]) == 2
    assert "must be one of .jsonl" in capsys.readouterr().err
