"""The notebooks of the documentation run from their first cell to their last, and are kept without outputs."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import pytest

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "docs" / "notebooks").glob("*.ipynb"))
EVERY_NOTEBOOK = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
SMALLER = {"size=(96, 96)": "size=(16, 16)", "photons=20_000": "photons=1_000", "subdivisions=3": "subdivisions=1"}
"""Where there is no need to look at the pictures."""


def code_of(path: Path) -> list[dict[str, Any]]:
    cells = json.loads(path.read_text())["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def test_there_are_some() -> None:
    assert NOTEBOOKS


@EVERY_NOTEBOOK
def test_outputs_are_stripped(path: Path) -> None:
    for cell in code_of(path):
        assert cell["outputs"] == []
        assert cell["execution_count"] is None


@EVERY_NOTEBOOK
def test_its_code_runs_in_a_plain_interpreter(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, Any] = {}
    for cell in code_of(path):
        source = "".join(cell["source"])
        for large, small in SMALLER.items():
            source = source.replace(large, small)
        exec(compile(ast.parse(source), str(path), "exec"), names)
    assert "live=True shows the image in a notebook" in capsys.readouterr().err


@pytest.mark.sockets
@pytest.mark.filterwarnings("ignore")  # of the libraries that run notebooks, and theirs
@EVERY_NOTEBOOK
def test_it_runs_as_a_notebook(path: Path) -> None:
    """Every cell, by a kernel; what it shows is there: the image that came up live, layers, tables."""
    nbformat = pytest.importorskip("nbformat", reason="the extra notebook is not installed: make test-notebook")
    nbclient = pytest.importorskip("nbclient", reason="the extra notebook is not installed: make test-notebook")
    pytest.importorskip("ipykernel", reason="the extra notebook is not installed: make test-notebook")
    document = nbformat.read(path, as_version=4)
    nbformat.validate(document)
    nbclient.NotebookClient(document, timeout=240, kernel_name="python3").execute()
    for cell in document.cells:
        if cell.cell_type == "code":
            check_outputs(cell.source, [output.data for output in cell.outputs if "data" in output])


def check_outputs(source: str, shown: list[Any]) -> None:
    """What a cell must have shown."""
    html = "".join(data.get("text/html", "") for data in shown)
    if "live=True" in source:
        assert any("image/png" in data for data in shown), source
        assert "done in" in html
    if source.endswith("\nscene") or source == "image.report" or "wdpm.inspect" in source:
        assert "<table>" in html, source
    if source == "image":
        assert any("image/png" in data for data in shown)
