"""Media of scene files, which side of which shape they are on, and how finely curved shapes are cut."""

from __future__ import annotations

import math
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from mitsuba_xml import read_body, rgb
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes import primitives
from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.mitsuba.media import open_edges
from wdpm.scenes.model.scene import Mesh

LIGHT_AND_CAMERA = '<emitter type="constant"/><sensor type="perspective"/>'
FOG = '<medium type="homogeneous" id="fog"/>'
INSIDE = '<ref name="interior" id="fog"/>'

read = partial(read_body, after=LIGHT_AND_CAMERA)


def medium(inside: str) -> str:
    return f'<medium type="homogeneous" name="interior">{inside}</medium>'


def cube_of(inside: str) -> str:
    """A cube filled with a medium of these parameters."""
    return f'<shape type="cube">{medium(inside)}</shape>'


def test_defaults_are_mitsuba_s(tmp_path: Path) -> None:
    (fog,) = read(tmp_path, cube_of("")).media
    assert (fog.sigma_t, fog.albedo, fog.g) == ((1.0, 1.0, 1.0), (0.75, 0.75, 0.75), 0.0)


def test_parameters(tmp_path: Path) -> None:
    inside = rgb("sigma_t", "1 2 3") + '<float name="scale" value="10"/>' + rgb("albedo", "0.5 0.6 0.7")
    phase = '<phase type="hg"><float name="g" value="-0.4"/></phase>'
    (fog,) = read(tmp_path, cube_of(inside + phase)).media
    assert (fog.sigma_t, fog.albedo, fog.g) == ((10.0, 20.0, 30.0), (0.5, 0.6, 0.7), -0.4)


def test_forward_scattering_by_default_of_hg(tmp_path: Path) -> None:
    (fog,) = read(tmp_path, cube_of('<phase type="hg"/>')).media
    assert fog.g == 0.8


def test_older_coefficients(tmp_path: Path) -> None:
    (fog,) = read(tmp_path, cube_of(rgb("sigmaS", "1 0 3") + rgb("sigmaA", "1 0 1"))).media
    assert (fog.sigma_t, fog.albedo) == ((2.0, 0.0, 4.0), (0.5, 0.0, 0.75))


def test_constant_volumes(tmp_path: Path) -> None:
    inside = '<volume type="constvolume" name="sigma_t">' + rgb("value", "2 2 4") + "</volume>"
    (fog,) = read(tmp_path, cube_of(inside)).media
    assert fog.sigma_t == (2.0, 2.0, 4.0)


def test_sides_of_shapes(tmp_path: Path) -> None:
    both = f'<shape type="cube">{INSIDE}<medium type="homogeneous" name="exterior"/></shape>'
    plain = '<shape type="cube"/>'
    outside = '<shape type="sphere"><ref name="exterior" id="fog"/></shape>'
    scene = read(tmp_path, FOG + both + plain + outside)
    assert [(mesh.interior, mesh.exterior, mesh.bounds) for mesh in scene.meshes] == [
        (0, 1, True),
        (None, None, False),
        (None, 0, True),
    ]
    assert len(scene.media) == 2


ERRORS = (
    (
        '<medium type="cloudy" id="smoke"/>\n<shape type="cube"><ref name="interior" id="smoke"/></shape>',
        2,
        'unknown medium plugin "cloudy" (supported: homogeneous, heterogeneous)',
    ),
    (cube_of("\n" + rgb("albedo", "1.5 0 0")), 3, '"albedo" must lie between 0 and 1'),
    (cube_of("\n" + rgb("sigma_t", "-1 0 0")), 3, '"sigma_t" must not be negative'),
    (cube_of('\n<float name="scale" value="-1"/>'), 3, '"scale" must not be negative'),
    (cube_of('\n<string name="material" value="skin1"/>'), 3, '"material" presets are not supported'),
    (cube_of(rgb("sigma_s", "1 1 1") + "\n" + rgb("albedo", "1 1 1")), 3, '"albedo" cannot be given beside sigma_s'),
    (cube_of('\n<phase type="rayleigh"/>'), 3, '"rayleigh" is not supported yet; supported: isotropic, hg'),
    (cube_of('\n<phase type="hg"><float name="g" value="1"/></phase>'), 3, '"g" must lie between -1 and 1'),
    (cube_of('\n<volume type="gridvolume" name="sigma_t"/>'), 3, '"sigma_t" of a homogeneous medium is not supported'),
    (cube_of('\n<volume type="gridvolume" name="albedo"/>'), 3, 'the parameter "filename" is missing'),
    (cube_of('\n<volume type="volcache" name="albedo"/>'), 3, '"volcache" is not supported yet'),
    (cube_of("\n" + rgb("sigmat", "1 1 1")), 3, 'unknown parameter "sigmat"; did you mean "sigma_t"?'),
    (FOG + f'<shape type="cube">{INSIDE}{INSIDE}</shape>', 2, "takes one medium, got 2"),
    (FOG + '<shape type="cube"><ref id="fog"/></shape>', 2, 'shape "cube" takes no nested medium'),
)


@pytest.mark.parametrize(("body", "line", "message"), ERRORS)
def test_errors_name_file_and_line(tmp_path: Path, body: str, line: int, message: str) -> None:
    with pytest.raises(SceneError, match=re.escape(message)) as caught:
        read(tmp_path, body)
    assert caught.value.line == line
    assert caught.value.file == tmp_path / "scene.xml"


@pytest.mark.parametrize(
    ("shape", "holes"), [("cube", 0), ("sphere", 0), ("rectangle", 4), ("cylinder", 256), ("disk", 128)]
)
def test_a_medium_in_an_open_shape_is_told(tmp_path: Path, shape: str, holes: int) -> None:
    scene = read(tmp_path, f'{FOG}\n<shape type="{shape}" id="jar"><bsdf type="null"/>{INSIDE}</shape>')
    if holes == 0:
        assert scene.warnings == ()
    else:
        (warning,) = scene.warnings
        assert f"scene.xml:3: shape jar has a medium but is not closed ({holes} edges" in warning


def test_open_edges_counts_places_not_vertices() -> None:
    cube = primitives.cube()
    assert open_edges(cube) == 0
    assert open_edges(MeshData(cube.vertices, cube.faces[1:])) == 3
    twice = MeshData(cube.vertices, np.concatenate([cube.faces, cube.faces[:1]]))
    assert open_edges(twice) == 3  # a fin: its edges have one neighbour too few
    assert open_edges(MeshData(cube.vertices, cube.faces[:0])) == 0


def area(mesh: Mesh | MeshData) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2.0


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ('<shape type="sphere"><float name="radius" value="3"/>', 36.0 * math.pi),
        ('<shape type="disk">', math.pi),
        ('<shape type="cylinder"><float name="radius" value="3"/><point name="p1" z="2"/>', 12.0 * math.pi),
    ],
)
def test_round_lamps_have_the_area_of_the_round_shape(tmp_path: Path, shape: str, expected: float) -> None:
    (mesh,) = read(tmp_path, f'{shape}<emitter type="area"/></shape>').meshes
    assert area(mesh) == pytest.approx(expected, rel=1e-12)


def test_curved_shapes_are_as_fine_whatever_they_are_made_of(tmp_path: Path) -> None:
    shapes = ('<bsdf type="diffuse"/>', '<bsdf type="dielectric"/>', '<bsdf type="null"/>')
    body = "".join(f'<shape type="sphere">{bsdf}</shape>' for bsdf in shapes)
    meshes = read(tmp_path, body).meshes
    assert [len(mesh.faces) for mesh in meshes] == [16_128] * 3


def test_many_spheres_share_a_budget() -> None:
    def triangles(spheres: int) -> int:
        return spheres * len(primitives.sphere(primitives.segments_around(spheres)).faces)

    assert primitives.segments_around(8) == primitives.AROUND
    assert primitives.segments_around(100_000) == primitives.FEWEST_AROUND
    for spheres in (1, 9, 60, 200):
        assert triangles(spheres) <= primitives.SPHERE_BUDGET


@pytest.mark.parametrize("around", [32, 48, 256])
def test_spheres_are_closed_and_smooth(around: int) -> None:
    sphere = primitives.sphere(around, true_area=True)
    assert open_edges(sphere) == 0
    assert len(sphere.faces) == around * (around - 2)
    assert sphere.normals is not None
    # the normal in the middle of a triangle points away from the centre, so reflections do not show facets
    middle, normal = (unit(values[sphere.faces].mean(axis=1)) for values in (sphere.vertices, sphere.normals))
    np.testing.assert_allclose(middle, normal, atol=1e-12)


def unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
