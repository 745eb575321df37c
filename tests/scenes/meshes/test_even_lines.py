"""Long runs of lines of one form are read by a shorter way: it finds what reading line by line finds, or nothing."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wdpm.scenes.meshes.obj import read_by_lines
from wdpm.scenes.meshes.obj_plain import read_plain_obj
from wdpm.scenes.meshes.text import obj_piece
from wdpm.scenes.meshes.text.even_lines import read_even

COUNT = 9  # of each kind of vertex at the begin of a file, so that faces have something to name
DOT, SLASH = b"./"


def decimal(decimals: int) -> st.SearchStrategy[str]:
    texts = st.floats(-1e7, 1e7).map(lambda x: f"{x:.{decimals}f}")
    return texts | st.sampled_from(["-0.0", ".5", "-.25", "7.", "0.1234567", "99999999.9999999", "123456789.5"])


@st.composite
def vertices(draw: st.DrawFn) -> list[str]:
    """Lines of one kind, most often of one form."""
    word, width = draw(st.sampled_from([("v", 3), ("v", 6), ("v", 4), ("vt", 1), ("vt", 2), ("vt", 3), ("vn", 3)]))
    gap, end = draw(st.sampled_from([" ", "  ", "\t"])), draw(st.sampled_from(["", " ", "\r"]))
    row = st.lists(decimal(draw(st.integers(1, 7))), min_size=width, max_size=width)
    rows = draw(st.lists(row, min_size=1, max_size=12))
    return [f"{word} {gap.join(row)}{end}" for row in rows]


@st.composite
def faces(draw: st.DrawFn) -> list[str]:
    form = draw(st.sampled_from(["{}", "{}/{}", "{}//{}", "{}/{}/{}"]))
    corners, end = draw(st.integers(3, 5)), draw(st.sampled_from(["", " "]))
    index = st.lists(st.integers(1, COUNT), min_size=3 * corners, max_size=3 * corners)
    rows = draw(st.lists(index, min_size=1, max_size=12))
    return ["f " + " ".join(form.format(*row[3 * i : 3 * i + 3]) for i in range(corners)) + end for row in rows]


ODD = (
    "", "# v 1.5 2.5 3.5", "usemtl red", "f -1 -2 -3", "f 1 2 3 4", "v 1 2 3", "v 1e-3 2.5 .5", "vt 0.5",
    "f 1/1 2/2 3/3", "vn 0.1 0.2 0.30000000000000004", "v +1.5 2.5 3.5",
)  # fmt: skip
odd = st.sampled_from(ODD).map(lambda line: [line])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(st.lists(st.one_of(vertices(), faces(), odd), max_size=8), st.sampled_from([60, 1 << 18]), st.integers(1, 80))
def test_even_runs_as_by_lines(tmp_path: Path, blocks: list[list[str]], piece: int, long: int) -> None:
    head = [f"{word} {i}.5 {i}.25 {i * i}.0" for word in ("v", "vt", "vn") for i in range(COUNT)]
    lines = [*head, *(line for block in blocks for line in block), "f 1 2 3"]
    (tmp_path / "m.obj").write_bytes("\n".join(lines).encode())
    with patch.object(obj_piece, "LONG_RUN", long):
        plain = read_plain_obj(tmp_path / "m.obj", piece)
    by_lines = read_by_lines(tmp_path / "m.obj")
    assert plain is not None
    for name in ("vertices", "faces", "normals", "uvs"):
        one, other = getattr(plain.mesh, name), getattr(by_lines.mesh, name)
        assert (one is None) == (other is None), name
        if one is not None:
            assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes()), name
    assert plain.materials == by_lines.materials
    assert {name: each.values.tolist() for name, each in plain.mesh.attributes.items()} == {
        name: each.values.tolist() for name, each in by_lines.mesh.attributes.items()
    }


def test_what_programs_write_is_even() -> None:
    lines = read_even(b"v -1.5 0.25 3.0\nv 1.0 -0.0 12345678.1234567\n", b"v", DOT)
    assert lines is not None
    values = lines.decimals()
    assert values is not None
    assert values.tolist() == [[-1.5, 0.25, 3.0], [1.0, 0.0, 12345678.1234567]]
    assert np.signbit(values).tolist() == [[True, False, False], [False, True, False]]
    lines = read_even(b"f 1//7 2//8 3//9\nf 10//1 200//2 3000//3\n", b"f", SLASH)
    assert lines is not None
    corners = lines.corners()
    assert corners is not None
    v, vt, vn = corners
    assert v is not None
    assert vn is not None
    assert vt is None
    assert (v.tolist(), vn.tolist()) == ([[0, 1, 2], [9, 199, 2999]], [[6, 7, 8], [0, 1, 2]])


@pytest.mark.parametrize(
    "text",
    [
        b"v 1.5 2.5 3.5\nv 1.5 2.5\n",
        b"v 1.5 2.5 3.5\nvn 1.5 2.5 3.5\n",
        b"v 1.5 2.5 3.5\n v 1.5 2.5 3.5\n",
        b"v 1.5 2.5 3.5\nv 1.5 2.-5 3.5\n",
        b"v 1.5 2.5 3.5\nv 1.5 . 3.5\n",
        b"v 1.5 2.5 3.5\nv 1.5 2.5 3,5\n",
        b"v 1.5 2.5 3.5\nv 1.5 123456789.5 3.5\n",
        b"v 1.5 2.5 3.5\nv 1.5 12345678.12345678 3.5\n",
        b"v 1 2 3\nv 4 5 6\n",
        b"v 1.5 2.5.5 3.5\nv 1.5 2.5.5 3.5\n",
    ],
)
def test_what_else_there_is_is_not(text: bytes) -> None:
    lines = read_even(text, b"v", DOT)
    assert lines is None or lines.decimals() is None


@pytest.mark.parametrize(
    "text",
    [
        b"f 1 2 3\nf 1 2 3 4\n",
        b"f 1 2 3\nf 1  3\n",
        b"f 1 2  3\nf 1 2 33\n",
        b"f 1 2 3\nf 1 -2 3\n",
        b"f 1 2 3\nf 1 0 3\n",
        b"f 1 2 3\nf 1 x 3\n",
        b"f 1/1 2/2 3/3\nf 1/1 2/ 3/3\n",
        b"f 1/1 2 3\nf 1/1 2 3\n",
        b"f 1/ 2/ 3/\nf 1/ 2/ 3/\n",
        b"f 1/1/1/1 2/1/1/1 3/1/1/1\n",
    ],
)
def test_what_else_faces_may_be_is_not(text: bytes) -> None:
    lines = read_even(text, b"f", SLASH)
    assert lines is None or lines.corners() is None
