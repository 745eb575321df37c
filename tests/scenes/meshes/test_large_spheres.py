"""A ground that is a sphere of radius 1000, as many small scenes have it, is round under what stands on it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wdpm
from wdpm.scenes.meshes.large_spheres import RoundShape, with_finer_spheres
from wdpm.scenes.meshes.primitives import AROUND, sphere
from wdpm.scenes.model import bounds
from wdpm.scenes.model.scene import Mesh, Scene
from wdpm.scenes.model.transforms import scaling

BALL = '<shape type="sphere"><point name="center" value="{}"/><float name="radius" value="0.2"/></shape>'
GROUND = '<shape type="sphere"><point name="center" value="{}"/><float name="radius" value="1000"/>{}</shape>'
EVEN = 2 * AROUND * (AROUND // 2 - 1)
"""Triangles of a sphere among few."""

UPS = [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.6, -0.64, 0.48), (0.0001, 0.0, 1.0)]


def scene_of(shapes: str, path: Path) -> Scene:
    file = path / "scene.xml"
    file.write_text(f'<scene version="3.0.0"><emitter type="constant"/>{shapes}</scene>')
    return wdpm.load(file)


def point(values: np.ndarray) -> str:
    return ", ".join(f"{value:.17g}" for value in values)


@pytest.mark.parametrize("up", UPS, ids=str)
def test_a_large_sphere_is_round_where_all_else_is(up: tuple[float, float, float], tmp_path: Path) -> None:
    normal = np.array(up) / np.linalg.norm(up)
    along = np.cross(normal, [0.3, 0.5, 0.8])
    balls = "".join(BALL.format(point(normal * 0.2 + along * at)) for at in (-10.0, 3.0, 10.0))
    ground = scene_of(GROUND.format(point(-1000.0 * normal), "") + balls, tmp_path).meshes[0]
    corners = ground.vertices[ground.faces]
    middles = corners.mean(axis=1)
    below = 1000.0 - np.linalg.norm(middles + 1000.0 * normal, axis=1)
    assert below[np.linalg.norm(middles, axis=1) < 15].max() < 1e-3, "a ball's radius is 0.2"
    assert below.max() < 2.0, "and elsewhere as round as any sphere"
    assert len(ground.faces) < 120_000
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.sum(facing * (middles + 1000.0 * normal), axis=1) > 0).all()
    area = np.linalg.norm(facing, axis=1).sum() / 2.0
    assert area == pytest.approx(4e6 * np.pi, rel=2e-3)


def test_its_texture_coordinates_and_normals_are_those_of_the_place(tmp_path: Path) -> None:
    ground = scene_of(GROUND.format("0, -1000, 0", "") + BALL.format("0, 0.2, 0"), tmp_path).meshes[0]
    assert ground.normals is not None
    assert ground.uvs is not None
    away = (ground.vertices - [0.0, -1000.0, 0.0]) / 1000.0
    assert np.allclose(ground.normals, away, atol=1e-12)
    inside = np.isin(np.arange(len(away)), ground.faces) & (np.abs(away[:, 2]) < 1.0)
    u = np.arctan2(away[:, 1], away[:, 0]) / (2.0 * np.pi) % 1.0
    off = (ground.uvs[:, 0] - u + 0.5) % 1.0 - 0.5
    assert np.allclose(off[inside], 0.0, atol=1e-9)
    assert np.allclose(ground.uvs[inside, 1], np.arccos(away[inside, 2]) / np.pi, atol=1e-9)


def test_several_large_spheres_are_the_walls_of_a_room(tmp_path: Path) -> None:
    walls = "".join(GROUND.format(at, "") for at in ("0, -1000, 0", "-1002, 0, 0", "0, 1004, 0"))
    meshes = scene_of(walls + BALL.format("0, 0.2, 0") + BALL.format("1, 2, 0.5"), tmp_path).meshes
    assert [len(mesh.faces) > EVEN for mesh in meshes] == [True] * 3 + [False] * 2


@pytest.mark.parametrize(
    "shapes",
    [
        GROUND.format("0, 0, 0", ""),
        GROUND.format("0, 0, 0", '<boolean name="flip_normals" value="true"/>') + BALL.format("0, 0, 0"),
        BALL.format("0, 0, 0") + BALL.format("0.3, 0, 0"),
        GROUND.format("0, -1000, 0", "") + BALL.format("800, 0, 0") + BALL.format("-800, 0, 0"),
    ],
    ids=["alone", "around all else", "not large", "beside what is as large"],
)
def test_all_other_spheres_are_even(shapes: str, tmp_path: Path) -> None:
    assert {len(mesh.faces) for mesh in scene_of(shapes, tmp_path).meshes} == {EVEN}


def test_a_shape_that_stands_in_many_places_is_looked_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    group = '<shape type="shapegroup" id="one"><shape type="cube"/></shape>'
    place = '<shape type="instance"><ref id="one"/><transform name="to_world"><translate {}="{}"/></transform></shape>'
    looked_at, used = [], bounds._used_vertices
    monkeypatch.setattr(bounds, "_used_vertices", lambda mesh: (looked_at.append(mesh.name), used(mesh))[1])
    ground = GROUND.format("0, -1001, 0", "")
    camera = '<sensor type="perspective"/>'
    few, many = (
        scene_of(camera + ground + group + "".join(place.format("x", at) for at in range(count)), tmp_path)
        for count in (2, 40)
    )
    assert [len(scene.meshes) for scene in (few, many)] == [3, 41]
    assert all(len(scene.meshes[0].faces) > EVEN for scene in (few, many))
    assert len(looked_at) == 2 * 2, "the ground and the cube, once a scene"


def test_what_has_no_triangles_is_beside_nothing() -> None:
    unit = sphere()
    ground = Mesh("ground", 1000.0 * unit.vertices, unit.faces, None, None, 0)
    ball = replace(ground, name="ball", vertices=0.2 * unit.vertices + [0.0, 0.0, 1000.2])
    none = replace(ball, name="none", faces=np.zeros((0, 3), np.int64))
    round_shape = RoundShape(ground.vertices, scaling([1000.0] * 3), lambda mesh: mesh)
    for meshes, finer in ([(ground, none, ball), True], [(ground, none), False], [(none,), False]):
        found = with_finer_spheres(meshes, [round_shape], AROUND)
        assert [each.name for each in found] == [each.name for each in meshes]
        assert (len(found[0].faces) > EVEN) == finer


def test_a_turned_and_mirrored_one_faces_as_it_did(tmp_path: Path) -> None:
    placed = (
        '<shape type="sphere"><transform name="to_world"><scale x="-500" y="900" z="700"/>'
        '<rotate z="1" angle="30"/><translate y="-600"/></transform>{}</shape>'
    )
    for flip in ("", '<boolean name="flip_normals" value="true"/>'):
        fine, even = (
            scene_of(placed.format(flip) + rest, tmp_path).meshes[0] for rest in (BALL.format("0, 120.6, 0"), "")
        )
        assert len(fine.faces) != len(even.faces)
        outwards = [
            np.sum((mesh.vertices - mesh.vertices.mean(axis=0)) * mesh.normals, axis=1) > 0 for mesh in (fine, even)
        ]
        assert outwards[0].all() == outwards[1].all()
        assert outwards[0].any() == outwards[1].any()
