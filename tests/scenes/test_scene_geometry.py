"""Transforms, simple shapes, built-in scenes, the general checks and the flat scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wdpm
import wdpm.scenes
from wdpm.scenes import Mesh, Scene, SceneError, atrium, cornell_box, flatten, load
from wdpm.scenes.builtin.names import parse_count
from wdpm.scenes.meshes import primitives
from wdpm.scenes.meshes.mesh_data import MeshData, vertex_normals
from wdpm.scenes.model.checks import check_scene
from wdpm.scenes.model.lights import DirectionalLight, PointLight, SpotLight
from wdpm.scenes.model.scene import diffuse
from wdpm.scenes.model.transforms import apply_to_normals, look_at, rotation

finite = st.floats(-100, 100)
vectors = st.tuples(finite, finite, finite).filter(lambda v: np.linalg.norm(v) > 1e-3)


@given(vectors, st.floats(-720, 720))
def test_rotations_are_rigid_and_keep_their_axis(axis: tuple[float, float, float], angle: float) -> None:
    matrix = rotation(axis, angle)[:3, :3]
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    np.testing.assert_allclose(matrix @ axis, axis, atol=1e-9)


@given(vectors, vectors, vectors)
def test_look_at_is_rigid_and_looks_there(
    origin: tuple[float, float, float], direction: tuple[float, float, float], up: tuple[float, float, float]
) -> None:
    sine = np.linalg.norm(np.cross(direction, up)) / np.linalg.norm(direction) / np.linalg.norm(up)
    if sine < 1e-3:
        return
    matrix = look_at(origin, np.add(origin, direction), up)
    np.testing.assert_allclose(matrix[:3, :3].T @ matrix[:3, :3], np.eye(3), atol=1e-9)
    np.testing.assert_allclose(matrix[:3, 2], direction / np.linalg.norm(direction), atol=1e-6)
    assert np.dot(matrix[:3, 1], up) > 0
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0)


@given(vectors, st.tuples(st.floats(0.1, 9), st.floats(0.1, 9), st.floats(-9, -0.1)))
def test_mirrored_meshes_keep_faces_and_normals_in_agreement(
    axis: tuple[float, float, float], scale: tuple[float, float, float]
) -> None:
    matrix = rotation(axis, 50.0) @ np.diag([*scale, 1.0])
    mesh = primitives.cube().transformed(matrix)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    assert mesh.normals is not None
    assert (np.sum(np.cross(b - a, c - a) * mesh.normals[mesh.faces[:, 0]], axis=1) > 0).all()


SHAPES = {
    "rectangle": (primitives.rectangle, 4.0, 1e-12),
    "cube": (primitives.cube, 24.0, 1e-12),
    "sphere": (primitives.sphere, 4 * np.pi, 6e-4),
    "disk": (primitives.disk, np.pi, 6e-4),
    "cylinder": (primitives.cylinder, 2 * np.pi, 6e-4),
}


def _cross(mesh: MeshData) -> np.ndarray:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


@pytest.mark.parametrize("name", SHAPES)
def test_simple_shapes(name: str) -> None:
    make, area, tolerance = SHAPES[name]
    mesh = make()
    cross = _cross(mesh)
    assert np.linalg.norm(cross, axis=1).sum() / 2 == pytest.approx(area, rel=tolerance)
    assert (np.linalg.norm(cross, axis=1) > 0).all()
    assert mesh.normals is not None
    assert (np.einsum("fj,fkj->fk", cross, mesh.normals[mesh.faces]) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-12)


def _open_edges(mesh: MeshData) -> int:
    """Edges that are not between exactly two faces, once vertices at equal positions are one."""
    _, vertex = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = vertex.reshape(-1)[mesh.faces]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    return int(np.sum(count != 2))


def test_curved_shapes_are_watertight() -> None:
    assert _open_edges(primitives.sphere()) == 0
    assert _open_edges(primitives.cube()) == 0
    assert _open_edges(primitives.disk()) == primitives.AROUND
    assert _open_edges(primitives.cylinder()) == 2 * primitives.AROUND


def test_computed_normals_of_a_sphere_point_outwards() -> None:
    sphere = primitives.sphere()
    positions, vertex = np.unique(sphere.vertices, axis=0, return_inverse=True)
    normals = vertex_normals(positions, vertex.reshape(-1)[sphere.faces])
    assert np.sum(normals * positions, axis=1).min() > 0.999


def test_normals_of_a_scaled_plane_stay_perpendicular() -> None:
    matrix = np.diag([3.0, 1.0, 1.0, 1.0])
    normal = apply_to_normals(matrix, np.array([[1.0, 1.0, 0.0]]))[0]
    assert normal @ (matrix[:3, :3] @ [1.0, -1.0, 0.0]) == pytest.approx(0.0)


# ---- built-in scenes ----


@pytest.mark.parametrize("count", [10_000, 10_001, 12_345, 50_000, 300_000])
def test_atrium_has_as_many_triangles_as_asked(count: int) -> None:
    flat = flatten(atrium(count))
    assert flat.dropped == {}
    assert abs(len(flat.triangles) - count) <= 0.05 * count


@pytest.mark.parametrize("count", [9_999, 10_000_001])
def test_atrium_out_of_range(count: int) -> None:
    with pytest.raises(SceneError, match="expected 10000 to 10000000"):
        atrium(count)


def test_cornell_box_is_as_published() -> None:
    flat = flatten(cornell_box())
    assert len(flat.triangles) == 32
    np.testing.assert_allclose(flat.center, [278.0, 274.4, 279.6])
    assert flat.lights.names == ("lamp",)
    assert flat.extent * flat.unit == pytest.approx(800 + 279.6)


def test_cornell_box_faces_inwards_and_its_blocks_outwards() -> None:
    """Seen from the middle of the room the walls show their front, and so do the blocks seen from outside."""
    for mesh in cornell_box().meshes:
        cross = _cross(MeshData(mesh.vertices, mesh.faces))
        towards = mesh.vertices[mesh.faces[:, 0]]
        if "block" in mesh.name:
            middle = mesh.vertices.mean(axis=0)
            assert (np.sum(cross * (towards - middle), axis=1) > 0).all(), mesh.name
        else:
            assert (np.sum(cross * (np.array([278, 400, 279]) - towards), axis=1) > 0).all(), mesh.name


@pytest.mark.parametrize(
    ("text", "count"), [("50000", 50_000), ("50k", 50_000), ("2M", 2_000_000), ("1.5m", 1_500_000)]
)
def test_counts_with_suffix(text: str, count: int) -> None:
    assert parse_count(text) == count


def test_names_of_built_in_scenes() -> None:
    assert load("cornell-box", size=(64, 32)).camera.height == 32
    assert len(flatten(load("atrium:12k")).triangles) == pytest.approx(12_000, rel=0.05)
    for name in ("atrium:", "atrium:many", "cornell-box:3", "atrium:-5"):
        with pytest.raises(SceneError):
            load(name)


# ---- load and its checks ----


def test_files_that_are_no_scenes(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match='did you mean "cornell-box"'):
        load("cornel-box")
    with pytest.raises(SceneError, match="a built-in scene is asked for by a str of its name, not by a path"):
        load(Path("cornell-box"))
    with pytest.raises(SceneError, match="no such file"):
        load(tmp_path / "nothing.xml")
    (tmp_path / "a.txt").write_text("")
    for path in (tmp_path, tmp_path / "a.txt"):
        with pytest.raises(SceneError, match="expected a file with one of the extensions"):
            load(path)
    with pytest.raises(SceneError, match="only Mitsuba scenes have"):
        load("cornell-box", defines={"spp": "4"})


@pytest.mark.parametrize("size", [(0, 4), (4, -1)])
def test_sizes_below_one(size: tuple[int, int]) -> None:
    with pytest.raises(SceneError, match="both must be at least 1"):
        load("cornell-box", size=size)


def scene_of(vertices: np.ndarray, faces: list[list[int]], **changes: object) -> Scene:
    mesh = Mesh("m", np.asarray(vertices, float), np.array(faces).reshape(-1, 3), None, None, 0, (1.0, 1.0, 1.0))
    mesh = replace(mesh, **changes)  # type: ignore[arg-type]
    return Scene("s", (mesh,), (diffuse("grey"),), (), cornell_box().camera)


TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (scene_of(TRIANGLE, []), "the scene is empty"),
        (scene_of(TRIANGLE, [[0, 1, 2]], emission=None), "no light"),
        (scene_of(TRIANGLE, [[0, 1, 2]], emission=(0.0, 0.0, 0.0)), "no light"),
        (scene_of(TRIANGLE, [[0, 1, 2]], emission=(-1.0, 0.0, 0.0)), "negative or not finite"),
        (scene_of(TRIANGLE, [[0, 1, 3]]), 'mesh "m": face 0 names a vertex out of range'),
        (scene_of(TRIANGLE, [[0, 1, -1]]), 'mesh "m": face 0 names a vertex out of range'),
        (scene_of(TRIANGLE, [[0, 1, 2]], material=1), "there is no material 1"),
        (scene_of(TRIANGLE, [[0, 1, 2]], normals=TRIANGLE.tolist()), "normals are list; expected an array of floats"),
        (scene_of(TRIANGLE, [[0, 1, 2]], colors=TRIANGLE.astype(int)), "colors are int64 of shape .3, 3.; expected an"),
        (scene_of(TRIANGLE, [[0, 1, 2]], uvs=TRIANGLE), "uvs are float64 of shape .3, 3.; .* of floats, shape .N, 2"),
        (scene_of(np.where(TRIANGLE == 1, np.nan, 0), [[0, 1, 2]]), 'mesh "m": vertex 1 is .nan, 0, 0., 2 not finite'),
    ],
)
def test_checks(scene: Scene, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        check_scene(scene)


def test_lights_that_shine_nowhere() -> None:
    nowhere = DirectionalLight("sun", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), SpotLight("spot", np.zeros((4, 4)), (1.0,) * 3)
    for light in nowhere:
        with pytest.raises(SceneError, match=f'light "{light.name}": it shines nowhere'):
            check_scene(replace(cornell_box(), lights=(light,)))
    check_scene(replace(cornell_box(), lights=(PointLight("lamp", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),)))


@pytest.mark.parametrize("given", [lambda scene: scene, lambda scene: lambda: scene], ids=["a scene", "a function"])
def test_what_a_program_has_built_is_checked_before_it_is_rendered(given: Callable[[Scene], Any]) -> None:
    """A direction without length once ended the process by SIGSEGV."""
    box = replace(cornell_box((2, 2)), lights=(DirectionalLight("sun", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),))
    asked = (
        lambda source: wdpm.render(source, spp=1, photons=100),
        lambda source: wdpm.render(source, until_error=0.1),
        lambda source: wdpm.inspect(source),
        lambda source: wdpm.replay(source, 0, 0, 0),
    )
    for ask in asked:
        with pytest.raises(SceneError, match="it shines nowhere"):
            ask(given(box))


# ---- the flat scene ----


def test_degenerate_triangles_are_dropped_and_counted() -> None:
    # the middle of the bounding box is the origin, so that 1e-13 survives rounding
    vertices = np.array(
        [[-1.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [np.nan, 0, 0], [0, 0, 0], [1e-13, 0, 0], [0, 1e-13, 0]]
    )
    faces = [[0, 5, 1], [0, 1, 2], [0, 0, 2], [0, 4, 2], [5, 6, 7], [0, 3, 1]]
    flat = flatten(scene_of(vertices, faces))
    assert flat.dropped == {"zero area": 2, "not finite": 1, "no normal in single precision": 1}
    assert flat.triangles.ids.tolist() == [0, 1]
    np.testing.assert_array_equal(flat.triangles.positions[1], vertices[[0, 3, 1]].astype(np.float32))
    with pytest.raises(SceneError, match="no triangle of the scene can be rendered: 1 dropped"):
        flatten(scene_of(TRIANGLE, [[0, 0, 1]]))


def test_a_stray_vertex_is_said_to_make_all_else_small() -> None:
    far = 1e30 * TRIANGLE
    [(cause, count)] = flatten(scene_of(np.concatenate([TRIANGLE, far]), [[0, 1, 2], [3, 4, 5]])).dropped.items()
    assert (cause.startswith("too small beside the whole scene"), count) == (True, 1)


@given(st.tuples(*[st.integers(-(2**20), 2**20)] * 3))
def test_flat_scene_does_not_depend_on_where_the_scene_lies(offset: tuple[int, int, int]) -> None:
    """Whole numbers are added without rounding, so the arrays must be equal to the last bit."""
    scene = cornell_box()
    whole = [replace(mesh, vertices=np.round(mesh.vertices)) for mesh in scene.meshes]
    to_world = scene.camera.to_world.copy()
    to_world[:3, 3] += offset
    moved = replace(
        scene,
        meshes=tuple(replace(mesh, vertices=mesh.vertices + offset) for mesh in whole),
        camera=replace(scene.camera, to_world=to_world),
    )
    first, second = flatten(replace(scene, meshes=tuple(whole))), flatten(moved)
    np.testing.assert_array_equal(first.triangles.positions, second.triangles.positions)
    np.testing.assert_array_equal(first.camera.to_world, second.camera.to_world)
    np.testing.assert_array_equal(second.center - first.center, offset)
    assert first.extent == second.extent


def test_lights_are_numbered_in_order() -> None:
    scene = atrium(10_000)
    flat = flatten(scene)
    glowing = np.flatnonzero(flat.triangles.emitter >= 0)
    assert len(glowing) == 2
    np.testing.assert_allclose(
        flat.lights.emitter_radiance, [scene.meshes[[m.name for m in scene.meshes].index("skylight")].emission]
    )
    assert (np.diff(flat.triangles.ids) == 1).all()
    assert flat.triangles.ids.dtype == np.int32
    assert flat.triangles.positions.dtype == np.float32


def test_public_names() -> None:
    for name in wdpm.scenes.__all__:
        assert hasattr(wdpm.scenes, name)
