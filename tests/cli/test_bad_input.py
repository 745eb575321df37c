"""What people get wrong: each gives one clear line on standard error, exit code 2, and no traceback."""

from __future__ import annotations

import socket
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wdpm.cli.main import main
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.limits import MOST_PIXELS, check_pixels
from wdpm.kernels.launch import Launcher
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Camera

SCENE = """<scene version="3.0.0">
    <sensor type="perspective"><film type="hdrfilm">
        <integer name="width" value="8"/><integer name="height" value="8"/>
    </film></sensor>
    {body}
</scene>"""

LAMP = '<shape type="sphere"><emitter type="area"><rgb name="radiance" value="1 1 1"/></emitter></shape>'


def ply(vertices: list[tuple[float, float, float]], faces: list[tuple[int, int, int]], cut: int = 0) -> bytes:
    """A binary PLY file, less its last `cut` bytes."""
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    body = np.array(vertices, "<f4").tobytes() + b"".join(struct.pack("<B3i", 3, *face) for face in faces)
    data = header.encode() + body
    return data[: len(data) - cut]


def said(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line on standard error of a command that must end with 2."""
    try:
        code = main(arguments)
    except SystemExit as ended:  # what the parser of the command line finds
        code = int(ended.code or 0)
    assert code == 2
    captured = capsys.readouterr()
    lines = [line for line in captured.err.splitlines() if line.startswith("wdpm: error: ")]
    assert len(lines) == 1, captured.err
    assert "Traceback" not in captured.err
    return lines[0]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ('<shape type="torus"/>', ["scene.xml:5", "torus"]),
        ('<shape type="sphere"><bsdf type="hair"/></shape>' + LAMP, ["scene.xml:5", "hair"]),
        (LAMP.replace("radiance", "radience"), ["scene.xml:5", "radience", "radiance"]),
        ('<shape type="ply"><string name="filename" value="gone.ply"/></shape>' + LAMP, ["gone.ply"]),
        ('<shape type="ply"><string name="filename" value="cut.ply"/></shape>' + LAMP, ["cut.ply"]),
        ('<shape type="ply"><string name="filename" value="nan.ply"/></shape>' + LAMP, ["nan"]),
        ("", ["no triangles"]),
        ('<shape type="sphere"/>', ["light"]),
        ("<shape", ["scene.xml:6"]),
    ],
    ids=[
        "unknown plugin",
        "plugin not supported",
        "unknown key",
        "missing mesh",
        "truncated PLY",
        "NaN vertex",
        "empty scene",
        "no light",
        "broken XML",
    ],
)
def test_a_wrong_scene(body: str, expected: list[str], here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    triangle = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    (here / "cut.ply").write_bytes(ply(triangle, [(0, 1, 2)], cut=9))
    (here / "nan.ply").write_bytes(ply([(0.0, float("nan"), 0.0), *triangle[1:]], [(0, 1, 2)]))
    (here / "scene.xml").write_text(SCENE.format(body=body))
    line = said(["render", "scene.xml"], capsys)
    for word in expected:
        assert word.lower() in line.lower()
    assert not (here / "scene.exr").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["missing.xml"], "missing.xml"),
        (["cornell-bax"], "cornell-box"),
        (["cornell-box", "-o", "image.bmp"], "image.bmp"),
        (["cornell-box", "-o", "nowhere/image.exr"], "nowhere"),
        (["cornell-box", "--band", "0.5"], "--inexact"),
        (["cornell-box", "--k", "0"], "--k"),
        (["cornell-box", "--radius", "0"], "radius"),
        (["cornell-box", "--k", "100000"], "k is 100000"),
    ],
)
def test_a_wrong_argument(arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert expected in said(["render", *arguments], capsys)


@pytest.mark.parametrize(
    "arguments",
    [
        ["render", "cornell-box"],
        ["render", "cornell-box", "--slaves", "2"],
        ["render", "cornell-box", "--until-error", "0.5"],
        ["render", "cornell-box", "--replay", "1,1,1"],
        ["slave", "tcp://127.0.0.1:1"],
        ["accuracy", "cornell-box"],
        ["accuracy", "cornell-box", "--predict"],
    ],
    ids=" ".join,
)
def test_a_device_that_is_not_there(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    line = said([*arguments, "--device", "cuda:99"], capsys)
    assert "there is no device 'cuda:99' on this machine" in line
    assert "cpu" in line


def test_an_image_that_has_no_room_in_memory(capsys: pytest.CaptureFixture[str]) -> None:
    line = said(["render", "cornell-box", "--size", "1000000x1000000"], capsys)
    assert "takes 171,363.4 GiB of memory" in line
    assert "--size" in line


def test_pixels_that_cannot_be_numbered() -> None:
    most = Camera(np.eye(4), 40.0, width=MOST_PIXELS, height=1)
    check_pixels(most)
    with pytest.raises(SettingsError, match="expected at most 2,147,483,647"):
        check_pixels(replace(most, height=2))
    scene = load("cornell-box", size=(2**16, 2**15))
    with pytest.raises(SettingsError, match="more than can be numbered"):
        prepare(scene, RenderSettings(), 1, Launcher("cpu", 1), SilentProgress())


@pytest.mark.parametrize("size", ["0x10", "10x-1", "10", "axb"])
def test_a_wrong_size(size: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "--size" in said(["render", "cornell-box", f"--size={size}"], capsys)


def test_an_occupied_port(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        line = said(["master", "cornell-box", "--slaves", "1", "--bind", f"tcp://127.0.0.1:{port}", "-q"], capsys)
    assert str(port) in line


def test_an_unreachable_master(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    line = said(["slave", f"tcp://127.0.0.1:{port}", "--timeout", "1"], capsys)
    assert str(port) in line
