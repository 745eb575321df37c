"""What MTL statements become: mirrors, glass, highlights, holes, textures; and vertex colours of bare meshes."""

from __future__ import annotations

from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from wdpm.scenes import (
    Bitmap,
    Blend,
    Bsdf,
    BumpMap,
    Conductor,
    Dielectric,
    Diffuse,
    Mask,
    NormalMap,
    Principled,
    Scene,
    SceneError,
    TwoSided,
    Wrap,
    load,
)
from wdpm.scenes.model.textures import VertexColors

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"


def scene_of(folder: Path, statements: str) -> Scene:
    """A triangle whose material has these statements."""
    (folder / "m.mtl").write_text(f"newmtl a\n{statements}\n")
    (folder / "m.obj").write_text(f"mtllib m.mtl\n{QUAD}usemtl a\nf 1/1 2/2 3/3\n")
    return load(folder / "m.obj")


def surface(folder: Path, statements: str) -> Bsdf:
    """The scattering function of a material that is alike on both sides."""
    bsdf = scene_of(folder, statements).materials[0].bsdf
    assert isinstance(bsdf, TwoSided)
    assert bsdf.back is None
    return bsdf.front


def own_warnings(scene: Scene) -> list[str]:
    return [warning for warning in scene.warnings if ".mtl" in warning]


@pytest.mark.parametrize(
    "statements",
    [
        "Kd 0 0 0\nKs 0.95 0.9 0.85\nNs 1000\nillum 5",
        "Kd 0 0 0\nKs 0.95 0.9 0.85\nillum 3",
        "Kd 0 0 0\nKs 0.95 0.9 0.85\nNs 50\nillum 8",
    ],
)
def test_mirrors(tmp_path: Path, statements: str) -> None:
    mirror = surface(tmp_path, statements)
    assert isinstance(mirror, Conductor)
    assert (mirror.eta, mirror.k) == ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    assert mirror.specular_reflectance == pytest.approx((0.95, 0.9, 0.85))
    assert (mirror.alpha_u, mirror.alpha_v) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("statements", "eta"),
    [
        ("Kd 0.01 0.01 0.01\nKs 0.3 0.3 0.3\nNs 200\nNi 2.5\nillum 7", 2.5),
        ("Ni 1.33\nKd 0 0 0\nillum 6", 1.33),
        ("Kd 0 0 0\nillum 6", 1.5),
        ("Ni 1.5\nKd 0 0 0\nKs 1 1 1\nd 0\nillum 2", 1.5),
        ("Ni 1.5\nKd 0 0 0\nTr 0.8\nillum 2", 1.5),
        ("Ni 1.4\nKd 0 0 0\nillum 4", 1.4),
    ],
)
def test_glass(tmp_path: Path, statements: str, eta: float) -> None:
    glass = scene_of(tmp_path, statements).materials[0].bsdf
    assert isinstance(glass, Dielectric)
    assert (glass.eta, glass.alpha_u) == (eta, 0.0)
    assert (glass.specular_reflectance, glass.specular_transmittance) == ((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))


def test_the_filter_of_glass_tints_but_does_not_dim(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "Ni 1.5\nKd 0 0 0\nTf 0.1 0.05 0\nillum 7")
    glass = scene.materials[0].bsdf
    assert isinstance(glass, Dielectric)
    assert glass.specular_transmittance == pytest.approx((1.0, 0.5, 0.0))
    assert own_warnings(scene) == [
        'm.mtl:4: material "a": Tf 0.1 0.05 0 dims what glass lets through: only its hue is used'
    ]


@pytest.mark.parametrize(
    ("statements", "opacity"),
    [
        ("d 0.25", 0.25),
        ("Tr 0.25", 0.75),
        ("Ni 1.45\nKd 0.5 0.5 0.5\nd 0.5\nillum 4", 0.5),
        ("Ni 1.45\nKd 0.5 0.5 0.5\nd 0.5\nillum 2", 0.5),
        ("Ni 1\nKd 0 0 0\nd 0.5\nillum 9", 0.5),
        ("d 0.25\nTr 0.25", 0.25),
    ],
)
def test_partly_opaque(tmp_path: Path, statements: str, opacity: float) -> None:
    mask = scene_of(tmp_path, statements).materials[0].bsdf
    assert isinstance(mask, Mask)
    assert mask.opacity == pytest.approx(opacity)
    assert isinstance(mask.nested, TwoSided)


def test_highlights_conserve_energy(tmp_path: Path) -> None:
    """What the mixture reflects is Kd + Ks, and never more than all."""
    for kd, ks, factor in (((0.4, 0.2, 0.1), (0.3, 0.2, 0.1), 1.0), ((0.5, 0.6, 0.7), (0.9, 0.9, 0.9), 1 / 1.6)):
        words = (" ".join(map(str, kd)), " ".join(map(str, ks)))
        scene = scene_of(tmp_path, f"Kd {words[0]}\nKs {words[1]}\nNs 40\nillum 2")
        two_sided = scene.materials[0].bsdf
        assert isinstance(two_sided, TwoSided)
        blend = two_sided.front
        assert isinstance(blend, Blend)
        assert isinstance(blend.first, Diffuse)
        assert isinstance(blend.second, Conductor)
        weight = blend.weight
        assert isinstance(weight, float)
        np.testing.assert_allclose(np.multiply(blend.first.reflectance, 1 - weight), np.multiply(kd, factor))
        np.testing.assert_allclose(np.multiply(blend.second.specular_reflectance, weight), np.multiply(ks, factor))
        assert max(blend.first.reflectance) <= 1.0
        assert max(blend.second.specular_reflectance) <= 1.0
        assert blend.second.alpha_u == blend.second.alpha_v == pytest.approx((2 / 42) ** 0.5)
        assert bool(own_warnings(scene)) == (factor < 1.0)


def test_no_highlight_without_its_model(tmp_path: Path) -> None:
    bsdf = surface(tmp_path, "Kd 0.5 0.5 0.5\nKs 0.5 0.5 0.5\nillum 1")
    assert isinstance(bsdf, Diffuse)


def test_statements_for_physically_based_materials(tmp_path: Path) -> None:
    imageio.imwrite(tmp_path / "m.png", np.full((2, 2), 51, dtype=np.uint8))
    bsdf = surface(tmp_path, "Kd 0.5 0.6 0.7\nPr 0.3\nmap_Pm m.png\nPc 0.5\nPcr 0.25\nNi 1.4")
    assert isinstance(bsdf, Principled)
    assert (bsdf.base_color, bsdf.roughness, bsdf.eta) == ((0.5, 0.6, 0.7), 0.3, 1.4)
    assert (bsdf.clearcoat, bsdf.clearcoat_gloss) == (0.5, 0.75)
    assert isinstance(bsdf.metallic, Bitmap)
    np.testing.assert_allclose(bsdf.metallic.pixels, 0.2, rtol=1e-6)  # a number, not a colour: never decoded


def test_maps(tmp_path: Path) -> None:
    imageio.imwrite(tmp_path / "my wood.png", np.full((2, 2, 3), 255, dtype=np.uint8))
    imageio.imwrite(tmp_path / "holes.png", np.dstack([np.zeros((2, 2, 3)), np.full((2, 2), 255)]).astype(np.uint8))
    imageio.imwrite(tmp_path / "bump.png", np.full((2, 2), 51, dtype=np.uint8))
    mask = scene_of(
        tmp_path,
        "Kd 0.5 0.5 0.5\nmap_Kd -s 2 3 -o 0.5 -clamp on my wood.png\nmap_d holes.png\n"
        "map_Bump -bm 0.25 bump.png\nnorm bump.png\nillum 2",
    )
    bsdf = mask.materials[0].bsdf
    assert isinstance(bsdf, Mask)
    assert isinstance(bsdf.opacity, Bitmap)
    assert bsdf.opacity.pixels.min() == 1.0  # its alpha, since it has one
    assert isinstance(bsdf.nested, TwoSided)
    bump = bsdf.nested.front
    assert isinstance(bump, BumpMap)
    assert bump.scale == 0.25
    assert isinstance(bump.nested, NormalMap)
    assert bump.nested.along_v == 1.0
    diffuse = bump.nested.nested
    assert isinstance(diffuse, Diffuse)
    wood = diffuse.reflectance
    assert isinstance(wood, Bitmap)
    assert wood.wrap is Wrap.CLAMP
    np.testing.assert_allclose(wood.to_uv @ [1, 1, 1], [2.5, 3, 1])
    np.testing.assert_allclose(wood.pixels, 0.5)


@pytest.mark.parametrize("name", ["wall [old].<UDIM>.png", "wall [old].1001.png"])
def test_of_tiles_the_first_is_repeated(tmp_path: Path, name: str) -> None:
    for tile, grey in (("1001", 255), ("1002", 0)):
        imageio.imwrite(tmp_path / f"wall [old].{tile}.png", np.full((2, 2, 3), grey, np.uint8))
    scene = scene_of(tmp_path, f"map_Kd {name}")
    bsdf = scene.materials[0].bsdf
    assert isinstance(bsdf, TwoSided)
    assert isinstance(bsdf.front, Diffuse)
    assert isinstance(bsdf.front.reflectance, Bitmap)
    assert (bsdf.front.reflectance.pixels == 1.0).all()
    (warning,) = own_warnings(scene)
    assert 'm.mtl:2: material "a": map_Kd is in tiles (UDIM), of which the first is repeated' in warning
    (tmp_path / "wall [old].1002.png").unlink()
    assert not own_warnings(scene_of(tmp_path, f"map_Kd {name}"))


def test_emission_map(tmp_path: Path) -> None:
    imageio.imwrite(tmp_path / "glow.png", np.full((2, 2, 3), 255, dtype=np.uint8))
    emission = scene_of(tmp_path, "Ke 2 4 6\nmap_Ke glow.png").meshes[0].emission
    assert isinstance(emission, Bitmap)
    np.testing.assert_allclose(emission.pixels[0, 0], [2, 4, 6])


@pytest.mark.parametrize(
    ("statements", "line", "message"),
    [
        ("Kd 1 1 1\nfrobnicate 3", 3, '"frobnicate" is ignored'),
        ("Kd 1 1 1\nmap_Ks s.png", 3, '"map_Ks" is ignored'),
        ("Kd 1.5 1 1", 2, "Kd 1.5 1 1 is above 1"),
        ("d 0.5\nTr 0.9", 3, "Tr 0.9 contradicts d"),
        ("illum 12", 2, "no illumination model"),
        ("Ni 1\nillum 7", 3, "Ni is not above 1"),
        ("Kd 0 0 0\nillum 7", 3, "Ni is not given: 1.5 is used"),
        ("map_Kd nowhere.png", 2, 'texture "nowhere.png"'),
        ("d -halo 0.5", 2, "depends on the angle of view"),
    ],
)
def test_warnings_name_file_and_line(tmp_path: Path, statements: str, line: int, message: str) -> None:
    warnings = own_warnings(scene_of(tmp_path, statements))
    assert len(warnings) == 1
    assert warnings[0].startswith(f'm.mtl:{line}: material "a": ')
    assert message in warnings[0]


@pytest.mark.parametrize(
    ("statements", "message"),
    [("Ks 1 2", r'm\.mtl:2: "Ks" must be 1 or 3 numbers'), ("Ns big", r'm\.mtl:2: "Ns" must be one number')],
)
def test_errors_name_file_and_line(tmp_path: Path, statements: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene_of(tmp_path, statements)


def test_lamps_by_name_and_libraries_of_the_models_name(tmp_path: Path) -> None:
    (tmp_path / "other.mtl").write_text("newmtl wall\nKd 0.5 0.5 0.5\n")
    text = f"mtllib other.mtl\n{QUAD}usemtl wall\nf 1 2 3\nusemtl light\nf 1 3 4\n"
    (tmp_path / "room.obj").write_text(text)
    scene = load(tmp_path / "room.obj")
    assert [mesh.emission for mesh in scene.meshes] == [None, (10.0, 10.0, 10.0)]
    assert any("by its name it is taken for a lamp" in warning for warning in scene.warnings)
    (tmp_path / "room.mtl").write_text("newmtl light\nKe 1 2 3\nnewmtl wall\nKd 0 0 0\n")
    scene = load(tmp_path / "room.obj")
    assert [mesh.emission for mesh in scene.meshes] == [None, (1.0, 2.0, 3.0)]
    assert any("room.mtl has it" in warning for warning in scene.warnings)


# ---- vertex colours ----


def colored_ply(kind: str, rows: list[str]) -> str:
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\nproperty float x\nproperty float y\nproperty float z\n"
    )
    header += "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
    return (
        header
        + "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        + "\n".join(rows)
        + "\n3 0 1 2\n"
    )


PLACES = ("0 0 0", "1 0 0", "0 1 0")


@pytest.mark.parametrize(("kind", "colour", "middle"), [("uchar", "255 128 0", 0.2158605), ("float", "1 0.5 0", 0.5)])
def test_colours_of_a_bare_ply(tmp_path: Path, kind: str, colour: str, middle: float) -> None:
    (tmp_path / "m.ply").write_text(colored_ply(kind, [f"{place} {colour}" for place in PLACES]))
    scene = load(tmp_path / "m.ply")
    bsdf = scene.materials[0].bsdf
    assert isinstance(bsdf, TwoSided)
    assert isinstance(bsdf.front, Diffuse)
    assert isinstance(bsdf.front.reflectance, VertexColors)
    assert scene.meshes[0].colors is not None
    np.testing.assert_allclose(scene.meshes[0].colors, [[1.0, middle, 0.0]] * 3, atol=1e-6)


@pytest.mark.parametrize("colour", ["1 0 0", "1 0 0 0.5"])
@pytest.mark.parametrize("face", ["f 3 2 1", "f 3 2 \\\n1"], ids=["plain", "with a line that goes on"])
def test_colours_of_a_bare_obj(tmp_path: Path, colour: str, face: str) -> None:
    """By either reader; opacity is not read."""
    (tmp_path / "m.obj").write_text("".join(f"v {place} {colour}\n" for place in PLACES) + f"{face}\n")
    colors = load(tmp_path / "m.obj").meshes[0].colors
    np.testing.assert_array_equal(colors, [[1, 0, 0]] * 3)


@pytest.mark.parametrize(
    ("colour", "warning"),
    [
        ("nan 0 0", "m.obj: colours of vertices beyond 0 to 1, or that are no numbers, are ignored: grey is used"),
        ("3 0 0", "m.obj: colours of vertices beyond 0 to 1, or that are no numbers, are ignored: grey is used"),
        ("a b c", "m.obj:1: not every vertex has a colour, and this one has none: the colours of all are ignored"),
    ],
)
def test_unusable_colours_are_none_and_said(tmp_path: Path, colour: str, warning: str) -> None:
    (tmp_path / "m.obj").write_text("".join(f"v {place} {colour}\n" for place in PLACES) + "f 3 2 1\n")
    scene = load(tmp_path / "m.obj")
    assert scene.meshes[0].colors is None
    assert warning in scene.warnings


def test_colours_on_some_vertices_are_none_and_said(tmp_path: Path) -> None:
    first, second, third = PLACES
    text = f"# of two programs\nv {first} 1 0 0\nv {second}\nv {third} 0 1 0\nf 3 2 1\n"
    (tmp_path / "m.obj").write_text(text)
    scene = load(tmp_path / "m.obj")
    assert scene.meshes[0].colors is None
    warning = "m.obj:3: not every vertex has a colour, and this one has none: the colours of all are ignored"
    assert warning in scene.warnings
    # where a library says how it looks, colours of vertices are not asked for
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 1 0 0\n")
    (tmp_path / "m.obj").write_text("mtllib m.mtl\nusemtl red\n" + text)
    assert not any("colour" in warning for warning in load(tmp_path / "m.obj").warnings)


GLOSSY = {
    "CornellBox-Glass": ("shortBox", Dielectric),
    "CornellBox-Mirror": ("tallBox", TwoSided),
    "CornellBox-Sphere": ("rightSphere", Dielectric),
    "CornellBox-Water": ("water", Dielectric),
}


@pytest.mark.shared
@pytest.mark.parametrize("name", GLOSSY)
def test_mcguires_boxes(scenes_dir: Path, name: str) -> None:
    scene = load(scenes_dir / "mcguire-cornell" / f"{name}.obj")
    material, kind = GLOSSY[name]
    (bsdf,) = [entry.bsdf for entry in scene.materials if entry.name == material]
    assert isinstance(bsdf, kind)
    if isinstance(bsdf, TwoSided):
        assert isinstance(bsdf.front, Conductor)
        assert bsdf.front.alpha_u == 0.0


@pytest.mark.shared
def test_all_of_mcguires_boxes_are_lit_by_themselves(scenes_dir: Path) -> None:
    for file in sorted((scenes_dir / "mcguire-cornell").glob("CornellBox-*.obj")):
        scene = load(file)
        assert any(mesh.emission is not None for mesh in scene.meshes)
        assert not any("two soft lamps" in warning for warning in scene.warnings), file.name
