"""Sequences: which frames are rendered, where to, and that each has the bits that it has alone."""

from __future__ import annotations

import base64
import itertools
import json
from argparse import ArgumentTypeError
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import refusal

from wdpm import values
from wdpm.cli.main import main
from wdpm.images.image import load

QUICK = ["--photons", "2000", "--spp", "1", "--max-depth", "3", "--size", "16x12", "--indirect", "map"]
CAMERA, ROOM = 1, 0


def moving(folder: Path, node: int) -> Path:
    """Two walls of a corner and a lamp, seen by a camera; one of them moves to the right by 0.5 a second."""
    wall = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, -1, 0], [1, 1, 0], [-1, 1, 0]], "<f4")
    floor = wall[:, [0, 2, 1]] * np.array([1, 1, -1], "<f4") + np.array([0, -1, 1], "<f4")
    corners = np.concatenate([wall, floor])
    places = {ROOM: [0, 0, 0], CAMERA: [0, 0, 3], 2: [0, 0, 6]}
    x, y, z = places[node]
    keys, moves = np.array([0, 10], "<f4"), np.array([[x, y, z], [x + 5, y, z]], "<f4")
    blob = corners.tobytes() + keys.tobytes() + moves.tobytes()
    ends = np.cumsum([0, corners.nbytes, keys.nbytes, moves.nbytes]).tolist()
    views = [{"buffer": 0, "byteOffset": a, "byteLength": b - a} for a, b in itertools.pairwise(ends)]
    kinds = (("VEC3", 12), ("SCALAR", 2), ("VEC3", 2))
    document = {
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0}}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}],
        "nodes": [
            {"mesh": 0, "name": "floor"},
            {"camera": 0, "translation": places[CAMERA]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": places[2]},
        ],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 300}]}},
        "accessors": [
            {"bufferView": number, "componentType": 5126, "type": kind, "count": count}
            for number, (kind, count) in enumerate(kinds)
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": len(blob), "uri": "data:;base64," + base64.b64encode(blob).decode()}],
        "animations": [
            {
                "samplers": [{"input": 1, "output": 2}],
                "channels": [{"sampler": 0, "target": {"node": node, "path": "translation"}}],
            }
        ],
    }
    file = folder / "moving.gltf"
    file.write_text(json.dumps(document))
    return file


def phases(file: Path) -> dict[str, Any]:
    return dict(load(file).metadata["report"]["phases"])


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("text", "numbers"), [("7", (7,)), ("0", (0,)), ("1..3", (1, 2, 3)), ("1..8..3", (1, 4, 7)), ("5..5", (5,))]
)
def test_frames_on_the_command_line(text: str, numbers: tuple[int, ...]) -> None:
    assert values.frames(text) == numbers


@pytest.mark.parametrize("text", ["", "3..1", "1..", "a", "1..4..0", "-1..3", "1,2", "1...3"])
def test_what_are_no_frames(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match=r"expected FIRST\.\.LAST"):
        values.frames(text)


def test_a_moving_camera_keeps_photons_and_every_frame_its_bits(tmp_path: Path) -> None:
    file = str(moving(tmp_path, CAMERA))
    assert main(["render", file, "--frames", "0..24..12", "-o", "a.exr", "-o", "a.png", "-q", *QUICK]) == 0
    names = [f"a.{number:04d}" for number in (0, 12, 24)]
    assert sorted(path.stem for path in Path().glob("a.*.exr")) == names
    images = [load(f"{name}.exr") for name in names]
    assert images[0].metadata["camera"]["to_world"][0][3] == 0.0
    assert images[2].metadata["camera"]["to_world"][0][3] == 0.5  # a second at half a unit
    assert "photons" in phases(Path("a.0000.exr"))
    assert "photons" not in phases(Path("a.0012.exr"))
    assert len({image.digest() for image in images}) == 3
    assert main(["render", file, "--frames", "24", "-o", "alone.exr", "-q", *QUICK]) == 0
    assert load("alone.0024.exr").digest() == images[2].digest()
    assert main(["render", file, "--frames", "24", "--slaves", "2", "-o", "cut.exr", "-q", *QUICK]) == 0
    assert load("cut.0024.exr").digest() == images[2].digest()
    looks = {image.metadata["look"]["exposure"] for image in images}
    assert len(looks) == 1  # found in the first frame, or pictures would flicker
    assert looks != {0.0}


def test_where_a_surface_moves_photons_are_traced_anew(tmp_path: Path) -> None:
    file = str(moving(tmp_path, ROOM))
    assert main(["render", file, "--frames", "1..2", "--fps", "2", "-o", "b.%02d.exr", "-q", *QUICK]) == 0
    assert "photons" in phases(Path("b.02.exr"))
    assert main(["render", file, "--frames", "2", "--fps", "2", "-o", "c.exr", "-q", *QUICK]) == 0
    assert load("c.0002.exr").digest() == load("b.02.exr").digest()


SCENE = (
    '<scene version="3.0.0"><shape type="rectangle"/><emitter type="constant"/><sensor type="perspective">'
    '<transform name="to_world"><lookat origin="{x},0,4" target="0,0,0" up="0,1,0"/></transform></sensor>{more}</scene>'
)


def test_passes_that_were_kept_of_frames_can_be_added_to(capsys: pytest.CaptureFixture[str]) -> None:
    for number in (1, 2):
        Path(f"s.{number}.xml").write_text(SCENE.format(x=number, more=""))
    line = ["render", "s.%d.xml", "--frames", "1..2", *QUICK]
    longer = ["--spp", "4", "--passes", "4"]
    assert main([*line, *longer, "-q", "-o", "at_once.%d.exr"]) == 0
    assert main([*line, "--spp", "2", "--passes", "2", "-q", "-o", "a.%d.exr", "--keep-passes"]) == 0
    assert main([*line, *longer, "-q", "-o", "a.%d.exr", "--resume", "--keep-passes"]) == 0
    assert [load(f"a.{number}.exr").digest() for number in (1, 2)] == [
        load(f"at_once.{number}.exr").digest() for number in (1, 2)
    ]
    capsys.readouterr()
    assert main([*line, *longer, "-o", "a.%d.exr", "--resume", "--keep-passes"]) == 0
    assert capsys.readouterr().out == "frame 1: is there\nframe 2: is there\n"


def test_numbered_scenes_go_on_where_one_is_bad_and_resume_renders_what_is_missing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for number in range(1, 4):
        Path(f"s.{number:03d}.xml").write_text(SCENE.format(x=number, more="\n<shape/>" if number == 2 else ""))
    line = ["render", "s.%03d.xml", "--frames", "1..3", *QUICK]
    assert main(line) == 2
    out, err = capsys.readouterr()
    assert "wdpm: error: frame 2: s.002.xml:2: " in err
    assert err.endswith("wdpm: error: 1 of 3 frames failed: 2\n")
    assert "frame 3 (3 of 3)\nwrote s.003.exr\n" in out
    written = Path("s.003.exr").stat().st_mtime_ns
    Path("s.002.xml").write_text(SCENE.format(x=2, more=""))
    assert main([*line, "--resume"]) == 0
    out, err = capsys.readouterr()
    assert "frame 1: is there\nframe 2 (2 of 3)\nwrote s.002.exr\nframe 3: is there\n" in out
    assert Path("s.003.exr").stat().st_mtime_ns == written
    Path("s.002.exr").write_bytes(b"")
    assert main([*line, "--resume"]) == 0
    assert "frame 1: is there\nframe 2 (2 of 3)\nwrote s.002.exr\nframe 3: is there\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["cornell-box", "--frames", "1..3"], "cornell-box does not move"),
        (["s.%03d.xml"], "give --frames A..B, too"),
        (["s.%03d.xml", "--frames", "1..2"], "frame 1: s.001.xml: no such file"),
        (["s.%03d.xml", "--frames", "1..2", "--fps", "3"], "numbered scenes have no time"),
        (["cornell-box", "--fps", "3"], "give --frames A..B, too"),
        (["a.glb", "--frames", "1..2", "--until-error", "0.1"], "--until-error is for one image"),
        (["a.glb", "--frames", "1..2", "--metric", "rmse"], "--metric is for one image"),
        (["a.glb", "--frames", "1..2", "--replay", "1,1,1"], "--replay is for one image"),
        (["a.glb", "--frames", "2..1"], "are no frames"),
        (["a.glb", "--frames", "1..2", "--fps", "0"], "must be above 0"),
    ],
)
def test_what_cannot_be_is_one_line(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert message in refusal(["render", *arguments], capsys)
