"""What people get wrong: each gives one clear line on standard error, exit code 2, and no traceback."""

from __future__ import annotations

import socket
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import exit_code
from free_ports import free_port

import wdpm
from wdpm import devices
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


HUGE = """<scene version="3.0.0"><emitter type="point"/><shape type="rectangle">
<transform name="to_world"><scale value="1e300"/></transform></shape></scene>"""
FAR = (
    '<scene version="3.0.0"><shape type="obj"><string name="filename" value="far.obj"/></shape>'
    '<emitter type="constant"/><sensor type="perspective"/></scene>'
)


GLTF = """{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
"accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
"bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"uri": "../out.bin", "byteLength": 36}]}"""


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


def said(arguments: list[str], capsys: pytest.CaptureFixture[str], *, code: int = 2) -> str:
    """The one line on standard error of a command that must end with a code."""
    assert exit_code(arguments) == code
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
        (["."], ".: not a scene: expected a file"),
        ([""], ".: not a scene: expected a file"),
        (["cornell-box", "-o", "image.bmp"], "image.bmp"),
        (["cornell-box", "-o", "nowhere/image.exr"], "nowhere"),
        (["cornell-box", "-o", "x" * 300 + ".exr"], "name too long"),
        (["x" * 300 + ".xml"], "name too long"),
        (["x" * 300 + ".xml", "-o", "image.exr"], "xxx.xml: file name too long"),
        (["cornell-box", "--band", "0.5"], "--inexact"),
        (["cornell-box", "--k", "0"], "--k"),
        (["cornell-box", "--radius", "0"], "radius"),
        (["cornell-box", "--k", "100000"], "k is 100000"),
        (["cornell-box", "--size", "8x8", "--radius", "1e-300"], "radius is 1e-300; expected between"),
        (["cornell-box", "--size", "8x8", "--radius", "1e300"], "in a scene of this size"),
        (["cornell-box", "-o", "a.exr", "--log", "./a.exr"], "cannot hold both the image and the log"),
        (["far.obj"], "far.obj:4: face corner 99999999999999999999: there is no v"),
        (["scene.%02d.xml", "--frames", "1..999999999"], "more than 1,000,000 frames: render them in several parts"),
        (["far.obj", "-o", "a.exr", "--log", "far.obj"], "cannot hold both the scene and the log"),
        (["far.obj", "-o", "a.exr", "--save-cache", "far.obj"], "cannot hold both irradiance records and the scene"),
    ],
)
def test_a_wrong_argument(arguments: list[str], expected: str, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n"
    (here / "far.obj").write_text(model)
    assert expected in said(["render", *arguments], capsys)
    assert (here / "far.obj").read_text() == model


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


@pytest.mark.parametrize(("memory", "expected"), [("64M", "takes 600 MiB before"), ("610M", "more --memory")])
def test_slaves_with_too_little_memory(memory: str, expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    line = said(["render", "cornell-box", "--size", "16x16", "--slaves", "1", "--memory", memory, "-q"], capsys)
    assert expected in line


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("--memory 2G", "--memory is of slaves, and there are none: give --slaves N, too"),
        ("--copies auto", "--copies is of slaves, and there are none: give --slaves N, too"),
        ("--remote-wdpm /opt/wdpm", "--remote-wdpm goes with --hosts: give that, too"),
        ("--shared . --slaves 2", "--shared goes with --slurm: give that, too"),
        ("--shared . --hosts anna", "--shared goes with --slurm: give that, too"),
    ],
)
def test_options_of_slaves_that_nobody_starts(words: str, expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert expected in said(["render", "cornell-box", *words.split(), "-q"], capsys)


def test_a_slave_with_too_little_memory_does_not_join(capsys: pytest.CaptureFixture[str]) -> None:
    """It was killed by its own limit, without a line that says why."""
    assert "takes 600 MiB before" in said(["slave", "tcp://127.0.0.1:1", "--memory", "50M"], capsys)


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("render cornell-box --slaves 4 --memory 2G -q", "--memory is 2.0 GiB for each of 4 slaves"),
        ("slave tcp://127.0.0.1:1 --memory 9G", "--memory is 9.0 GiB; this machine"),
    ],
)
def test_more_memory_than_the_machine_has(
    command: str, expected: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(devices, "machine_memory", lambda: 6 << 30)
    line = said(command.split(), capsys)
    assert expected in line
    assert "has 6.0 GiB in all: give" in line
    assert ("at most 1.5G" if "4 slaves" in expected else "at most 6.0G") in line


def test_slaves_with_enough_memory(here: Path) -> None:
    small = ["--size", "16x16", "--spp", "1", "--photons", "100", "--slaves", "1", "--memory", "2G"]
    assert main(["render", "cornell-box", *small, "-q", "-o", "box.exr"]) == 0
    assert (here / "box.exr").is_file()


def test_an_occupied_port(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        words = ["master", "cornell-box", "--slaves", "1", "--bind", f"tcp://127.0.0.1:{port}", "-q"]
        line = said(words, capsys, code=1)
    assert str(port) in line


AWAY = b'<transform name="to_world"><translate x="1e300"/></transform>'
NEAR = b'<float name="near_clip" value="1e300"/><float name="far_clip" value="1e301"/>'
FOG = '<medium name="interior" type="homogeneous"><float name="sigma_t" value="1e300"/></medium>'
BEAM = """<medium name="interior" type="homogeneous"><phase type="hg"><float name="g" value="0.99999999999"/></phase>
</medium>"""
TILES = """<bsdf type="diffuse"><texture type="checkerboard" name="reflectance">
<transform name="to_uv"><scale value="1e300"/></transform></texture></bsdf>"""


def lit(of_sphere: str, lamp: str) -> bytes:
    """A scene with a sphere and a lamp."""
    return SCENE.format(body=f'<shape type="sphere">{of_sphere}</shape>{lamp}').encode()


def nested(depth: int) -> str:
    return '<scene version="3.0.0">' + '<shape type="sphere">' * depth + "</shape>" * depth + "</scene>"


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("deep.xml", nested(20_000).encode(), ["deep.xml:1", "no deeper nesting"]),
        ("far.obj", b"v 0 0 0\nv 1e308 0 0\nv 0 1e308 0\nf 1 2 3\n", ["far.obj:2", "larger unit"]),
        ("far.xml", FAR.encode(), ["far.obj:2", "beyond 1e+37"]),
        ("huge.xml", HUGE.encode(), ["huge.xml:1", "beyond 1e+37"]),
        ("lamp.xml", lit("", LAMP.replace("1 1 1", "1e300 0 0")), ['"sphere (line 5)": emission', "float32"]),
        ("point.xml", lit("", '<emitter type="point"><rgb name="intensity" value="1e39"/></emitter>'), ["strength"]),
        ("far_camera.xml", lit("", LAMP).replace(b"<film", AWAY + b"<film"), ["camera's transform", "float32"]),
        ("near.xml", lit("", LAMP).replace(b"<film", NEAR + b"<film"), ["camera's clipping", "float32"]),
        (
            "eta.xml",
            lit('<bsdf type="dielectric"><float name="int_ior" value="1e300"/></bsdf>', LAMP),
            ["Dielectric.eta"],
        ),
        ("uv.xml", lit(TILES, LAMP), ["Diffuse.reflectance", "float32"]),
        ("fog.xml", lit(FOG, LAMP), ["sigma_t or albedo", "float32"]),
        ("beam.xml", lit(BEAM, LAMP), ["g is 0.99999999999; expected between -1 and 1, in float32"]),
    ],
)
def test_a_scene_out_of_all_proportion(
    name: str, content: bytes, expected: list[str], here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "far.obj").write_bytes(b"v 0 0 0\nv 1e308 0 0\nv 0 1e308 0\nf 1 2 3\n")
    (here / name).write_bytes(content)
    line = said(["inspect", name], capsys)
    assert all(part in line for part in expected), line


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.xml", '<scene version="3.0.0"><include filename="../out.xml"/></scene>'),
        ("a.xml", '<scene version="3.0.0"><include filename="link.xml"/></scene>'),
        ("a.xml", FAR.replace("far.obj", "../far.obj")),
        ("a.gltf", GLTF),
        ("a.obj", "mtllib ../out.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n"),
        ("b.obj", "mtllib b.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n"),
        ("../out.xml", ""),
    ],
)
def test_files_outside_of_the_scene_root(
    name: str, content: str, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    root = here / "root"
    root.mkdir()
    for outside in ("far.obj", "out.bin", "out.mtl", "out.png"):
        (here / outside).write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (here / "out.xml").write_text('<scene version="3.0.0"/>')
    (root / "link.xml").symlink_to(here / "out.xml")
    (root / "b.mtl").write_text("newmtl a\nmap_Kd ../out.png\n")
    if content:
        (root / name).write_text(content)
    monkeypatch.chdir(root)
    assert "lies outside of the scene root" in said(["inspect", name, "--scene-root", "."], capsys)


def test_a_scene_root_that_is_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert "is no folder" in said(["inspect", "cornell-box", "--scene-root", "nowhere"], capsys)


@pytest.mark.parametrize("size", [(100_000, 100_000), (1, 2_000_000_000)])
def test_a_picture_that_promises_more_than_it_has(
    size: tuple[int, int], here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Memory for its pixels, 37 GiB say, is not even asked for."""
    height, width = size
    (here / "a.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n\x02\x02\x10" % (height, width))
    assert f"ends before {height} rows" in said(["compare", "a.hdr", "a.hdr"], capsys)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--bind", "tcp://10.0.0.1:7117"], "--keys FOLDER"),
        (["--keys", "no-such-folder"], "cannot read the key"),
        (["--bind", "tcp://192.0.2.1:7117", "--insecure"], "must be an address of this machine"),
    ],
)
def test_a_master_that_cannot_listen_says_so_before_it_reads_the_scene(
    options: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert expected in said(["master", "no-such-scene.xml", "--slaves", "1", *options, "-q"], capsys)


def test_an_unreachable_master(capsys: pytest.CaptureFixture[str]) -> None:
    port = free_port()
    line = said(["slave", f"tcp://127.0.0.1:{port}", "--timeout", "1"], capsys, code=1)
    assert str(port) in line


@pytest.mark.parametrize("host", ["two..dots", "long" * 20])
def test_what_can_be_no_name_of_a_machine(host: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "that can be no name" in said(["slave", f"tcp://{host}:7117"], capsys)


@pytest.mark.parametrize(
    ("slaves", "most", "words"), [(0, None, "slaves is 0"), (4, 2, "most is 2; expected at least as many as slaves")]
)
def test_a_cluster_of_no_slaves(slaves: int, most: int | None, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        wdpm.Cluster.listen("tcp://127.0.0.1:0", slaves, most=most)
