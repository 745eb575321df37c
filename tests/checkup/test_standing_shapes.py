"""Of too many instances one of each shape is looked at, in the whole scene's size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wdpm.checkup import standing
from wdpm.checkup.run import check
from wdpm.checkup.soup import make_soup
from wdpm.checkup.standing import looked_at
from wdpm.scenes.builtin.forest import forest
from wdpm.scenes.meshes.primitives import cube
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Camera, Instance, Mesh, Scene, diffuse
from wdpm.scenes.model.transforms import look_at, translation

LIGHT = PointLight("light", (0.0, 8.0, 0.0), (1.0, 1.0, 1.0))


def row_of_cubes(count: int, *more: Mesh) -> Scene:
    """Cubes of one shape along x, of which the camera has the first behind it and sees the others."""
    data = cube()
    shape = Mesh("cube", data.vertices, data.faces, None, None, 0)
    cubes = [Instance(f"cube {i}", shape, translation((10.0 * i, 0.0, 0.0))) for i in range(count)]
    camera = Camera(look_at((5.0, 0.1, 0.1), (10.0, 0.0, 0.0), (0.0, 1.0, 0.0)), 40.0)
    return Scene("row", (*cubes, *more), (diffuse("grey", twosided=True),), (LIGHT,), camera)


def test_few_instances_are_all_looked_at() -> None:
    scene = row_of_cubes(5)
    assert looked_at(scene) == (scene, ())


def test_of_each_shape_the_first_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(standing, "MOST_STANDING", 20)
    data = cube()
    scene = row_of_cubes(5, Mesh("plain", data.vertices + np.array([0.0, 9.0, 0.0]), data.faces, None, None, 0))
    looked, left_out = looked_at(scene)
    assert [mesh.name for mesh in looked.meshes] == ["cube 0", "plain"]
    assert [mesh.name for mesh in left_out] == ["cube 1", "cube 2", "cube 3", "cube 4"]
    every, some = make_soup(scene), make_soup(looked, left_out)
    np.testing.assert_array_equal(some.space.center, every.space.center)
    assert (some.space.unit, len(some)) == (every.space.unit, 24)
    np.testing.assert_allclose(some.extent, every.extent, rtol=1e-6)
    np.testing.assert_allclose(
        np.ptp(some.reach(np.ones(len(some), bool)), axis=0), np.ptp(every.reach(np.ones(len(every), bool)), axis=0)
    )


def test_what_is_left_out_is_told_and_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    every = check(row_of_cubes(5))
    monkeypatch.setattr(standing, "MOST_STANDING", 20)
    found = check(row_of_cubes(5))
    (note,) = found.of("instances")
    assert note.detail == "4 others of 1 shape"
    assert {each.kind for each in found.findings} == {each.kind for each in every.findings} | {"instances"}
    assert found.triangles == every.triangles == 60
    away = Camera(look_at((100.0, 0.0, 0.0), (200.0, 0.0, 0.0), (0.0, 1.0, 0.0)), 40.0)
    assert check(replace(row_of_cubes(5), camera=away)).of("camera-sees-nothing")


def test_a_forest_is_looked_at_tree_by_tree() -> None:
    looked, left_out = looked_at(forest(10_000, (8, 5)))
    assert sum(len(mesh.faces) for mesh in looked.meshes) < 200_000
    assert len(left_out) == 19_998
