"""Instances are read as Mitsuba and glTF mean them, and are the very triangles that copies would be."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from wdpm.scenes.builtin.forest import TREE_TRIANGLES
from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat import flatten as flatten_module
from wdpm.scenes.flat.arrays import ARRAYS
from wdpm.scenes.flat.flatten import FlatScene, Origins, flatten
from wdpm.scenes.flat.instances import Instances, placed_normals
from wdpm.scenes.flat.reach import instance_boxes
from wdpm.scenes.flat.shapes import Instancing
from wdpm.scenes.load import load
from wdpm.scenes.model.scene import Instance, Scene

HEAD = """<scene version="3.0.0">
<sensor type="perspective"><transform name="to_world"><lookat origin="0,1,7" target="0,0.5,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film></sensor>
<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate y="3"/></transform>
<emitter type="area"><rgb name="radiance" value="5"/></emitter></shape>
<bsdf type="diffuse" id="red"><rgb name="reflectance" value="0.6 0.2 0.2"/></bsdf>
<bsdf type="diffuse" id="green"><rgb name="reflectance" value="0.2 0.6 0.2"/></bsdf>
"""
MEMBERS = (
    '<shape type="sphere"><float name="radius" value="0.4"/><ref id="red"/>{}</shape>',
    '<shape type="cube"><transform name="to_world"><scale value="0.2"/><translate x="0.3"/>{}</transform>'
    '<ref id="green"/></shape>',
)
PLACES = (
    '<rotate x="1" y="2" z="3" angle="33"/><scale x="0.7" y="1.3" z="0.9"/><translate x="-1.2" y="0.1" z="0.3"/>',
    '<scale x="-1" y="1" z="1"/><rotate y="1" angle="20"/><translate x="1.1"/>',
    '<translate y="1.7"/>',
)


def group(*members: str) -> str:
    return f'<shape type="shapegroup" id="pair">{"".join(members)}</shape>'


def instance(place: str, name: str = "pair") -> str:
    return f'<shape type="instance"><ref id="{name}"/><transform name="to_world">{place}</transform></shape>'


def read(folder: Path, *parts: str) -> Scene:
    file = folder / "scene.xml"
    file.write_text(HEAD + "\n".join(parts) + "\n</scene>")
    return load(file)


def with_instances(folder: Path) -> Scene:
    sphere = MEMBERS[0].format("")
    return read(folder, group(sphere, MEMBERS[1].format("")), *(instance(place) for place in PLACES))


def expanded(instances: Instances, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rows, mirrored = instances.rows(number), bool(instances.mirrored[number])
    turn = slice(None, None, -1 if mirrored else 1)
    normals = placed_normals(instances.normal_matrix[number], mirrored, instances.shapes.normals[rows])
    return instances.positions(number), normals, instances.shapes.uvs[rows][:, turn]


def test_held_or_copied_the_triangles_are_the_same(tmp_path: Path) -> None:
    scene = with_instances(tmp_path)
    held, copied = flatten(scene, Instancing.KEEP), flatten(scene, Instancing.EXPAND)
    assert len(held.triangles.instances) == 6
    assert held.triangles.total == copied.triangles.total == len(copied.triangles)
    assert held.triangles.held < copied.triangles.held
    assert (held.extent, held.dropped) == (copied.extent, copied.dropped)
    assert held.lights.scene_radius == copied.lights.scene_radius
    instances, whole = held.triangles.instances, copied.triangles
    for number in range(len(instances)):
        rows = instances.ids(number)
        positions, normals, uvs = expanded(instances, number)
        np.testing.assert_array_equal(whole.ids[rows], rows)
        np.testing.assert_array_equal(whole.positions[rows], positions)
        np.testing.assert_array_equal(whole.normals[rows], normals)
        np.testing.assert_array_equal(whole.uvs[rows], uvs)
        np.testing.assert_array_equal(whole.material[rows], instances.shapes.material[instances.rows(number)])
    for name in set(ARRAYS) - {"colors"}:
        np.testing.assert_array_equal(getattr(whole, name)[held.triangles.ids], getattr(held.triangles, name))


def test_instances_are_the_copies_that_one_would_write(tmp_path: Path) -> None:
    copies = []
    for place in PLACES[::2]:  # a mirrored copy of a sphere is turned inside out by Mitsuba, a mirrored instance is not
        copies += [
            MEMBERS[0].format(f'<transform name="to_world">{place}</transform>'),
            MEMBERS[1].format(place),
        ]
    by_hand = flatten(read(tmp_path, *copies))
    sphere = MEMBERS[0].format("")
    scene = read(tmp_path, group(sphere, MEMBERS[1].format("")), *(instance(place) for place in PLACES[::2]))
    by_instances = flatten(scene, Instancing.EXPAND)
    assert by_hand.extent == by_instances.extent
    for name in ARRAYS:
        a, b = getattr(by_hand.triangles, name), getattr(by_instances.triangles, name)
        assert a.shape == b.shape, name
        if name == "normals":  # a mean of normals, which is computed in world space, is turned here
            assert np.abs(a - b).max() < 1e-6
        elif name not in ("material", "area_before"):  # the curve goes through a shape as it is in its own space
            np.testing.assert_array_equal(a, b, err_msg=name)


def test_shapes_are_held_once_where_that_saves_much(tmp_path: Path) -> None:
    assert len(flatten(with_instances(tmp_path), Instancing.AUTO).triangles.instances) == 0
    assert len(flatten(with_instances(tmp_path), Instancing.KEEP).triangles.instances.shapes) == 2


def test_what_glows_is_copied(tmp_path: Path) -> None:
    lamp = MEMBERS[0].format('<emitter type="area"><rgb name="radiance" value="2"/></emitter>')
    scene = read(tmp_path, group(lamp, MEMBERS[1].format("")), *(instance(place) for place in PLACES))
    flat = flatten(scene, Instancing.KEEP)
    assert len(flat.triangles.instances) == 3
    assert len(flat.lights.emitter_radiance) == 4
    assert (flat.triangles.emitter[flat.lights.prim.searchsorted(flat.lights.prim)] >= -1).all()


def test_a_second_instance_in_the_same_place_is_dropped(tmp_path: Path) -> None:
    once = flatten(read(tmp_path, group(MEMBERS[1].format("")), instance(PLACES[0])), Instancing.KEEP)
    twice = read(tmp_path, group(MEMBERS[1].format("")), instance(PLACES[0]), instance(PLACES[0]))
    for instancing in (Instancing.KEEP, Instancing.EXPAND):
        flat = flatten(twice, instancing)
        assert flat.triangles.total == once.triangles.total
        assert sum(flat.dropped.values()) == 12


def test_instances_of_instances(tmp_path: Path) -> None:
    outer = f'<shape type="shapegroup" id="outer">{instance(PLACES[2])}{instance(PLACES[1])}</shape>'
    scene = read(tmp_path, group(MEMBERS[1].format("")), outer, instance(PLACES[0], "outer"), instance("", "outer"))
    instances = [mesh for mesh in scene.meshes if isinstance(mesh, Instance)]
    assert len(instances) == 4
    assert len({id(mesh.shape) for mesh in instances}) == 1
    np.testing.assert_allclose(instances[2].to_world[:3, 3], (0.0, 1.7, 0.0), atol=1e-12)


def test_where_a_triangle_of_an_instance_is_from(tmp_path: Path) -> None:
    scene = with_instances(tmp_path)
    origins = Origins(scene)
    flat = flatten(scene, Instancing.KEEP)
    assert len(origins) == flat.triangles.total
    for number in range(6):
        first = int(flat.triangles.instances.base[number])
        assert origins.of(first) == (number + 1, origins.of(first)[1])
        assert origins.of(first + 1)[0] == number + 1


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        (['<shape type="instance"><ref id="red"/></shape>'], "stands for nothing"),
        (['<shape type="cube" id="c"/>', instance("", "c")], 'expected a <ref> to a shape of type "shapegroup"'),
        ([group(instance("")), instance("")], 'leads back to <shape> "pair": it would hold an instance of itself'),
        ([group(instance("")), MEMBERS[1].format("")], 'leads back to <shape> "pair"'),  # though nobody asks for it
        ([group('<ref id="pair"/>')], 'leads back to <shape> "pair"'),
        ([group(group(MEMBERS[1].format("")).replace("pair", "inner")), instance("")], "holds another group"),
        ([group(MEMBERS[1].format("")), instance('<scale x="1" y="1" z="0"/>')], "flattens space"),
        ([group('<emitter type="area"/>'), instance("")], "takes no nested emitter"),
        (
            [group(MEMBERS[1].format("")), instance("").replace("</shape>", '<emitter type="area"/></shape>')],
            "takes no nested emitter",
        ),
    ],
)
def test_what_cannot_be_is_one_line_with_its_place(tmp_path: Path, parts: list[str], words: str) -> None:
    with pytest.raises(SceneError) as raised:
        read(tmp_path, *parts)
    message = str(raised.value)
    assert words in message
    assert "scene.xml:" in message
    assert "\n" not in message


def test_groups_that_stand_nowhere_are_an_empty_scene(tmp_path: Path) -> None:
    file = tmp_path / "scene.xml"
    file.write_text('<scene version="3.0.0">\n<shape type="shapegroup" id="g"><shape type="cube"/></shape></scene>')
    with pytest.raises(SceneError, match=r'xml:2: .*empty: no <shape type="instance"> puts what this group holds'):
        load(file)


def test_more_triangles_than_can_be_numbered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flatten_module, "MOST_TRIANGLES", 1000)
    with pytest.raises(SceneError, match="triangles, those of instances counted where they stand: at most 1,000"):
        flatten(with_instances(tmp_path))


def test_all_of_a_flat_scene_but_its_triangles_is_the_same(tmp_path: Path) -> None:
    scene = with_instances(tmp_path)
    held, copied = flatten(scene, Instancing.KEEP), flatten(scene, Instancing.EXPAND)
    for part in fields(FlatScene):
        if part.name in ("center", "unit", "extent", "material_names"):
            np.testing.assert_array_equal(getattr(held, part.name), getattr(copied, part.name))


# The forest that is built in


def test_trees_are_held_once() -> None:
    triangles = flatten(load("forest:9", size=(8, 5))).triangles
    assert triangles.total == 9 * TREE_TRIANGLES + 2
    assert triangles.held == TREE_TRIANGLES + 2
    assert len(triangles.instances) == 18
    assert triangles.nbytes < 24e6


def test_boxes_of_trees_hold_their_triangles() -> None:
    instances = flatten(load("forest:5", size=(8, 5))).triangles.instances
    low, high = instance_boxes(instances)
    for number in range(len(instances)):
        positions = instances.positions(number)
        assert (positions.min(axis=(0, 1)) >= low[number]).all()
        assert (positions.max(axis=(0, 1)) <= high[number]).all()
        assert (high[number] - low[number] < 3 * (positions.max(axis=(0, 1)) - positions.min(axis=(0, 1)))).all()


@pytest.mark.parametrize("name", ["forest:0", "forest:21k", "forest:", "forest:many"])
def test_forests_that_cannot_be(name: str) -> None:
    with pytest.raises(SceneError) as raised:
        load(name)
    assert "trees" in str(raised.value)
