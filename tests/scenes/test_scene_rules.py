"""What becomes of that which a Mitsuba file says and nobody knows: warnings, errors, and the nearest thing known."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from mitsuba_xml import read_body as read

from wdpm.scenes import SceneError, load
from wdpm.scenes.mitsuba.serialized import read_serialized
from wdpm.scenes.mitsuba.supported import KNOWN, supported
from wdpm.scenes.model.bsdfs import Blend, Bsdf, BumpMap, Conductor, Diffuse, Distribution, Plastic
from wdpm.scenes.model.lights import Environment

CUBE = '<shape type="cube"/>'
LAMP = '<emitter type="point"/>'


def bsdf(folder: Path, text: str, *, lenient: bool = False) -> tuple[Bsdf, tuple[str, ...]]:
    scene = read(folder, f'<shape type="cube">{text}</shape>', version="0.5.0", lenient=lenient)
    return scene.materials[0].bsdf, scene.warnings


# what cannot change the picture: (body, what the warning says)
HARMLESS = [
    ('<integrator type="path_guiding_integrator"><integer name="budget" value="3"/></integrator>', "path_guiding"),
    ('<integrator type="path"><boolean name="use_path_guiding" value="true"/></integrator>', '"use_path_guiding"'),
    ('<integrator type="guided"><integrator type="path"/></integrator>', 'unknown integrator plugin "guided"'),
    ('<integrator type="depth"/>', '"depth" is not supported yet'),
    (
        '<sensor type="perspective"><sampler type="zsobol"><integer name="sample_count" value="7"/></sampler></sensor>',
        'unknown sampler plugin "zsobol"',
    ),
    ('<sensor type="perspective"><sampler type="sobol"><integer name="x" value="7"/></sampler></sensor>', '"x"'),
    ('<shape type="cube"><bsdf type="dielectric"><float name="alpha" value="0.1"/></bsdf></shape>', "alpha is ignored"),
]


@pytest.mark.parametrize(("body", "words"), HARMLESS)
def test_what_cannot_change_the_picture_is_a_warning(tmp_path: Path, body: str, words: str) -> None:
    scene = read(tmp_path, CUBE + body)
    assert sum(words in warning for warning in scene.warnings) == 1


def test_an_unknown_integrators_depth_and_a_samplers_count_hold(tmp_path: Path) -> None:
    depth = '<integrator type="guided"><integer name="max_depth" value="5"/></integrator>'
    assert read(tmp_path, CUBE + depth).max_depth == 5
    assert read(tmp_path, CUBE + HARMLESS[4][0]).samples == 7


# what changes the picture: (body, what the lenient reader says; it goes on)
CHANGES = [
    ('<shape type="hair"/>', 'shape plugin "hair" is not supported yet: it is left out'),
    ('<emitter type="collimated"/>', 'emitter plugin "collimated" is not supported yet: it is left out'),
    ('<shape type="cube"><bsdf type="hair"/></shape>', 'it is taken for "diffuse"'),
    (
        '<shape type="cube"><bsdf type="velvet"><float name="pile" value="1"/></bsdf></shape>',
        'unknown parameter "pile"',
    ),
    (
        '<shape type="cube"><bsdf type="roughconductor"><texture type="wood" name="alpha"/></bsdf></shape>',
        'unknown texture plugin "wood": it is left out',
    ),
    ('<integrator type="path"><boolean name="hide_emitters" value="true"/></integrator>', "lights stay visible"),
    ('<shape type="cube"><float name="wobble" value="1"/></shape>', 'unknown parameter "wobble": it is ignored'),
    ('<sensor type="perspective"><film type="specfilm"/></sensor>', 'it is taken for "hdrfilm"'),
    ('<sensor type="spherical"/>', 'it is taken for "perspective"'),
    ('<subsurface type="dipole"/>', "it is left out"),
    (
        '<shape type="cube"><bsdf type="roughconductor"><string name="distribution" value="phong"/></bsdf></shape>',
        'it is taken for "beckmann"',
    ),
]


@pytest.mark.parametrize(("body", "words"), CHANGES)
def test_what_changes_the_picture_is_an_error_unless_lenient(tmp_path: Path, body: str, words: str) -> None:
    with pytest.raises(SceneError) as caught:
        read(tmp_path, CUBE + body)
    assert caught.value.line == 2
    scene = read(tmp_path, CUBE + body, lenient=True)
    (told,) = [warning for warning in scene.warnings if words in warning]
    assert told.startswith("line 2: ")
    assert told.endswith("(--lenient)")


def test_a_texture_left_out_leaves_the_default(tmp_path: Path) -> None:
    found, _ = bsdf(tmp_path, '<bsdf type="roughconductor"><texture type="wood" name="alpha"/></bsdf>', lenient=True)
    assert isinstance(found, Conductor)
    assert found.alpha_u == found.alpha_v == 0.1


def refused(folder: Path, body: str, *, lenient: bool) -> SceneError | None:
    """Why a scene cannot be read; None if it can."""
    try:
        read(folder, body, lenient=lenient)
    except SceneError as error:
        return error
    return None


@pytest.mark.parametrize("category", [category for category in KNOWN if category not in ("sampler", "integrator")])
def test_every_plugin_of_mitsuba_is_read_or_refused_and_never_breaks(tmp_path: Path, category: str) -> None:
    """Without any parameter, wherever it may stand, by either reader: a scene, or one line for a person."""
    inside = {
        "bsdf": '<shape type="cube">{}</shape>',
        "texture": '<shape type="cube"><bsdf type="diffuse">{}</bsdf></shape>',
        "medium": '<shape type="cube">{}</shape>',
        "phase": '<shape type="cube"><medium type="homogeneous" name="interior">{}</medium></shape>',
        "volume": '<shape type="cube"><medium type="homogeneous" name="interior">{}</medium></shape>',
        "film": '<sensor type="perspective">{}</sensor>',
        "rfilter": '<sensor type="perspective"><film type="hdrfilm">{}</film></sensor>',
    }
    names = {"texture": ' name="reflectance"', "medium": ' name="interior"', "volume": ' name="albedo"'}
    for plugin_type in (*supported(category), *KNOWN[category]):
        body = CUBE + inside.get(category, "{}").format(f'<{category} type="{plugin_type}"{names.get(category, "")}/>')
        for lenient in (False, True):
            refusal = refused(tmp_path, body, lenient=lenient)
            if refusal is not None:
                assert refusal.line == 2
                assert "\n" not in str(refusal)
                assert plugin_type in supported(category) or not lenient


def test_a_phong_highlight_reflects_what_it_says(tmp_path: Path) -> None:
    found, warnings = bsdf(
        tmp_path,
        '<bsdf type="phong"><float name="exponent" value="48"/>'
        '<rgb name="diffuseReflectance" value="0.3 0.2 0.1"/></bsdf>',
    )
    assert isinstance(found, Blend)
    assert isinstance(found.first, Diffuse)
    assert isinstance(found.second, Conductor)
    assert found.second.alpha_u == found.second.alpha_v == pytest.approx(0.2)
    assert found.second.distribution is Distribution.BECKMANN
    weight = found.weight
    assert isinstance(weight, float)
    np.testing.assert_allclose(np.multiply(found.first.reflectance, 1 - weight), [0.3, 0.2, 0.1])
    np.testing.assert_allclose(np.multiply(found.second.specular_reflectance, weight), 0.2)
    assert any('bsdf "phong": taken for a mixture' in warning for warning in warnings)


def test_ward_has_two_roughnesses_and_is_lowered_to_what_it_receives(tmp_path: Path) -> None:
    text = (
        '<bsdf type="ward"><float name="alphaU" value="0.05"/><float name="alphaV" value="0.3"/>'
        '<rgb name="diffuseReflectance" value="0.9"/><rgb name="specularReflectance" value="0.6"/></bsdf>'
    )
    found, _ = bsdf(tmp_path, text)
    assert isinstance(found, Blend)
    assert isinstance(found.first, Diffuse)
    assert isinstance(found.second, Conductor)
    assert (found.second.alpha_u, found.second.alpha_v) == (0.05, 0.3)
    assert isinstance(found.weight, float)
    np.testing.assert_allclose(np.multiply(found.first.reflectance, 1 - found.weight), 0.9 / 1.5)
    np.testing.assert_allclose(np.multiply(found.second.specular_reflectance, found.weight), 0.6 / 1.5)


def test_a_coat_over_a_diffuse_surface_is_plastic(tmp_path: Path) -> None:
    diffuse = '<bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf>'
    smooth, _ = bsdf(tmp_path, f'<bsdf type="coating"><float name="intIOR" value="1.7"/>{diffuse}</bsdf>')
    rough, _ = bsdf(tmp_path, f'<bsdf type="roughcoating"><float name="alpha" value="0.3"/>{diffuse}</bsdf>')
    assert isinstance(smooth, Plastic)
    assert isinstance(rough, Plastic)
    assert (smooth.alpha, rough.alpha) == (0.0, 0.3)
    assert smooth.eta == pytest.approx(1.7 / 1.000277)
    assert smooth.nonlinear
    assert smooth.diffuse_reflectance == (0.3, 0.3, 0.3)


def test_a_coat_over_metal_is_left_away_by_the_lenient_alone(tmp_path: Path) -> None:
    text = '<bsdf type="coating"><bsdf type="conductor"/></bsdf>'
    with pytest.raises(SceneError, match="a coat over anything but a diffuse surface"):
        bsdf(tmp_path, text)
    found, warnings = bsdf(tmp_path, text, lenient=True)
    assert isinstance(found, Conductor)
    assert any("the coat is left away" in warning for warning in warnings)


@pytest.mark.parametrize(("weights", "shares"), [("0.2, 0.3, 0.5", (0.2, 0.3, 0.5)), ("0.2 0.2 0.2", (0.2,) * 3)])
def test_a_mixture_has_its_weights(tmp_path: Path, weights: str, shares: tuple[float, ...]) -> None:
    parts = "".join(f'<bsdf type="diffuse"><rgb name="reflectance" value="0.{i}"/></bsdf>' for i in (1, 2, 3))
    found, _ = bsdf(tmp_path, f'<bsdf type="mixturebsdf"><string name="weights" value="{weights}"/>{parts}</bsdf>')
    expected = sum(share * value for share, value in zip(shares, (0.1, 0.2, 0.3), strict=True))
    assert albedo(found) == pytest.approx(expected)


def albedo(node: Bsdf) -> float:
    """Of blends of grey diffuse surfaces."""
    if isinstance(node, Blend):
        assert isinstance(node.weight, float)
        return albedo(node.first) * (1 - node.weight) + albedo(node.second) * node.weight
    assert isinstance(node, Diffuse)
    assert isinstance(node.reflectance, tuple)
    return node.reflectance[0]


def test_files_before_0_5_call_a_bump_map_bump(tmp_path: Path) -> None:
    nested = '<texture type="checkerboard"/><bsdf type="diffuse"/>'
    body = f'<shape type="rectangle"><bsdf type="bump">{nested}</bsdf></shape>'
    assert isinstance(read(tmp_path, body, version="0.4.1").materials[0].bsdf, BumpMap)
    with pytest.raises(SceneError, match='unknown bsdf plugin "bump"'):
        read(tmp_path, body, version="0.5.0")


def test_files_before_0_4_have_cameras_and_luminaires(tmp_path: Path) -> None:
    body = (
        '<camera type="perspective"><float name="fov" value="40"/>'
        '<transform name="toWorld"><translate x="2"/></transform>'
        '<film type="exrfilm"><integer name="width" value="200"/><integer name="height" value="100"/>'
        '<boolean name="alpha" value="true"/></film></camera>'
        '<luminaire type="constant"><rgb name="intensity" value="2 3 4"/></luminaire>'
    )
    scene = read(tmp_path, body, version="0.3.0")
    assert len(scene.lights) == 1
    np.testing.assert_allclose(scene.camera.to_world[:3, 0], [-1, 0, 0])
    np.testing.assert_allclose(scene.camera.to_world[:3, 3], [2, 0, 0])
    # 40 degrees of the smaller side, which is the height
    half = np.tan(np.radians(20.0)) * 2
    assert scene.camera.fov_x == pytest.approx(np.degrees(2 * np.arctan(half)))


def test_the_suns_aperture_holds_in_old_files(tmp_path: Path) -> None:
    aperture = '<emitter type="sun"><float name="{}" value="{}"/></emitter>'
    wide = read(tmp_path, CUBE + aperture.format("sunAperture", 5.0), version="0.6.0").lights[0]
    narrow = read(tmp_path, CUBE + '<emitter type="sun"/>', version="0.6.0").lights[0]
    assert isinstance(wide, Environment)
    assert isinstance(narrow, Environment)
    # (5 / 0.5358)² = 87 times the solid angle, in whole pixels
    assert 40 < np.mean(wide.pixels > 0) / np.mean(narrow.pixels > 0) < 120


def test_a_serialized_mesh_that_says_no_precision_is_single(tmp_path: Path) -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    normals = np.tile(np.array([[0, 0, 1]], "<f4"), (3, 1))
    uvs = np.zeros((3, 2), "<f4")
    faces = np.array([[0, 1, 2]], "<u4")
    data = struct.pack("<IQQ", 0x103, 3, 1) + b"".join(a.tobytes() for a in (vertices, normals, uvs, faces))
    file = tmp_path / "m.serialized"
    file.write_bytes(struct.pack("<HH", 0x041C, 3) + zlib.compress(data) + struct.pack("<II", 0, 1))
    mesh = read_serialized(file, 0)
    np.testing.assert_array_equal(mesh.vertices, vertices)
    assert mesh.normals is not None


def test_lenient_is_for_load_too(tmp_path: Path) -> None:
    file = tmp_path / "s.xml"
    file.write_text(f'<scene version="3.0.0">{CUBE}{LAMP}<shape type="hair"/></scene>')
    with pytest.raises(SceneError):
        load(file)
    assert any("--lenient" in warning for warning in load(file, lenient=True).warnings)
