"""Files that are broken, or of another kind than their name says: one line that says so once, and of which file."""

from __future__ import annotations

from pathlib import Path

import pytest

from wdpm.scenes.errors import SceneError
from wdpm.scenes.images.read import read_texture
from wdpm.scenes.load import load

OF_ANOTHER_KIND = "cannot be read as an image: it is broken, or of another kind than its name says"


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
