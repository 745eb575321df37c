"""Files that are broken, or of another kind than their name says: one line that says so once, and of which file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from wdpm.scenes import cornell_box
from wdpm.scenes.errors import SceneError
from wdpm.scenes.images.read import read_texture
from wdpm.scenes.load import load
from wdpm.scenes.model.checks import check_scene

OF_ANOTHER_KIND = "cannot be read as an image: it is broken, or of another kind than its name says"

LOOKING = """<scene version="3.0.0"><shape type="cube"/><sensor type="perspective"><transform name="to_world">
<lookat origin="0 0 5" target="0 0 0" up="{up}"/></transform></sensor></scene>"""


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.hdr", b"text", "not a Radiance picture with rows from top to bottom ('-Y height +X width')"),
        ("a.hdr", b"#?RADIANCE\n\n-Y 2 +X 2\n\x02\x02", "ends in row 0 of 2: broken file"),
        ("a.pfm", b"text", "not a PFM file: expected 'PF', width, height and scale"),
        ("a.exr", b"text", "not an EXR file: it begins otherwise"),
        ("a.exr", b"\x76\x2f\x31\x01\x02\0\0\0", "cannot be read as EXR: the file is broken"),
        ("a.png", b"text", OF_ANOTHER_KIND),
        ("a.png", b"", OF_ANOTHER_KIND),
        ("a.tga", b"x", OF_ANOTHER_KIND),
        ("a", b"x", OF_ANOTHER_KIND),
    ],
)
def test_pictures(name: str, data: bytes, said: str, tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_bytes(data)
    with pytest.raises(SceneError) as caught:
        read_texture(file, raw=False)
    assert str(caught.value) == f"{file}: {said}"


def test_a_text_that_is_no_utf_8_is_named(tmp_path: Path) -> None:
    """OpenEXR cannot hand it over; the pixels may be whole."""
    file = tmp_path / "a.exr"
    OpenEXR.File({"owner": "MXller"}, {"RGB": np.zeros((2, 2, 3), np.float32)}).write(str(file))
    file.write_bytes(file.read_bytes().replace(b"MXller", b"M\xfcller"))
    with pytest.raises(SceneError, match=r"its header has b'M\\xfcller', which is no UTF-8; save it without"):
        read_texture(file, raw=False)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("", ": the scene is empty: it has no triangles"),
        (
            '<shape type="cube"><transform name="to_world"><scale value="0"/></transform></shape>',
            ':1: shape "cube": "to_world": the transform flattens space: its matrix has no inverse',
        ),
    ],
)
def test_scenes(body: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "a.xml"
    file.write_text(f'<scene version="3.0.0">{body}</scene>', encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        load(file)
    assert str(caught.value) == f"{file}{said}"


def test_what_is_missing_is_told_with_what_was_read_with_a_warning(tmp_path: Path) -> None:
    """A sun in the axes of others is below the horizon: "no light" alone said nothing of it."""
    file = tmp_path / "a.xml"
    night = '<emitter type="sky"><vector name="sun_direction" value="0, 1, -0.1"/></emitter>'
    file.write_text(f'<scene version="3.0.0"><shape type="cube"/>{night}</scene>', encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        load(file)
    said = str(caught.value)
    assert "the scene has no light" in said
    assert "the sun is below the horizon: the sky is black (its up is +z, unless to_world turns it)" in said


def test_no_more_than_some_warnings_are_told() -> None:
    box = cornell_box((4, 4))
    dark = tuple(replace(mesh, emission=None) for mesh in box.meshes)
    with pytest.raises(SceneError) as caught:
        check_scene(replace(box, meshes=dark, warnings=tuple(f"note {number};" for number in range(9))))
    assert "note 4;" in str(caught.value)
    assert "note 5;" not in str(caught.value)
    assert "and 4 more" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        (
            "a.stl",
            "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 -inf\nvertex 0 1 0\nendloop\nendfacet",
            'mesh "a": vertex 1 is (1, 0, -inf), 1 not finite in all',
        ),
        ("a.xml", LOOKING.format(up="0 1 1e308"), "<lookat>: up is parallel to the line from origin to target"),
        (
            "a.xml",
            '<scene version="3.0.0"><shape type="cube"/><emitter type="constant"><rgb name="radiance" value="1e39"/>'
            "</emitter></scene>",
            "its place or strength is negative or not finite in float32",
        ),
    ],
)
def test_numbers_that_are_none(name: str, text: str, said: str, tmp_path: Path) -> None:
    """NumPy has nothing to add."""
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        load(file)
    assert str(caught.value).endswith(said)
