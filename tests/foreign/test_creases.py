"""Mitsuba 0.6's `maxSmoothAngle`: vertices are split where faces lean from one another by more."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wdpm.scenes import SceneError
from wdpm.scenes.meshes.creases import creased
from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.mitsuba.read import read_mitsuba


def roof(degrees: float) -> MeshData:
    """Two rectangles of two triangles that share an edge along y, with an angle between their normals."""
    turn = np.radians(degrees)
    far = [np.cos(turn), np.sin(turn)]
    vertices = [[-1, 0, 0], [0, 0, 0], [0, 1, 0], [-1, 1, 0], [far[0], 0, far[1]], [far[0], 1, far[1]]]
    faces = [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]]
    return MeshData(np.array(vertices, dtype=np.float64), np.array(faces), uvs=np.array(vertices)[:, :2] * 1.0)


@pytest.mark.parametrize(("angle", "vertices"), [(40.0, 6), (20.0, 8)])
def test_an_edge_is_a_crease_where_the_angle_is_larger(angle: float, vertices: int) -> None:
    mesh = creased(roof(30.0), angle).smooth()
    assert len(mesh.vertices) == vertices
    assert np.array_equal(mesh.vertices[mesh.faces], roof(30.0).vertices[roof(30.0).faces])
    assert mesh.uvs is not None
    assert np.array_equal(mesh.uvs, mesh.vertices[:, :2])
    assert mesh.normals is not None
    flat = mesh.normals[mesh.faces[0]]
    assert np.allclose(flat, [0.0, 0.0, 1.0]) == (vertices == 8)


def test_vertices_that_the_file_has_twice_are_smoothed_over() -> None:
    mesh = roof(30.0)
    twice = MeshData(mesh.vertices[mesh.faces.reshape(-1)], np.arange(12).reshape(4, 3))
    assert len(creased(twice, 40.0).vertices) == 6
    assert len(creased(twice, 20.0).vertices) == 8


def test_each_face_is_put_with_the_first_that_it_is_near_to() -> None:
    """A fan of three faces, 25 degrees apart: with 30, the third is near the second, but that is with the first."""
    angles = np.radians([0.0, 25.0, 50.0])
    spokes = np.array([[np.cos(a), 0.0, np.sin(a)] for a in angles])
    corners = [[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], -spoke] for spoke in spokes]
    mesh = MeshData(np.array(corners).reshape(-1, 3), np.arange(9).reshape(3, 3))
    faces = creased(mesh, 30.0).faces
    assert faces[0, 0] == faces[1, 0] != faces[2, 0]


def test_the_parameter_is_read_and_checked(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\n")
    file = tmp_path / "s.xml"

    def corners(extra: str) -> int:
        shape = f'<shape type="obj"><string name="filename" value="m.obj"/>\n{extra}</shape>'
        file.write_text(f'<scene version="0.6.0">{shape}</scene>')
        return len(read_mitsuba(file, {}).meshes[0].vertices)  # type: ignore[union-attr]

    assert corners("") == 4
    assert corners('<float name="maxSmoothAngle" value="30"/>') == 6
    assert corners('<float name="maxSmoothAngle" value="120"/>') == 4
    with pytest.raises(SceneError, match=r"s\.xml:2: .*must lie between 0 and 180 degrees"):
        corners('<float name="maxSmoothAngle" value="-1"/>')
