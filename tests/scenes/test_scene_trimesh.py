"""What trimesh has in memory is the scene that the same mesh is from a file, to the bit."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image as PillowImage

import wdpm
from wdpm.cluster.render_settings import Indirect
from wdpm.scenes import Diffuse, DirectionalLight, PointLight, Scene, SceneError, SpotLight, TwoSided, flatten, load

SMALL: dict[str, Any] = {"photons": 500, "spp": 1, "indirect": Indirect.MAP}
SIZE = (12, 8)


def box(**options: Any) -> Any:
    """A cube with coordinates that single precision holds, as files have them."""
    mesh = trimesh.creation.box(extents=(1.0, 1.5, 0.5))
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False, **options)


def colors(count: int) -> Any:
    return np.random.default_rng(3).integers(0, 256, (count, 4), np.uint8)


def ply(mesh: Any, folder: Path) -> Path:
    mesh.export(folder / "mesh.ply")
    return folder / "mesh.ply"


def assert_same(one: Scene, other: Scene) -> None:
    """All that kernels would be handed is the same; names may differ."""
    first, second = flatten(one), flatten(other)
    for name, values in vars(first.triangles).items():
        np.testing.assert_array_equal(values, getattr(second.triangles, name), err_msg=name)
    assert len(first.textures) == len(second.textures)
    for left, right in zip(first.textures, second.textures, strict=True):
        assert type(left) is type(right)
        np.testing.assert_array_equal(getattr(left, "pixels", 0), getattr(right, "pixels", 0))
    np.testing.assert_array_equal(one.camera.to_world, other.camera.to_world)
    assert [type(each.bsdf) for each in one.materials] == [type(each.bsdf) for each in other.materials]


def test_a_render_of_a_mesh_is_that_of_its_file(tmp_path: Path) -> None:
    mesh = box(vertex_colors=colors(8))
    direct = wdpm.render(lambda: load(mesh, size=SIZE), **SMALL)
    assert direct.digest() == wdpm.render(load(ply(mesh, tmp_path), size=SIZE), **SMALL).digest()
    assert np.ptp(direct.layers["albedo"], axis=2).max() > 0.1  # it has its colours


def test_render_takes_meshes_as_they_are() -> None:
    image = wdpm.render(scene_with_camera(), **SMALL)
    assert image.shape == (SIZE[1], SIZE[0])


def scene_with_camera() -> Any:
    scene = trimesh.Scene([box()])
    scene.set_camera(resolution=SIZE, fov=(50.0, 40.0))
    return scene


def test_a_plain_mesh_is_grey_and_flat(tmp_path: Path) -> None:
    scene = load(box())
    assert_same(scene, load(ply(box(), tmp_path)))
    assert scene.meshes[0].normals is None


def test_normals_are_used_where_its_exporters_write_them(tmp_path: Path) -> None:
    given = box(vertex_normals=np.tile([[0.0, 0.0, 1.0]], (8, 1)))
    scene = load(given)
    assert scene.meshes[0].normals is not None
    assert_same(scene, load(ply(given, tmp_path)))


def test_colors_of_faces_are_those_of_their_corners(tmp_path: Path) -> None:
    by_face = box(face_colors=colors(12))
    corners = by_face.faces.reshape(-1)
    apart = trimesh.Trimesh(
        by_face.vertices[corners],
        np.arange(36).reshape(12, 3),
        vertex_colors=np.repeat(colors(12), 3, axis=0),
        process=False,
    )
    assert_same(load(by_face), load(ply(apart, tmp_path)))


def test_an_image_is_the_texture_of_an_obj_file(tmp_path: Path) -> None:
    pixels = np.random.default_rng(5).integers(0, 256, (4, 3, 3), np.uint8)
    image = PillowImage.fromarray(pixels)
    image.save(tmp_path / "wood.png")
    uv = np.random.default_rng(7).integers(0, 9, (8, 2)) / 8.0
    mesh = box(visual=trimesh.visual.TextureVisuals(uv=uv, image=image))
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"vt {u!r} {v!r}" for u, v in uv.tolist()]
    lines += ["usemtl wood"] + [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in (mesh.faces + 1).tolist()]
    (tmp_path / "m.obj").write_text("mtllib m.mtl\n" + "\n".join(lines) + "\n")
    (tmp_path / "m.mtl").write_text("newmtl wood\nmap_Kd wood.png\n")
    assert_same(load(mesh), load(tmp_path / "m.obj"))


def test_factors_are_linear_and_tint_images() -> None:
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[0.25, 0.5, 1.0, 1.0], baseColorTexture=PillowImage.new("RGB", (1, 1), (255, 255, 255))
    )
    uv = np.zeros((8, 2))
    scene = load(box(visual=trimesh.visual.TextureVisuals(uv=uv, material=material)))
    np.testing.assert_allclose(flatten(scene).textures[0].pixels[0, 0], [0.25, 0.5, 1.0], atol=1 / 255)
    plain = load(
        box(
            visual=trimesh.visual.TextureVisuals(
                material=trimesh.visual.material.SimpleMaterial(diffuse=[51, 102, 255, 255])
            )
        )
    )
    bsdf = plain.materials[0].bsdf
    assert isinstance(bsdf, TwoSided)
    assert isinstance(bsdf.front, Diffuse)
    assert bsdf.front.reflectance == pytest.approx((0.2, 0.4, 1.0))


def test_what_glows_is_a_light() -> None:
    material = trimesh.visual.material.PBRMaterial(emissiveFactor=[0.5, 0.25, 1.0], metallicFactor=0.5)
    scene = load(box(visual=trimesh.visual.TextureVisuals(material=material)))
    assert scene.meshes[0].emission == pytest.approx((0.5, 0.25, 1.0))
    assert any("export a .glb to keep metal and roughness" in warning for warning in scene.warnings)


def test_a_scene_has_its_transforms() -> None:
    matrix = trimesh.transformations.rotation_matrix(math.pi / 2, (0, 0, 1), (1, 0, 0)).round(6)
    graph = trimesh.Scene()
    graph.add_geometry(box(), node_name="stands")
    graph.add_geometry(box(), node_name="lies", transform=matrix)
    scene = load(graph)
    assert [mesh.name for mesh in scene.meshes[:2]] == ["stands", "lies"]
    turned = box().apply_transform(matrix)
    np.testing.assert_array_equal(scene.meshes[1].vertices, turned.vertices)
    np.testing.assert_array_equal(scene.meshes[1].faces, turned.faces)
    assert_same(load([box(), turned]), scene)


def test_a_mirroring_transform_keeps_the_front() -> None:
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    graph = trimesh.Scene()
    graph.add_geometry(box(), transform=mirror)
    mesh = load(graph).meshes[0]
    corners = mesh.vertices[mesh.faces]
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.sum(outwards * corners.mean(axis=1), axis=1) > 0).all()


def test_the_camera_is_the_one_of_a_gltf_file(tmp_path: Path) -> None:
    scene = scene_with_camera()
    (tmp_path / "m.glb").write_bytes(scene.export(file_type="glb"))
    direct, file = load(scene, size=(30, 20)).camera, load(tmp_path / "m.glb", size=(30, 20)).camera
    np.testing.assert_allclose(direct.to_world, file.to_world, atol=1e-6)
    assert direct.fov_x == pytest.approx(file.fov_x, abs=1e-6)
    assert (load(scene).camera.width, load(scene).camera.height) == SIZE
    assert any("a point light at the camera" in warning for warning in load(scene).warnings)


def test_lights_that_somebody_set_are_used() -> None:
    scene = scene_with_camera()
    kinds = trimesh.scene.lighting
    lamps = [
        kinds.PointLight(name="p", color=[255, 0, 51, 255], intensity=10.0),
        kinds.SpotLight(name="s", color=[255] * 4, intensity=2.0, innerConeAngle=0.1, outerConeAngle=0.5),
        kinds.DirectionalLight(name="d", color=[255] * 4, intensity=3.0),
    ]
    for height, lamp in enumerate(lamps):
        scene.graph[lamp.name] = trimesh.transformations.translation_matrix((0, height, 5))
    scene.lights = lamps
    point, spot, sun = load(scene).lights
    assert isinstance(point, PointLight)
    assert (point.position, point.intensity) == ((0.0, 0.0, 5.0), pytest.approx((10.0, 0.0, 2.0)))
    assert isinstance(spot, SpotLight)
    assert (spot.cutoff_angle, spot.beam_width) == (math.degrees(0.5), math.degrees(0.1))
    np.testing.assert_array_equal(spot.to_world[:3, 2], [0, 0, -1])
    assert isinstance(sun, DirectionalLight)
    np.testing.assert_array_equal(sun.direction, [0, 0, -1])
    assert not any("is added" in warning for warning in load(scene).warnings)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (trimesh.Scene(), "the scene is empty"),
        (trimesh.Scene([trimesh.PointCloud([[0.0, 0.0, 0.0]])]), "the scene is empty"),
        ([], "list is no scene: expected a file"),
        ([box(), "box.ply"], "list is no scene: expected a file"),
        (7, "int is no scene: expected a file"),
        (trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, float("nan"), 0]], [[0, 1, 2]], process=False), "finite"),
    ],
)
def test_mistakes_are_one_line(source: Any, message: str) -> None:
    with pytest.raises(SceneError, match=message) as error:
        wdpm.render(source, **SMALL)
    assert "\n" not in str(error.value)


def test_indices_out_of_range_are_told_before_a_camera_is_placed() -> None:
    mesh = trimesh.Trimesh(vertices=np.eye(3), faces=[[0, 1, 5]], process=False)
    with pytest.raises(SceneError, match="face 0 names a vertex out of range"):
        wdpm.load(mesh)
