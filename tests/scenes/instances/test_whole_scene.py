"""What is asked of all triangles has the bits of a scene of copies."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.kernels.launch import Launcher
from wdpm.kernels.rays.instance_areas import InstanceAreas
from wdpm.kernels.rays.instances import upload_instances
from wdpm.scenes.flat import whole
from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.flat.shapes import Instancing
from wdpm.scenes.flat.whole import area_by_material, positions_of, total_area
from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.meshes.primitives import cube, rectangle, sphere
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Camera, Instance, Mesh, Scene, Solid, diffuse
from wdpm.scenes.model.transforms import look_at, rotation, scaling, translation


def both() -> tuple[FlatScene, FlatScene]:
    """Meshes and instances by turns, held and copied."""
    random = np.random.default_rng(5)
    ball, box = (
        Mesh(name, data.vertices, data.faces, data.normals, data.uvs, number)
        for number, (name, data) in enumerate((("ball", sphere(16)), ("box", cube())))
    )
    solids: list[Solid] = []
    for number in range(20):
        turn = rotation(random.normal(size=3), float(random.uniform(0, 360)))
        matrix = translation(random.normal(size=3)) @ turn @ scaling(random.uniform(0.1, 0.5, 3))
        if number % 5 == 2:
            moved = sphere(10).transformed(matrix)
            solids.append(Mesh(f"own {number}", moved.vertices, moved.faces, moved.normals, moved.uvs, 2))
        else:
            solids.append(Instance(f"{number}", (ball, box)[number % 2], matrix))
    camera = Camera(look_at((0, 0, 9), (0, 0, 0), (0, 1, 0)), 40.0, 8, 8)
    lights = (PointLight("lamp", (0.0, 5.0, 5.0), (1.0, 1.0, 1.0)),)
    scene = Scene("both", tuple(solids), tuple(diffuse(name) for name in "abc"), lights, camera)
    return flatten(scene, Instancing.KEEP), flatten(scene, Instancing.EXPAND)


def areas_of(flat: FlatScene) -> InstanceAreas:
    instances = flat.triangles.instances
    return InstanceAreas(instances, upload_instances(instances, "cpu"), Launcher(threads=2))


@pytest.mark.parametrize("block", [128, 1000, 1 << 20])
def test_areas_are_added_as_numpy_adds_those_of_copies(monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    held, copied = both()
    assert len(held.triangles.instances) == 16
    monkeypatch.setattr(whole, "BLOCK", block)
    areas, none = areas_of(held), areas_of(copied)
    assert total_area(held.triangles, areas.of) == total_area(copied.triangles, none.of)
    by_material = area_by_material(held.triangles, 3, areas.of)
    np.testing.assert_allclose(by_material, area_by_material(copied.triangles, 3, none.of), rtol=1e-12)


@pytest.mark.parametrize("most", [7, 1000, 1 << 20])
def test_areas_of_instances_have_the_bits_of_those_of_copies(most: int) -> None:
    held, copied = both()
    areas = areas_of(held)
    found, before = np.zeros(len(copied.triangles)), np.zeros(len(copied.triangles))
    for begin, end in areas.blocks(most):
        assert 0 < end - begin <= most
        assert not found[begin:end].any()
        found[begin:end] = areas.of(begin, end)
        before[begin:end] = areas.before(begin, end)
    expected = triangle_areas(copied.triangles.positions)
    expected[held.triangles.ids] = 0.0
    np.testing.assert_array_equal(found, expected)
    expected = copied.triangles.area_before.copy()
    np.testing.assert_array_equal(held.triangles.area_before, expected[held.triangles.ids])
    expected[held.triangles.ids] = 0.0
    np.testing.assert_array_equal(before, expected)
    assert list(areas_of(copied).blocks()) == []


def test_triangles_of_some_materials_come_in_their_order() -> None:
    held, copied = both()
    for chosen in ([True, False, True], [False, True, False], [False, False, True], [False, False, False]):
        some = np.array(chosen)
        np.testing.assert_array_equal(positions_of(held.triangles, some), positions_of(copied.triangles, some))


def test_too_many_triangles_stand_as_boxes(monkeypatch: pytest.MonkeyPatch) -> None:
    held, copied = both()
    monkeypatch.setattr(whole, "MOST_POSITIONS", 10)
    boxes = positions_of(held.triangles, np.array([True, False, False]))
    exact = positions_of(copied.triangles, np.array([True, False, False]))
    assert len(boxes) < len(exact)
    assert (boxes.min(axis=(0, 1)) <= exact.min(axis=(0, 1))).all()
    assert (boxes.max(axis=(0, 1)) >= exact.max(axis=(0, 1))).all()


@pytest.mark.parametrize(
    ("unit", "factors", "off"),
    [
        (1.0, (0.5, 0.5, 0.5), 1e-5),
        (1e12, (0.5, 0.5, 0.5), 1e-5),
        (1e-12, (2.0, 2.0, 2.0), 1e-5),
        (1.0, (2, 1, 0.5), 0.1),
    ],
)
def test_an_instance_has_about_the_area_that_it_has_where_it_stands(
    unit: float, factors: tuple[float, float, float], off: float
) -> None:
    """Whatever unit its shape is in; the mean growth is exact where all areas grow alike."""
    flat = instance_of(sphere(16), unit, factors)
    there = triangle_areas(flat.triangles.instances.positions(0)).sum()
    assert flat.triangles.instances.area[0] == pytest.approx(there, rel=off)
    assert flat.triangles.instances.shapes.share_before.max() < 1.0


def test_what_stretches_a_sheet_across_itself_adds_no_area() -> None:
    thick, thin = (instance_of(rectangle(), 1.0, (2.0, 1.0, across)) for across in (1e9, 1.0))
    assert thick.triangles.instances.area[0] == pytest.approx(thin.triangles.instances.area[0])


def instance_of(data: MeshData, unit: float, factors: tuple[float, float, float]) -> FlatScene:
    """A scene of two instances of a mesh whose coordinates are in some unit."""
    shape = Mesh("shape", data.vertices / unit, data.faces, None, None, 0)
    places = (translation((3.0 * side, 0, 0)) @ scaling(np.array(factors) * unit) for side in (-1, 1))
    solids = tuple(Instance(str(number), shape, place) for number, place in enumerate(places))
    camera = Camera(look_at((0, 0, 9), (0, 0, 0), (0, 1, 0)), 40.0, 8, 8)
    lights = (PointLight("lamp", (0.0, 5.0, 5.0), (1.0, 1.0, 1.0)),)
    return flatten(Scene("two", solids, (diffuse("grey"),), lights, camera), Instancing.KEEP)
