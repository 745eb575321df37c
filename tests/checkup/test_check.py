"""`wdpm check`: each finding from a scene made for it, exit codes, JSON, and mended copies."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from wdpm.checkup.findings import Checkup, Level
from wdpm.checkup.fix import mend
from wdpm.checkup.run import check
from wdpm.checkup.scene import is_inside
from wdpm.checkup.soup import edges_of, make_soup, pieces, volumes
from wdpm.cli.main import main
from wdpm.scenes.builtin.cornell_box import cornell_box
from wdpm.scenes.errors import SceneError, SettingsError
from wdpm.scenes.flat.dropped import CAUSES, NO_NORMAL, TOO_SMALL, ZERO_AREA, degenerate_cause
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.meshes.primitives import cube
from wdpm.scenes.model.bsdfs import Bsdf, Dielectric, Diffuse, ThinDielectric
from wdpm.scenes.model.lights import PointLight
from wdpm.scenes.model.scene import Camera, Material, Mesh, Scene, diffuse
from wdpm.scenes.model.textures import Bitmap
from wdpm.scenes.model.transforms import look_at

Array = npt.NDArray[Any]
TWO_SIDED = diffuse("grey", twosided=True)
LIGHT = PointLight("light", (0.0, 8.0, 0.0), (1.0, 1.0, 1.0))


def mesh_of(corners: Array, material: int = 0, **more: Any) -> Mesh:
    """A mesh of triangles with their own corners."""
    corners = np.asarray(corners, float).reshape(-1, 3, 3)
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    return replace(Mesh("mesh", corners.reshape(-1, 3), faces, None, None, material), **more)


def box(material: int = 0, scale: float = 1.0, **more: Any) -> Mesh:
    """A closed cube of half the side `scale` about the origin, facing outwards."""
    data = cube()
    return mesh_of(scale * data.vertices[data.faces], material, name="box", **more)


def scene_of(*meshes: Mesh, materials: tuple[Material, ...] = (TWO_SIDED,), **more: Any) -> Scene:
    to_world = look_at((0.3, 0.2, -9.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    scene = Scene("made", tuple(meshes), materials, (LIGHT,), Camera(to_world, 40.0))
    return replace(scene, **more)


def material(bsdf: Bsdf) -> tuple[Material, ...]:
    return (Material("material", bsdf),)


def kinds(checkup: Checkup) -> set[str]:
    return {finding.kind for finding in checkup.findings}


TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def test_sound_scenes_have_no_findings() -> None:
    assert check("cornell-box").findings == ()
    assert check(scene_of(box())).findings == ()
    assert check(scene_of(box(), materials=material(Dielectric()))).exit_code == 0


@pytest.mark.parametrize(
    ("kind", "scene", "count"),
    [
        ("zero-area", scene_of(box(), mesh_of([TRIANGLE, TRIANGLE[[0, 1, 1]]])), 1),
        ("too-small", scene_of(mesh_of([TRIANGLE, [[-4, 0, 0], [1e8, 1, 0], [0, 4e8, 0]]])), 1),
        ("needles", scene_of(box(), mesh_of([[[0, 0, 2], [1e-6, 0, 2], [0, 1, 2]]])), 1),
        ("duplicates", scene_of(box(), mesh_of([TRIANGLE + 2, TRIANGLE[[1, 2, 0]] + 2])), 1),
        ("back-to-back", scene_of(box(), mesh_of([TRIANGLE + 2, TRIANGLE[::-1] + 2])), 1),
        ("empty-mesh", scene_of(box(), mesh_of(np.zeros((0, 3, 3)))), 1),
        ("no-normal", scene_of(box(), mesh_of([TRIANGLE * 1e-12])), 1),
        ("non-manifold", scene_of(mesh_of([TRIANGLE + [0, 0, z] * np.array([[0], [0], [1]]) for z in (0, 1, 2)])), 1),
        ("open-solid", scene_of(mesh_of(TRIANGLE), materials=material(Dielectric())), 3),
        ("open-solid", scene_of(mesh_of(TRIANGLE, bounds=True)), 3),
        ("out-of-proportion", scene_of(*(mesh_of(TRIANGLE * s + s) for s in (1e-7, 1e-7, 1e-7, 1.0))), 1),
        ("speck", scene_of(box(), box(scale=1e-6)), 1),
        ("lamp-without-area", scene_of(box(), mesh_of([TRIANGLE[[0, 0, 1]]], emission=(1.0, 1.0, 1.0))), 1),
        ("lamp-without-power", scene_of(box(), mesh_of([TRIANGLE + 2], emission=(0.0, 0.0, 0.0))), 1),
        ("light-without-power", scene_of(box(), lights=(LIGHT, replace(LIGHT, intensity=(0.0, 0.0, 0.0)))), 1),
        (
            "far-camera",
            scene_of(box(), camera=Camera(look_at((0, 0, -1e5), (0, 0, 0), (0, 1, 0)), 40, far_clip=1e9)),
            1,
        ),
        ("camera-sees-nothing", scene_of(box(), camera=Camera(look_at((0, 0, -9), (0, 0, -10), (0, 1, 0)), 40.0)), 1),
        ("albedo-above-1", scene_of(box(), materials=material(Diffuse((0.5, 1.5, 0.5)))), 1),
        (
            "missing-file",
            scene_of(box(), warnings=('scene.obj:1: material library "x.mtl" not found: grey is used',)),
            1,
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else None,
)
def test_a_finding(kind: str, scene: Scene, count: int) -> None:
    """Each is told once, with its count and what a render does."""
    (finding,) = check(scene).of(kind)
    assert finding.count == count
    assert finding.what
    assert finding.renderer


def test_what_is_dropped_is_what_a_render_drops() -> None:
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(300, 3, 3)) * 10.0 ** rng.uniform(-25, 1, (300, 1, 1))
    corners[::7, 2] = corners[::7, 1]
    scene = scene_of(mesh_of(corners), box(scale=100.0))  # about the origin: the least detail is kept there
    cause = degenerate_cause(make_soup(scene).positions)
    dropped = flatten(scene).dropped
    assert int((cause == ZERO_AREA).sum()) == dropped["zero area"] + dropped[CAUSES[TOO_SMALL]]
    assert int((cause == NO_NORMAL).sum()) == dropped["no normal in single precision"] > 0


def test_what_a_render_refuses_is_an_error() -> None:
    broken = mesh_of([TRIANGLE, [[0, 0, np.nan], [1, 0, 0], [0, 1, 0]]])
    checkup = check(scene_of(box(), broken))
    assert kinds(checkup) >= {"refused", "broken-triangles"}
    assert checkup.exit_code == 2
    (dark,) = check(scene_of(box(), lights=())).of("refused")
    assert "no light" in dark.what
    assert check(replace(scene_of(box()), meshes=(mesh_of(np.zeros((0, 3, 3))),))).exit_code == 2


def test_sides() -> None:
    """Winding and closed bodies turned inside out matter where inside and outside do."""
    data = box()
    torn = replace(data, faces=np.concatenate([data.faces[:1, ::-1], data.faces[1:]]))
    turned = replace(data, faces=data.faces[:, ::-1])
    glass = material(Dielectric())
    (finding,) = check(scene_of(torn, materials=glass)).of("winding")
    assert (finding.level, finding.count) == (Level.WARNING, 3)
    assert check(scene_of(torn)).of("winding")[0].level is Level.NOTE
    assert "inside-out" in kinds(check(scene_of(turned, materials=glass)))
    assert "inside-out" in kinds(check(scene_of(replace(turned, emission=(1.0, 1.0, 1.0)))))
    assert check(scene_of(turned)).findings == ()
    # Normals say where the front is: then winding says nothing.
    normals = data.vertices / np.linalg.norm(data.vertices, axis=1, keepdims=True)
    assert check(scene_of(replace(torn, normals=normals), materials=glass)).findings == ()


def test_a_body_of_several_meshes_is_closed_if_they_are_together() -> None:
    data = cube()
    corners = data.vertices[data.faces]
    halves = mesh_of(corners[:5]), mesh_of(corners[5:])
    glass = material(Dielectric())
    assert "open-solid" not in kinds(check(scene_of(*halves, materials=glass)))
    assert "open-solid" in kinds(check(scene_of(halves[0], materials=glass)))
    assert "open-solid" not in kinds(check(scene_of(halves[0], materials=material(ThinDielectric()))))


def test_normals_against_their_triangle() -> None:
    normals = np.array([[0.0, 0, 1], [0, 0, 1], [0, 0.9, -0.5]])
    (finding,) = check(scene_of(box(), mesh_of(TRIANGLE + 2, normals=normals))).of("normals-against")
    assert finding.places == (0,)


@pytest.mark.parametrize(
    ("gap", "kind"), [(0.0, "coplanar"), (2.4e-7, "coplanar"), (1.4e-6, "closer-than-offset"), (1e-3, None)]
)
@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("turn", [np.eye(3), np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]])
def test_overlaps_in_a_plane(gap: float, kind: str | None, order: int, turn: Array) -> None:
    """A small picture on a large wall, whichever comes first in the file, along the axes and slanted."""
    wall = np.array([[-3.0, -3, 3], [3, -3, 3], [0, 3, 3]])
    picture = 0.1 * TRIANGLE + [0.2, 0.1, 3 + gap]
    materials = (TWO_SIDED, diffuse("red", (0.5, 0.0, 0.0), twosided=True))
    meshes = (mesh_of(wall @ turn, 0), mesh_of(-wall @ turn, 0), mesh_of(picture @ turn, 1))[::order]
    found = kinds(check(scene_of(*meshes, materials=materials)))
    if 0 < gap < 1e-5 and turn[0, 0] != 1:
        assert found <= {"coplanar", "closer-than-offset"}  # rounding may move it either way
        assert found
    else:
        assert found == ({kind} if kind else set())


def test_no_overlaps_are_looked_for_in_what_is_a_speck_beside_the_rest() -> None:
    """Each ray there may hit each triangle, as far as the tree can tell: 64,514 of them took minutes."""
    other = diffuse("red", (0.5, 0.0, 0.0), twosided=True)
    far = mesh_of(1e7 * np.array([[[-3.0, -3, z], [3, -3, z], [0, 3, z]] for z in (-3, 3)]))  # and the rest amidst
    found = kinds(check(scene_of(far, mesh_of(TRIANGLE), mesh_of(0.5 * TRIANGLE, 1), materials=(TWO_SIDED, other))))
    assert "speck" in found
    assert "coplanar" not in found


def test_copies_of_another_material() -> None:
    other = diffuse("red", (0.5, 0.0, 0.0), twosided=True)
    (finding,) = check(scene_of(box(), box(1), materials=(TWO_SIDED, other))).of("coplanar")
    assert (finding.count, finding.material) == (12, "red")
    assert {f.kind for f in check(scene_of(box(), box(1), materials=(TWO_SIDED, TWO_SIDED))).findings} == {"duplicates"}


def test_glass_that_touches_glass() -> None:
    """Two bodies with a face in common, and the same with a gap; a body twice in one place is seen once, and well."""
    glass = (Material("glass", Dielectric(1.5)),)
    width = float(np.ptp(box().vertices[:, 0]))
    beside = [replace(box(), vertices=box().vertices + np.array([width + gap, 0.0, 0.0])) for gap in (0.0, 1e-3)]
    findings = check(scene_of(box(), beside[0], materials=glass)).of("touching-solids")
    assert [(finding.material, finding.count) for finding in findings] == [("glass", 2)] * 2
    assert not check(scene_of(box(), beside[1], materials=glass)).of("touching-solids")
    assert not check(scene_of(box(), box(), materials=glass)).of("touching-solids")


def test_far_from_the_origin() -> None:
    far = box()
    far = replace(far, vertices=far.vertices + 2.0**20)
    camera = Camera(look_at(np.full(3, 2.0**20 - 9.0), np.full(3, 2.0**20), (0, 1, 0)), 40.0)
    lights = (replace(LIGHT, position=(2.0**20, 2.0**20 + 8, 2.0**20)),)
    (finding,) = check(scene_of(far, camera=camera, lights=lights)).of("far-off")
    assert finding.level is Level.WARNING  # its digits are those of single precision
    fine = replace(far, vertices=far.vertices + 1e-9 * np.pi)
    assert check(scene_of(fine, camera=camera, lights=lights)).of("far-off")[0].level is Level.NOTE


def test_textures_need_coordinates() -> None:
    picture = Bitmap("picture", np.full((2, 2, 3), 0.5, np.float32))
    textured = (diffuse("textured", picture, twosided=True),)
    assert "texture-without-uvs" in kinds(check(scene_of(box(), materials=textured)))
    plain = box()
    assert "flat-uvs" in kinds(check(scene_of(replace(plain, uvs=np.zeros((36, 2))), materials=textured)))
    unwrapped = replace(plain, uvs=np.tile([[0.0, 0], [1, 0], [0, 1]], (12, 1)))
    assert check(scene_of(unwrapped, materials=textured)).findings == ()


def test_a_furnace_that_never_ends() -> None:
    white = (diffuse("white", (1.0, 1.0, 1.0), twosided=True),)
    room = box()
    camera = Camera(look_at((0.0, 0.0, -0.5), (0.0, 0.0, 0.5), (0.0, 1.0, 0.0)), 40.0)
    inside = scene_of(room, materials=white, camera=camera, lights=(replace(LIGHT, position=(0.0, 0.5, 0.0)),))
    assert kinds(check(inside)) == {"albedo-1"}
    assert check(scene_of(mesh_of(TRIANGLE), materials=white)).findings == ()


def test_the_camera_and_what_it_is_in() -> None:
    eye = Camera(look_at((0.0, 0.0, -0.5), (0.0, 0.0, 0.5), (0.0, 1.0, 0.0)), 40.0)
    one_sided = (diffuse("one-sided"),)
    assert "camera-inside" in kinds(check(scene_of(box(), materials=one_sided, camera=eye)))
    assert "camera-inside" in kinds(check(scene_of(box(), materials=material(Dielectric()), camera=eye)))
    room = replace(box(), faces=box().faces[:, ::-1])
    assert "camera-inside" not in kinds(check(scene_of(room, materials=one_sided, camera=eye)))
    assert "far-clip" in kinds(check(scene_of(box(), camera=replace(eye, far_clip=1.0))))
    assert "near-clip" in kinds(check(scene_of(box(), camera=replace(eye, near_clip=50.0, far_clip=100.0))))


def test_inside_and_outside() -> None:
    corners = cube().vertices[cube().faces]
    assert is_inside(np.array([0.9, -0.9, 0.3]), corners)
    assert not is_inside(np.array([1.1, -0.9, 0.3]), corners)


def test_pieces_and_volumes_against_trimesh() -> None:
    """Three balls of different sizes, one of them inside out, in one mesh."""
    balls = [trimesh.creation.icosphere(2, radius) for radius in (1.0, 0.5, 0.25)]
    balls[1].invert()
    for number, ball in enumerate(balls):
        ball.apply_translation([3.0 * number, 0, 0])
    whole = trimesh.util.concatenate(balls)
    piece = pieces(edges_of(np.asarray(whole.faces)))
    assert sorted(np.bincount(piece)) == [320, 320, 320]
    corners = np.asarray(whole.triangles, np.float32)
    front = np.cross(*(corners[:, 1:] - corners[:, :1]).astype(float).swapaxes(0, 1))
    expected = [ball.volume for ball in balls]
    np.testing.assert_allclose(volumes(corners, front, piece), expected, rtol=1e-5)


def test_json_has_all_of_it(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "two.ply"
    trimesh.Trimesh(*twice(), process=False).export(file)
    assert main(["check", str(file), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["exit_code"] == 1
    assert told["file"] == str(file)
    (finding,) = (finding for finding in told["findings"] if finding["kind"] == "duplicates")
    assert finding["level"] == "warning"
    assert finding["mesh"] == "two"


def twice() -> tuple[Array, Array]:
    """A cube of which one triangle is there twice, one turned, and one without area; vertices and faces."""
    data = cube()
    vertices = np.concatenate([data.vertices, data.vertices[:1]])
    faces = np.concatenate([data.faces, data.faces[3:4], [[0, 1, 1]]])
    faces[0] = faces[0][::-1]
    return vertices, faces


def test_exit_codes(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["check", "cornell-box"]) == 0
    assert "nothing found" in capsys.readouterr().out
    file = tmp_path / "two.ply"
    trimesh.Trimesh(*twice(), process=False).export(file)
    assert main(["check", str(file)]) == 1
    assert "duplicates" not in capsys.readouterr().err
    file.write_text("no mesh")
    assert main(["check", str(file)]) == 2
    assert capsys.readouterr().err.startswith("wdpm: error: ")


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "off"])
def test_a_mended_copy(kind: str, tmp_path: Path) -> None:
    source, output = tmp_path / f"broken.{kind}", tmp_path / f"mended.{kind}"
    trimesh.Trimesh(*twice(), process=False).export(source)
    before = source.read_bytes()
    changes = " ".join(mend(source, output).changes)
    assert source.read_bytes() == before
    for word in ("1 triangles without area", "1 triangles that were there twice", "1 triangles turned"):
        assert word in changes
    mended = trimesh.load(output, process=kind == "stl")
    assert len(mended.faces) == 12
    assert mended.volume == pytest.approx(8.0)
    assert not kinds(check(output)) & {"zero-area", "duplicates", "winding", "inside-out"}
    again = mend(output, tmp_path / f"again.{kind}")
    assert not any("turned" in change or "dropped" in change for change in again.changes)


def test_a_mended_obj_keeps_materials_normals_and_coordinates(tmp_path: Path) -> None:
    source, output = tmp_path / "a.obj", tmp_path / "b.obj"
    source.write_text(
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 2 0 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\n"
        "usemtl red\nf 1/1/1 2/2/1 3/3/1\nusemtl blue\nf 3/1/1 2/2/1 1/3/1\nf 1/1/1 2/2/1 5/3/1\n"
    )
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    changes = mend(source, output).changes
    assert changes[0] == "1 triangles without area dropped"
    assert "zero-area" not in kinds(check(output))
    text = output.read_text()
    for word in ("mtllib a.mtl", "usemtl red", "usemtl blue", "vn 0.0 0.0 1.0", "vt 0.0 1.0"):
        assert word in text
    assert mend(output, tmp_path / "c.obj").changes == ()
    # The normals say that the second triangle was wound against them.
    assert any("1 triangles turned" in change for change in changes)


def test_what_a_format_cannot_hold_is_told(tmp_path: Path) -> None:
    source = tmp_path / "a.obj"
    source.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl red\nf 1/1 2/1 3/1\n")
    assert "texture coordinates" in " ".join(mend(source, tmp_path / "a.stl").changes)


def test_what_cannot_be_mended(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "a.off"
    source.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    with pytest.raises(SettingsError, match="never overwritten"):
        mend(source, source)
    with pytest.raises(SettingsError, match="does not exist"):
        mend(source, tmp_path / "nowhere" / "a.off")
    with pytest.raises(SettingsError, match="expected a name"):
        mend(source, tmp_path / "a.xyz")
    flat = tmp_path / "flat.off"
    flat.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n")
    with pytest.raises(SceneError, match="no triangle is left"):
        mend(flat, tmp_path / "b.off")
    scene = tmp_path / "scene.xml"
    scene.write_text(
        '<scene version="3.0.0"><shape type="obj"><string name="filename" value="model.obj"/></shape></scene>'
    )
    assert main(["check", str(scene), "--fix", str(tmp_path / "b.obj")]) == 2
    assert "model.obj" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("off", "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\nnan 0 0\n3 0 1 2\n3 0 1 3\n"),
        ("obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nf 1 2 3\nf 1 2 4\n"),
    ],
)
def test_a_file_that_cannot_be_rendered_may_be_mended(
    kind: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, output = tmp_path / f"nan.{kind}", tmp_path / f"mended.{kind}"
    source.write_text(text)
    assert main(["check", str(source), "--fix", str(output)]) == 2
    captured = capsys.readouterr()
    assert "not finite" in captured.err
    assert "1 triangles with corners that are not finite dropped" in captured.out
    assert main(["check", str(output)]) == 0


def test_a_library_scene_by_name_and_by_value() -> None:
    import wdpm

    assert wdpm.check("cornell-box").scene == wdpm.check(cornell_box()).scene
    assert wdpm.check("cornell-box").file is None
