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


def rendered(path: str, *more: str) -> None:
    small = ["--photons", "500", "--spp", "2", "--indirect", "map", "-q"]
    assert main(["render", "cornell-box", *small, "-o", path, *more]) == 0


def test_a_crop_is_compared_with_its_part_of_the_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rendered("whole.exr", "--size", "24x16")
    rendered("crop.exr", "--size", "24x16", "--crop", "10,4,18,10")
    capsys.readouterr()
    for pair, said in (
        (["crop.exr", "whole.exr"], "A is the part 10,4,18,10 of 24x16, and is compared with that part of B"),
        (["whole.exr", "crop.exr"], "B is the part 10,4,18,10 of 24x16, and is compared with that part of A"),
    ):
        assert main(["compare", *pair, "--equal", "--json", "--flip", "none", "-o", "d.png"]) == 0
        out, err = capsys.readouterr()
        assert err == f"wdpm: {said}\n"
        assert (json.loads(out)["width"], json.loads(out)["height"]) == (8, 6)


def test_pixels_that_are_not_the_same_are_told_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rendered("one.exr", "--size", "24x16", "--crop", "0,0,8,6")
    rendered("other.exr", "--size", "24x16", "--crop", "10,4,18,10")
    rendered("whole.exr", "--size", "8x6")
    capsys.readouterr()
    for pair, said in (
        (["one.exr", "other.exr"], ["A is the part 0,0,8,6 of 24x16, B is the part 10,4,18,10 of 24x16: "]),
        (["whole.exr", "other.exr"], ["A is a whole image, B is the part 10,4,18,10 of 24x16: "]),
        (["one.exr", "one.exr"], []),
    ):
        assert main(["compare", *pair, "--flip", "none"]) == 0
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == len(said)
        assert all(part in line for part, line in zip(said, lines, strict=True))


def test_other_cameras_are_told_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, fov in (("a.exr", 40.0), ("b.exr", 50.0)):
        camera = {"to_world": np.eye(4).tolist(), "fov": fov, "crop": [0, 0, 5, 4], "full_size": [5, 4]}
        Image({"beauty": np.ones((4, 5, 3), np.float32)}, {"camera": camera}).save(name)
    assert main(["compare", "a.exr", "b.exr", "--flip", "none"]) == 0
    assert "their files name different cameras" in capsys.readouterr().err


@pytest.mark.usefixtures("two_images")
def test_what_a_screen_shows_is_no_radiance(capsys: pytest.CaptureFixture[str]) -> None:
    Image({"beauty": np.full((4, 5, 3), 3.0, np.float32)}).save("a.png")
    for pair, said in ((["a.png", "b.exr"], "A is a PNG"), (["b.exr", "a.png"], "B is a PNG")):
        assert main(["compare", *pair, "--flip", "none"]) == 0
        assert said in capsys.readouterr().err
    assert main(["compare", "a.png", "a.png", "--flip", "none"]) == 0
    assert capsys.readouterr().err == ""
