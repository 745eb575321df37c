"""`wdpm bench hard-cases`: the suite beside the sources, or a line that says that it is not there."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from wdpm.bench import hard_cases
from wdpm.bench.hard_cases import Figures
from wdpm.cli import main


def test_the_suite_runs_and_its_page_is_written(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    page, figures = tmp_path / "page", tmp_path / "figures.json"
    line = ["bench", "hard-cases", "--small", "--only", "equal distances", "-o", str(page), "--json", str(figures)]
    assert main.main(line) == 0
    assert "equal distances" in (page / "index.html").read_text()
    (case,) = json.loads(figures.read_text())["hard_cases"]["cases"]
    assert (case["name"], case["verdict"], case["problems"]) == ("equal distances", "passes", [])
    assert "5. Photons and gather" in capfd.readouterr().out


def test_sections_are_counted() -> None:
    verdicts = ("passes", "limit", "fails", "passes now")
    cases = tuple(
        {"name": verdict, "section": "1. Scale", "verdict": verdict, "seconds": 2.0, "problems": []}
        for verdict in verdicts
    )
    figures = Figures(Path("index.html"), cases)
    assert figures.failed == 2
    assert figures.grid().rows == (("1. Scale", "4", "1", "1", "2", "8 s"),)


@pytest.mark.parametrize("only", [["equl", "distances"], ["nosuchthing"]])
def test_names_of_no_case_are_an_error_that_shows_the_nearest(
    only: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page"
    assert main.main(["bench", "hard-cases", "--only", *only, "-o", str(page)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert " and ".join(repr(text) for text in only) in line
    assert "--list" in line
    assert ("'equal distances'" in line) == (only[0] == "equl")
    assert not page.exists()


def test_the_suite_itself_says_that_no_case_has_such_a_name(tmp_path: Path) -> None:
    command = [
        sys.executable,
        str(hard_cases.find_suite()),
        "--only",
        "nosuchthing",
        "-o",
        str(tmp_path / "page"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("run.py: error: --only: no hard case has 'nosuchthing'")
    assert not (tmp_path / "page").exists()


def test_without_the_repository_it_says_where_the_suite_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(hard_cases, "SUITE", Path("no") / "such.py")
    assert main.main(["bench", "hard-cases", "-o", str(tmp_path)]) == 2
    assert "clone the repository" in capsys.readouterr().err
