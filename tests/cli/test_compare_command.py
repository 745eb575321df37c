"""`wdpm compare`: what it prints and draws, and what it refuses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from wdpm.cli.main import main
from wdpm.images.image import Image


@pytest.fixture
def two_images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, value in (("a.exr", 1.0), ("b.exr", 2.0)):
        Image({"beauty": np.full((4, 5, 3), value, dtype=np.float32)}).save(name)


@pytest.mark.usefixtures("two_images")
def test_compare_prints_and_draws(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", "a.exr", "b.exr", "-o", "d.png"]) == 0
    assert "differ in 20 pixels" in capsys.readouterr().out
    with PIL.Image.open("d.png") as picture:
        assert picture.size == (256, 38)
    assert main(["compare", "a.exr", "b.exr", "--json", "--region", "0,0,2,2"]) == 0
    assert json.loads(capsys.readouterr().out)["differing_pixels"] == 4


@pytest.mark.usefixtures("two_images")
def test_compare_equal_is_for_scripts() -> None:
    assert main(["compare", "a.exr", "b.exr", "--equal"]) == 1
    assert main(["compare", "a.exr", "a.exr", "--equal"]) == 0


@pytest.mark.usefixtures("two_images")
def test_compare_reports_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, message in (
        (["a.exr", "c.exr"], "c.exr: no such file"),
        (["a.exr", "b.exr", "-o", "d.jpg"], "must be one of .png"),
        (["a.exr", "b.exr", "--region", "0,0,9,9"], "not within the image of 5x4"),
    ):
        assert main(["compare", *arguments]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert message in err
        assert err.count("\n") == 1


@pytest.mark.usefixtures("two_images")
def test_compare_takes_no_option_that_it_would_ignore(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", "a.exr", "b.exr", "--signed"]) == 2
    assert "give -o FILE.png, too" in capsys.readouterr().err
    assert main(["compare", "a.exr", "b.exr", "--signed", "-o", "d.png"]) == 0


@pytest.mark.usefixtures("two_images")
def test_a_reader_that_leaves_is_no_error() -> None:
    command = [sys.executable, "-m", "wdpm", "compare", "a.exr", "b.exr"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 1
