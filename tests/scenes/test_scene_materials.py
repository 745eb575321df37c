"""Mitsuba's bsdf and texture plugins: every parameter, and every error with its file and line."""

from __future__ import annotations

import re
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from mitsuba_xml import number, rgb

from wdpm.scenes import (
    Bitmap,
    Blend,
    Bsdf,
    BumpMap,
    Checkerboard,
    Conductor,
    Dielectric,
    Diffuse,
    Distribution,
    Mask,
    NormalMap,
    Null,
    Plastic,
    Principled,
    RoughPane,
    Scene,
    SceneError,
    ThinDielectric,
    Translucent,
    TwoSided,
    VertexColors,
    load,
)
from wdpm.scenes.mitsuba.metals import METALS
from wdpm.scenes.model.bsdfs import textures_of, transmits, uses_uvs, vertex_attributes

LAMP = (
    '<shape type="rectangle"><emitter type="area"><rgb name="radiance" value="1 2 3"/></emitter>'
    '<transform name="to_world"><translate z="9"/></transform></shape>'
)


def write(folder: Path, bsdf: str) -> Path:
    file = folder / "scene.xml"
    file.write_text(f'<scene version="3.0.0">\n<shape type="rectangle">\n{bsdf}\n</shape>{LAMP}</scene>')
    return file


def read(folder: Path, bsdf: str) -> Bsdf:
    """A material as read, without its name."""
    return load(write(folder, bsdf)).materials[0].bsdf


def word(name: str, value: str) -> str:
    return f'<string name="{name}" value="{value}"/>'


def checks(name: str) -> str:
    return f'<texture type="checkerboard" name="{name}"/>'


def plugin(kind: str, inside: str = "") -> str:
    return f'<bsdf type="{kind}">{inside}</bsdf>'


def shown(bsdf: Bsdf) -> str:
    """All parameters of a tree, for comparisons."""
    return re.sub(r"array\(.*?\)\)", "", repr(bsdf), flags=re.DOTALL)


DIFFUSE = plugin("diffuse")
ANISOTROPIC = number("alpha_u", 0.2) + number("alpha_v", 0.3)
GLASS = 1.5046 / 1.000277
GOLD = METALS["Au"]
SHARES = (
    "roughness",
    "anisotropic",
    "metallic",
    "spec_trans",
    "spec_tint",
    "sheen",
    "sheen_tint",
    "flatness",
    "clearcoat",
    "clearcoat_gloss",
)

# what is written, and what must be read
READ = [
    ("diffuse", DIFFUSE, Diffuse((0.5, 0.5, 0.5))),
    ("diffuse of 0.6", plugin("diffuse", rgb("diffuseReflectance", "0.1 0.2 0.3")), Diffuse((0.1, 0.2, 0.3))),
    ("conductor", plugin("conductor"), Conductor()),
    ("named metal", plugin("conductor", word("material", "Au")), Conductor(*GOLD)),
    ("no metal", plugin("conductor", word("material", "none")), Conductor((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))),
    (
        "eta and k",
        plugin("conductor", rgb("eta", "0.2 0.9 1.1") + rgb("k", "3.9 2.5 2.1")),
        Conductor((0.2, 0.9, 1.1), (3.9, 2.5, 2.1)),
    ),
    (
        "extEta of 0.6",
        plugin("conductor", rgb("eta", "1 2 3") + rgb("k", "3 4 5") + number("extEta", 2.0)),
        Conductor((0.5, 1.0, 1.5), (1.5, 2.0, 2.5)),
    ),
    (
        "spectrum as factor",
        plugin("conductor", '<spectrum name="specularReflectance" value="0.15"/>'),
        Conductor(specular_reflectance=(0.15, 0.15, 0.15)),
    ),
    ("roughconductor", plugin("roughconductor"), Conductor(alpha_u=0.1, alpha_v=0.1)),
    (
        "GGX",
        plugin("roughconductor", word("distribution", "GGX") + number("alpha", 0.3)),
        Conductor(alpha_u=0.3, alpha_v=0.3, distribution=Distribution.GGX),
    ),
    (
        "anisotropic, and sampling as one likes",
        plugin("roughconductor", ANISOTROPIC + '<boolean name="sampleVisible" value="false"/>'),
        Conductor(alpha_u=0.2, alpha_v=0.3),
    ),
    (
        "alphaU of 0.6",
        plugin("roughconductor", number("alphaU", 0.2) + number("alphaV", 0.3)),
        Conductor(alpha_u=0.2, alpha_v=0.3),
    ),
    ("dielectric", plugin("dielectric"), Dielectric(GLASS)),
    ("index", plugin("dielectric", number("int_ior", 1.8) + number("ext_ior", 1.0)), Dielectric(1.8)),
    ("named index", plugin("dielectric", word("intIOR", "Water") + word("extIOR", "vacuum")), Dielectric(1.333)),
    (
        "factors",
        plugin("dielectric", rgb("specular_reflectance", "0.5") + rgb("specular_transmittance", "0.9 0.8 0.7")),
        Dielectric(GLASS, (0.5, 0.5, 0.5), (0.9, 0.8, 0.7)),
    ),
    ("thindielectric", plugin("thindielectric", number("int_ior", 1.5)), ThinDielectric(1.5 / 1.000277)),
    ("roughdielectric", plugin("roughdielectric"), Dielectric(GLASS, alpha_u=0.1, alpha_v=0.1)),
    (
        "rough and anisotropic glass",
        plugin("roughdielectric", ANISOTROPIC + word("distribution", "ggx")),
        Dielectric(GLASS, alpha_u=0.2, alpha_v=0.3, distribution=Distribution.GGX),
    ),
    ("plastic", plugin("plastic"), Plastic(eta=1.49 / 1.000277)),
    (
        "all of plastic",
        plugin(
            "plastic",
            rgb("diffuse_reflectance", "0.1 0.2 0.3")
            + number("specular_reflectance", 0.5)
            + '<boolean name="nonlinear" value="true"/>'
            + word("int_ior", "diamond"),
        ),
        Plastic((0.1, 0.2, 0.3), (0.5, 0.5, 0.5), 2.419 / 1.000277, True),
    ),
    (
        "roughplastic",
        plugin("roughplastic", word("distribution", "ggx") + number("alpha", 0.2)),
        Plastic(eta=1.49 / 1.000277, alpha=0.2, distribution=Distribution.GGX),
    ),
    ("principled", plugin("principled"), Principled(eta=1.5)),
    (
        "all of principled",
        plugin(
            "principled",
            rgb("base_color", "0.1 0.2 0.3")
            + "".join(number(name, 0.05 * place) for place, name in enumerate(SHARES, start=1))
            + number("eta", 1.33)
            + number("main_specular_sampling_rate", 2.0),
        ),
        Principled((0.1, 0.2, 0.3), 0.05, 0.1, 0.05 * 3, 0.2, 1.33, 0.25, 0.05 * 6, 0.05 * 7, 0.4, 0.45, 0.5),
    ),
    ("no specular", plugin("principled", number("specular", 0.0)), Principled(eta=1.0)),
    (
        "index of nothing that must refract",
        plugin("principled", number("eta", 1.0) + number("spec_trans", 0.5)),
        Principled(eta=1.001, spec_trans=0.5),
    ),
    ("null", plugin("null"), Null()),
    ("twosided", plugin("twosided", DIFFUSE), TwoSided(Diffuse())),
    ("two sides", plugin("twosided", DIFFUSE + plugin("conductor")), TwoSided(Diffuse(), Conductor())),
    ("twosided twice", plugin("twosided", plugin("twosided", DIFFUSE)), TwoSided(Diffuse())),
    ("mask", plugin("mask", DIFFUSE), Mask(Diffuse(), 0.5)),
    ("mask of a colour", plugin("mask", rgb("opacity", "0 0.9 0") + DIFFUSE), Mask(Diffuse(), 0.3)),
    (
        "mask around both sides",
        plugin("mask", number("opacity", 0.3) + plugin("twosided", DIFFUSE)),
        Mask(TwoSided(Diffuse()), 0.3),
    ),
    (
        "blendbsdf",
        plugin("blendbsdf", number("weight", 0.25) + DIFFUSE + plugin("conductor")),
        Blend(Diffuse(), Conductor(), 0.25),
    ),
]


@pytest.mark.parametrize(("text", "expected"), [row[1:] for row in READ], ids=[row[0] for row in READ])
def test_parameters(tmp_path: Path, text: str, expected: Bsdf) -> None:
    assert shown(read(tmp_path, text)) == shown(expected)


def test_specular_becomes_an_index(tmp_path: Path) -> None:
    """The reflectance at normal incidence is 8 % of `specular` (Burley 2015)."""
    bsdf = read(tmp_path, plugin("principled", number("specular", 0.8)))
    assert isinstance(bsdf, Principled)
    assert ((bsdf.eta - 1.0) / (bsdf.eta + 1.0)) ** 2 == pytest.approx(0.064)


TEXTURED = [
    ("diffuse", ["reflectance"]),
    ("conductor", ["eta", "k", "specular_reflectance"]),
    ("roughconductor", ["alpha_u", "alpha_v", "specular_reflectance"]),
    ("dielectric", ["specular_reflectance", "specular_transmittance"]),
    ("thindielectric", ["specular_reflectance", "specular_transmittance"]),
    ("roughdielectric", ["alpha_u", "alpha_v", "specular_transmittance"]),
    ("plastic", ["diffuse_reflectance", "specular_reflectance"]),
    ("roughplastic", ["diffuse_reflectance", "specular_reflectance"]),
    (
        "principled",
        ["base_color", *SHARES],
    ),
]


@pytest.mark.parametrize(("kind", "parameters"), TEXTURED, ids=[row[0] for row in TEXTURED])
def test_textures_as_parameters(tmp_path: Path, kind: str, parameters: list[str]) -> None:
    bsdf = read(tmp_path, plugin(kind, "".join(checks(name) for name in parameters)))
    for name in parameters:
        assert isinstance(getattr(bsdf, name), Checkerboard)
    assert uses_uvs(bsdf)


def test_one_alpha_texture_for_both_directions(tmp_path: Path) -> None:
    bsdf = read(tmp_path, plugin("roughconductor", checks("alpha")))
    assert isinstance(bsdf, Conductor)
    assert isinstance(bsdf.alpha_u, Checkerboard)
    assert bsdf.alpha_u is bsdf.alpha_v


def test_checkerboard(tmp_path: Path) -> None:
    texture = (
        '<texture type="checkerboard" name="opacity"><float name="color0" value="0"/>'
        '<rgb name="color1" value="0.1 0.2 0.3"/><transform name="to_uv"><scale x="12" y="3"/></transform></texture>'
    )
    bsdf = read(tmp_path, plugin("mask", texture + DIFFUSE))
    assert isinstance(bsdf, Mask)
    assert isinstance(bsdf.opacity, Checkerboard)
    # Mitsuba 3.9.1 reads a checkerboard's numbers (eval_1) from the other squares than its colours (eval): their means.
    np.testing.assert_allclose(bsdf.opacity.color0, [0.2] * 3)
    assert bsdf.opacity.color1 == (0.0, 0.0, 0.0)
    np.testing.assert_array_equal(bsdf.opacity.to_uv, np.diag([12.0, 3.0, 1.0]))
    plain = read(tmp_path, plugin("diffuse", checks("reflectance")))
    assert "color0=(0.4, 0.4, 0.4), color1=(0.2, 0.2, 0.2)" in shown(plain)


def test_bump_and_normal_maps(tmp_path: Path) -> None:
    imageio.imwrite(tmp_path / "a.png", np.full((2, 2, 3), 128, dtype=np.uint8))
    image = '<texture type="bitmap" name="{}"><string name="filename" value="a.png"/>{}</texture>'
    raw = '<boolean name="raw" value="true"/>'
    bump = read(tmp_path, plugin("bumpmap", image.format("arbitrary", raw) + number("scale", 3.0) + DIFFUSE))
    assert isinstance(bump, BumpMap)
    assert isinstance(bump.height, Bitmap)
    assert bump.scale == 3.0
    np.testing.assert_allclose(bump.height.pixels, 128 / 255, rtol=1e-6)
    normal = read(tmp_path, plugin("normalmap", image.format("normalmap", "") + plugin("conductor")))
    assert isinstance(normal, NormalMap)
    assert isinstance(normal.nested, Conductor)
    assert isinstance(normal.normals, Bitmap)
    np.testing.assert_allclose(normal.normals.pixels, 0.2158605, rtol=1e-5)  # decoded, as in Mitsuba without raw


def test_grey_images_and_images_with_alpha(tmp_path: Path) -> None:
    for pixels in (
        np.full((2, 2), 255, np.uint8),
        np.full((2, 2, 2), 255, np.uint8),
        np.full((2, 2, 4), 255, np.uint8),
    ):
        imageio.imwrite(tmp_path / "a.png", pixels)
        texture = '<texture type="bitmap" name="opacity"><string name="filename" value="a.png"/></texture>'
        bsdf = read(tmp_path, plugin("mask", texture + DIFFUSE))
        assert isinstance(bsdf, Mask)
        assert isinstance(bsdf.opacity, Bitmap)
        np.testing.assert_array_equal(bsdf.opacity.pixels, np.ones((2, 2, 3), np.float32))


def test_references(tmp_path: Path) -> None:
    """Nested bsdfs and textures by reference; each is read once."""
    file = tmp_path / "scene.xml"
    file.write_text(
        '<scene version="3.0.0"><texture type="checkerboard" id="t"/>'
        '<bsdf type="diffuse" id="d"><ref name="reflectance" id="t"/></bsdf>'
        '<bsdf type="blendbsdf" id="b"><ref name="weight" id="t"/><ref id="d"/><ref id="d"/></bsdf>'
        f'<shape type="cube"><ref id="b"/></shape><shape type="cube"><ref id="d"/></shape>{LAMP}</scene>'
    )
    scene = load(file)
    assert [material.name for material in scene.materials] == ["b", "d", "default"]
    # One for colours and one, with its squares exchanged, for numbers.
    assert len({id(texture) for material in scene.materials for texture in textures_of(material.bsdf)}) == 2


PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
property float rust_0
element face 1
property list uchar int vertex_indices
end_header
0 0 0 255 51 0 0.25
1 0 0 255 51 0 0.5
0 1 0 255 51 0 0.75
3 0 1 2
"""


def attribute(name: str, parameter: str) -> str:
    value = f'<string name="name" value="{name}"/><float name="scale" value="2"/>'
    return f'<texture type="mesh_attribute" name="{parameter}">{value}</texture>'


def read_colored(folder: Path, bsdf: str) -> Scene:
    (folder / "m.ply").write_text(PLY)
    shape = f'<shape type="ply"><string name="filename" value="m.ply"/>\n{bsdf}</shape>'
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">\n{shape}{LAMP}</scene>')
    return load(folder / "scene.xml")


def test_mesh_attributes(tmp_path: Path) -> None:
    """The mesh comes with the attribute that its material reads: as in the file, whole numbers between 0 and 1."""
    scene = read_colored(tmp_path, plugin("diffuse", attribute("vertex_color", "reflectance")))
    bsdf = scene.materials[0].bsdf
    assert isinstance(bsdf, Diffuse)
    assert isinstance(bsdf.reflectance, VertexColors)
    assert (bsdf.reflectance.name, bsdf.reflectance.scale) == ("vertex_color", 2.0)
    np.testing.assert_allclose(scene.meshes[0].colors, [[1.0, 0.2, 0.0]] * 3)
    rusty = read_colored(tmp_path, plugin("roughconductor", attribute("vertex_rust", "alpha")))
    np.testing.assert_allclose(rusty.meshes[0].colors, [[0.25] * 3, [0.5] * 3, [0.75] * 3])
    assert read_colored(tmp_path, DIFFUSE).meshes[0].colors is None
    assert not uses_uvs(bsdf)


@pytest.mark.parametrize(
    ("bsdf", "message"),
    [
        (plugin("diffuse", attribute("vertex_wood", "reflectance")), 'no attribute "vertex_wood" (it has vertex_color'),
        (
            plugin("principled", attribute("vertex_color", "base_color") + attribute("vertex_rust", "roughness")),
            "several attributes of its mesh (vertex_color, vertex_rust)",
        ),
    ],
)
def test_mesh_attributes_that_cannot_be_had(tmp_path: Path, bsdf: str, message: str) -> None:
    with pytest.raises(SceneError, match=re.escape(message)) as caught:
        read_colored(tmp_path, bsdf)
    assert caught.value.line == 2


def test_attributes_of_emission_count() -> None:
    bsdf = Diffuse(VertexColors("vertex_color"))
    assert vertex_attributes(bsdf, None, VertexColors("vertex_glow")) == {"vertex_color", "vertex_glow"}


def test_what_lets_light_through() -> None:
    opaque: list[Bsdf] = [Diffuse(), Conductor(), Plastic(), Principled(), TwoSided(Blend(Diffuse(), Conductor()))]
    clear: list[Bsdf] = [Dielectric(), ThinDielectric(), Null(), Mask(Diffuse()), Principled(spec_trans=0.1)]
    assert not any(transmits(bsdf) for bsdf in opaque)
    assert all(transmits(bsdf) and transmits(Blend(Diffuse(), bsdf)) for bsdf in clear)


def test_tangents_need_texture_coordinates() -> None:
    assert uses_uvs(Conductor(alpha_u=0.1, alpha_v=0.2))
    assert uses_uvs(Principled(anisotropic=0.5))
    assert not uses_uvs(Conductor(alpha_u=0.1, alpha_v=0.1))


def test_options_of_bump_maps_that_do_not_exist_here(tmp_path: Path) -> None:
    text = plugin("bumpmap", checks("a") + DIFFUSE + '<boolean name="use_shadowing_function" value="false"/>')
    assert any("use_shadowing_function" in warning for warning in load(write(tmp_path, text)).warnings)


NESTED_IN_TWO_SIDED = [
    plugin("dielectric"),
    plugin("thindielectric"),
    plugin("null"),
    plugin("mask", DIFFUSE),
    plugin("principled", number("spec_trans", 0.5)),
    plugin("blendbsdf", number("weight", 0.5) + DIFFUSE + plugin("roughdielectric")),
]
# what is written from line 3 on, the line of the error, what it says
ERRORS = [
    *((f'<bsdf type="twosided">\n{inner}</bsdf>', 4, "lets light through") for inner in NESTED_IN_TWO_SIDED),
    (plugin("twosided", DIFFUSE * 3), 3, "expected one nested bsdf for both sides, or two, got 3"),
    (plugin("mask"), 3, "expected one nested bsdf, got 0"),
    (plugin("mask", DIFFUSE * 2), 3, "expected one nested bsdf, got 2"),
    (f'<bsdf type="mask">{DIFFUSE}\n<float name="opacity" value="1.5"/></bsdf>', 4, "between 0 and 1, got 1.5"),
    (plugin("blendbsdf", DIFFUSE * 2), 3, '"weight" is missing'),
    (plugin("blendbsdf", number("weight", 0.5) + DIFFUSE), 3, "expected two nested bsdfs, got 1"),
    (plugin("bumpmap", DIFFUSE), 3, "expected one nested texture"),
    (f'<bsdf type="bumpmap">{DIFFUSE}{checks("a")}\n{checks("b")}</bsdf>', 4, "takes one texture, got 2"),
    (plugin("normalmap", DIFFUSE), 3, '"normalmap" is missing'),
    (f'<bsdf type="normalmap">{DIFFUSE}{checks("normalmap")}\n{checks("b")}</bsdf>', 4, "takes no nested texture"),
    (f'<bsdf type="null">\n{number("alpha", 1)}</bsdf>', 4, 'unknown parameter "alpha"'),
    (f'<bsdf type="conductor">\n{number("alpha", 0.1)}</bsdf>', 4, 'unknown parameter "alpha"'),
    (f'<bsdf type="plastic">\n{number("alpha", 0.1)}</bsdf>', 4, 'unknown parameter "alpha"'),
    (f'<bsdf type="principled">\n{number("rougness", 0.1)}</bsdf>', 4, 'did you mean "roughness"?'),
    (f'<bsdf type="principled">\n{number("roughness", 1.1)}</bsdf>', 4, "between 0 and 1, got 1.1"),
    (f'<bsdf type="principled">{number("eta", 1.5)}\n{number("specular", 0.5)}</bsdf>', 4, 'together with "eta"'),
    (f'<bsdf type="principled">\n{number("specular", 2)}</bsdf>', 4, "between 0 and 1, got 2"),
    (f'<bsdf type="principled">\n{number("eta", 0)}</bsdf>', 4, "greater than 0"),
    (f'<bsdf type="conductor">\n{word("material", "au")}</bsdf>', 4, 'did you mean "Au"?'),
    (f'<bsdf type="conductor">\n{word("material", "Au")}{number("k", 1)}</bsdf>', 4, "not both"),
    (f'<bsdf type="conductor">\n{rgb("eta", "1 -1 1")}</bsdf>', 4, "must not be negative"),
    (f'<bsdf type="conductor">\n{rgb("specular_reflectance", "1 1 2")}</bsdf>', 4, "between 0 and 1, got 1 1 2"),
    (f'<bsdf type="roughconductor">\n{number("alpha_u", 0.1)}</bsdf>', 3, "must be given together"),
    (f'<bsdf type="roughconductor">{ANISOTROPIC}\n{number("alpha", 0.1)}</bsdf>', 4, "together with"),
    (f'<bsdf type="roughconductor">\n{number("alpha", -0.1)}</bsdf>', 4, "must not be negative"),
    (f'<bsdf type="roughconductor">\n{word("distribution", "phong")}</bsdf>', 4, "one of beckmann, ggx, got"),
    (f'<bsdf type="roughplastic">\n{checks("alpha")}</bsdf>', 4, '"alpha" must be a number'),
    (f'<bsdf type="roughplastic">\n{number("alpha", -1)}</bsdf>', 4, "must not be negative"),
    (f'<bsdf type="plastic">\n{number("int_ior", 0.9)}</bsdf>', 4, "must not be less"),
    (f'<bsdf type="dielectric">\n{number("int_ior", -1)}</bsdf>', 4, "greater than 0"),
    (f'<bsdf type="dielectric">\n{word("int_ior", "watre")}</bsdf>', 4, 'did you mean "water"?'),
    (f'<bsdf type="roughdielectric">\n{number("int_ior", 1.000277)}</bsdf>', 4, "must differ"),
    (f'<bsdf type="diffuse">{checks("reflectance")}\n{rgb("reflectance", "1")}</bsdf>', 4, "given twice"),
    (f'<bsdf type="diffuse">\n{rgb("reflectance", "-1")}</bsdf>', 4, "between 0 and 1"),
    *(
        (f'<bsdf type="twosided">\n<bsdf type="{kind}"/></bsdf>', 4, f'"{kind}" is not supported yet')
        for kind in ("pplastic", "hk", "irawan", "measured", "hair")
    ),
    *(
        (f'<bsdf type="diffuse">\n<texture type="{kind}" name="reflectance"/></bsdf>', 4, "is not supported yet")
        for kind in ("ldrtexture", "wireframe", "gridtexture", "volume")
    ),
    (
        f'<bsdf type="diffuse"><texture type="checkerboard" name="reflectance">\n{checks("color0")}</texture></bsdf>',
        4,
        '"color0" cannot be a texture',
    ),
    (
        '<bsdf type="diffuse"><texture type="mesh_attribute" name="reflectance">\n'
        '<string name="name" value="face_color"/></texture></bsdf>',
        2,
        'the mesh has no attribute "face_color"',
    ),
    (
        '<bsdf type="diffuse"><texture type="mesh_attribute" name="reflectance">\n'
        '<string name="name" value="color"/></texture></bsdf>',
        4,
        'must begin with "vertex_"',
    ),
]


@pytest.mark.parametrize(("text", "line", "message"), ERRORS)
def test_errors_name_file_and_line(tmp_path: Path, text: str, line: int, message: str) -> None:
    with pytest.raises(SceneError, match=re.escape(message)) as caught:
        read(tmp_path, text)
    assert caught.value.line == line


def test_a_thin_principled_is_its_lobes(tmp_path: Path) -> None:
    """A blend of specular ones, diffuse transmission, and Disney's diffuse part without a coat on both sides."""
    values = {"roughness": 0.4, "spec_trans": 0.3, "diff_trans": 1.5, "sheen": 0.2, "eta": 1.3, "spec_tint": 0.1}
    thin = read(tmp_path, plugin("principledthin", "".join(number(*item) for item in values.items())))
    assert isinstance(thin, Blend)
    assert thin.weight == 0.3
    assert isinstance(thin.second, RoughPane)
    assert (thin.second.roughness, thin.second.eta, thin.second.spec_tint) == (0.4, 1.3, 0.1)
    assert isinstance(thin.first, Blend)
    assert thin.first.weight == 0.75
    assert isinstance(thin.first.second, Translucent)
    assert isinstance(thin.first.first, TwoSided)
    front = thin.first.first.front
    assert isinstance(front, Principled)
    assert (front.eta, front.sheen, front.roughness) == (1.0, 0.2, 0.4)
    sheet = read(tmp_path, plugin("difftrans", rgb("transmittance", "0.1 0.2 0.3")))
    assert isinstance(sheet, Translucent)
    assert sheet.transmittance == (0.1, 0.2, 0.3)
