"""The Mitsuba reader against small files: every feature, and every error with its file and line."""

from __future__ import annotations

import re
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from wdpm.scenes import (
    Bitmap,
    Bsdf,
    Diffuse,
    FilterKind,
    Interpolation,
    PixelFilter,
    PointLight,
    Scene,
    SceneError,
    TwoSided,
    Wrap,
    flatten,
    load,
)
from wdpm.scenes.model.bsdfs import walk
from wdpm.scenes.model.textures import Color

LAMP = (
    '<shape type="rectangle"><emitter type="area"><rgb name="radiance" value="1 2 3"/></emitter>'
    '<transform name="to_world"><translate z="9"/></transform></shape>'
)


def write(folder: Path, body: str, name: str = "scene.xml") -> Path:
    file = folder / name
    file.write_text(f'<scene version="3.0.0">\n{body}\n</scene>')
    return file


def read(folder: Path, body: str, **arguments: object) -> Scene:
    return load(write(folder, body + LAMP), **arguments)  # type: ignore[arg-type]


def reflectance(bsdf: Bsdf) -> Color:
    """Of a diffuse material."""
    assert isinstance(bsdf, Diffuse)
    return bsdf.reflectance


def point_lights(scene: Scene) -> list[PointLight]:
    assert all(isinstance(light, PointLight) for light in scene.lights)
    return [light for light in scene.lights if isinstance(light, PointLight)]


def sensor(inside: str) -> str:
    return f'<sensor type="perspective">{inside}</sensor>'


def film(width: int, height: int, inside: str = "") -> str:
    return (
        f'<film type="hdrfilm"><integer name="width" value="{width}"/>'
        f'<integer name="height" value="{height}"/>{inside}</film>'
    )


def test_default_and_definition(tmp_path: Path) -> None:
    body = '<default name="r" value="2"/><shape type="sphere"><float name="radius" value="$r"/></shape>'
    assert abs(np.abs(read(tmp_path, body).meshes[0].vertices).max() - 2.0) < 1e-12
    assert abs(np.abs(read(tmp_path, body, defines={"r": "5"}).meshes[0].vertices).max() - 5.0) < 1e-12


def test_include_alias_and_ref(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    write(
        tmp_path / "sub",
        '<bsdf type="diffuse" id="red"><rgb name="reflectance" value="1 0 0"/></bsdf><alias id="red" as="rot"/>',
        "materials.xml",
    )
    body = '<include filename="sub/materials.xml"/><shape type="cube"><ref id="rot"/></shape>'
    scene = read(tmp_path, body)
    assert reflectance(scene.materials[scene.meshes[0].material].bsdf) == (1.0, 0.0, 0.0)


def test_transforms_apply_in_document_order(tmp_path: Path) -> None:
    steps = '<scale value="2"/><rotate z="1" angle="90"/><translate x="10"/>'
    scene = read(tmp_path, f'<shape type="rectangle"><transform name="to_world">{steps}</transform></shape>')
    # corner (1, -1, 0): scaled (2, -2, 0), turned (2, 2, 0), moved (12, 2, 0)
    np.testing.assert_allclose(scene.meshes[0].vertices[1], [12.0, 2.0, 0.0], atol=1e-12)


def test_matrix_of_nine_and_sixteen_numbers(tmp_path: Path) -> None:
    nine = '<matrix value="0 -1 0 1 0 0 0 0 1"/>'
    sixteen = '<matrix value="0 -1 0 5  1 0 0 0  0 0 1 0  0 0 0 1"/>'
    for matrix, x in ((nine, 0.0), (sixteen, 5.0)):
        scene = read(tmp_path, f'<shape type="rectangle"><transform name="to_world">{matrix}</transform></shape>')
        np.testing.assert_allclose(scene.meshes[0].vertices[1], [1.0 + x, 1.0, 0.0])


def test_older_spellings(tmp_path: Path) -> None:
    body = (
        sensor(
            '<string name="fovAxis" value="y"/><float name="fov" value="30"/><float name="nearClip" value="0.5"/>'
            '<transform name="toWorld"><lookAt origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>'
            '<sampler type="ldsampler"><integer name="sampleCount" value="7"/></sampler>' + film(200, 100)
        )
        + '<integrator type="path"><integer name="maxDepth" value="4"/></integrator>'
    )
    scene = read(tmp_path, body)
    assert (scene.samples, scene.max_depth, scene.camera.near_clip) == (7, 4, 0.5)
    assert scene.camera.fov_x == pytest.approx(2 * np.degrees(np.arctan(2 * np.tan(np.radians(15)))))
    np.testing.assert_allclose(scene.camera.to_world[:3, 2], [0, 0, -1])


@pytest.mark.parametrize(
    ("axis", "expected"),  # as Mitsuba 3.9.1 prints them for 300x200
    [("x", 50.0), ("y", 69.9426), ("diagonal", 42.4117), ("smaller", 69.9426), ("larger", 50.0)],
)
def test_fov_axes(tmp_path: Path, axis: str, expected: float) -> None:
    body = sensor(f'<float name="fov" value="50"/><string name="fov_axis" value="{axis}"/>' + film(300, 200))
    assert read(tmp_path, body).camera.fov_x == pytest.approx(expected, abs=1e-3)


def test_focal_length_and_film_defaults(tmp_path: Path) -> None:
    camera = read(tmp_path, sensor("")).camera
    assert (camera.width, camera.height) == (768, 576)
    assert camera.fov_x == pytest.approx(38.1848, abs=1e-3)
    assert (camera.filter.kind, camera.filter.radius) == (FilterKind.GAUSSIAN, 2.0)
    wide = read(tmp_path, sensor('<string name="focal_length" value="35mm"/>')).camera
    assert wide.fov_x == pytest.approx(52.6225, abs=1e-3)


def test_size_argument_replaces_the_film(tmp_path: Path) -> None:
    body = sensor('<float name="fov" value="50"/><string name="fov_axis" value="y"/>' + film(300, 200))
    camera = read(tmp_path, body, size=(64, 64)).camera
    assert (camera.width, camera.height) == (64, 64)
    assert camera.fov_x == pytest.approx(50.0)


def rfilter(kind: str, inside: str = "") -> str:
    return sensor(film(8, 8, f'<rfilter type="{kind}">{inside}</rfilter>'))


CUBIC = '<float name="B" value="0.2"/><float name="C" value="0.4"/>'


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (rfilter("box"), PixelFilter()),
        (rfilter("box", '<float name="radius" value="1"/>'), PixelFilter(FilterKind.BOX, 1.0)),
        (rfilter("tent"), PixelFilter(FilterKind.TENT, 1.0)),
        (rfilter("tent", '<float name="radius" value="2.5"/>'), PixelFilter(FilterKind.TENT, 2.5)),
        (rfilter("mitchell"), PixelFilter(FilterKind.MITCHELL, 2.0, b=1 / 3, c=1 / 3)),
        (rfilter("mitchell", CUBIC), PixelFilter(FilterKind.MITCHELL, 2.0, b=0.2, c=0.4)),
        (rfilter("catmullrom"), PixelFilter(FilterKind.MITCHELL, 2.0, b=0.0, c=0.5)),
        (rfilter("lanczos"), PixelFilter(FilterKind.LANCZOS, 3.0)),
        (rfilter("lanczos", '<integer name="lobes" value="2"/>'), PixelFilter(FilterKind.LANCZOS, 2.0)),
    ],
)
def test_filters_with_mitsubas_defaults(tmp_path: Path, body: str, expected: PixelFilter) -> None:
    assert read(tmp_path, body).camera.filter == expected


def test_a_film_for_tests_has_defaults_of_its_own(tmp_path: Path) -> None:
    camera = read(tmp_path, sensor('<film type="mfilm"/>')).camera
    assert (camera.width, camera.height, camera.filter) == (1, 1, PixelFilter())


def test_gaussian_filter_is_cut_at_four_deviations(tmp_path: Path) -> None:
    inside = film(8, 8, '<rfilter type="gaussian"><float name="stddev" value="0.7"/></rfilter>')
    found = read(tmp_path, sensor(inside)).camera.filter
    assert (found.stddev, found.radius) == (0.7, pytest.approx(2.8))


@pytest.mark.parametrize(
    ("colour", "expected"),
    [
        ('<rgb name="reflectance" value="0.5"/>', (0.5, 0.5, 0.5)),
        ('<rgb name="reflectance" value="0.1, 0.2 0.3"/>', (0.1, 0.2, 0.3)),
        ('<spectrum name="reflectance" value="0.25"/>', (0.25, 0.25, 0.25)),
        ('<srgb name="reflectance" value="#ff8000"/>', (1.0, 0.2158605, 0.0)),
        ("", (0.5, 0.5, 0.5)),
    ],
)
def test_reflectance(tmp_path: Path, colour: str, expected: tuple[float, float, float]) -> None:
    scene = read(tmp_path, f'<shape type="cube"><bsdf type="diffuse">{colour}</bsdf></shape>')
    assert reflectance(scene.materials[0].bsdf) == pytest.approx(expected, abs=1e-6)


def test_constant_spectrum_of_a_light_is_equal_energy_white(tmp_path: Path) -> None:
    scene = read(tmp_path, '<emitter type="point"><spectrum name="intensity" value="100"/></emitter>')
    assert point_lights(scene)[0].intensity == pytest.approx((120.479, 94.8291, 90.8916))


def test_point_light_by_position_and_by_transform(tmp_path: Path) -> None:
    scene = read(
        tmp_path,
        '<emitter type="point"><point name="position" x="1" y="2" z="3"/>'
        '<rgb name="intensity" value="4 5 6"/></emitter>'
        '<emitter type="point"><transform name="toWorld"><translate value="7 8 9"/></transform></emitter>',
    )
    first, second = point_lights(scene)
    assert (first.position, first.intensity) == ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    assert (second.position, second.intensity) == ((7.0, 8.0, 9.0), (1.0, 1.0, 1.0))


def test_default_material_is_grey_and_black_on_lights(tmp_path: Path) -> None:
    scene = read(tmp_path, '<shape type="cube"/>')
    assert reflectance(scene.materials[scene.meshes[0].material].bsdf) == (0.5, 0.5, 0.5)
    assert reflectance(scene.materials[scene.meshes[1].material].bsdf) == (0.0, 0.0, 0.0)


def test_bitmap(tmp_path: Path) -> None:
    pixels = np.zeros((2, 2, 3), dtype=np.uint8)
    pixels[0, 0] = (255, 128, 0)
    imageio.imwrite(tmp_path / "a.png", pixels)
    texture = (
        '<texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/>'
        '<string name="wrap_mode" value="mirror"/><string name="filter_type" value="nearest"/>'
        '<transform name="to_uv"><scale x="2" y="3"/><translate x="0.5"/></transform>{}</texture>'
    )
    bodies = [f'<shape type="cube"><bsdf type="diffuse">{texture.format(raw)}</bsdf></shape>' for raw in ("", RAW)]
    for body, middle in zip(bodies, (0.2158605, 128 / 255), strict=True):
        bitmap = reflectance(read(tmp_path, body).materials[0].bsdf)
        assert isinstance(bitmap, Bitmap)
        np.testing.assert_allclose(bitmap.pixels[0, 0], [1.0, middle, 0.0], atol=1e-6)
        assert (bitmap.wrap, bitmap.interpolation) == (Wrap.MIRROR, Interpolation.NEAREST)
        # Mitsuba's image begins at v = 0, ours at v = 1
        np.testing.assert_allclose(bitmap.to_uv @ [0.25, 0.25, 1.0], [1.0, 1.0 - 0.75, 1.0])


RAW = '<boolean name="raw" value="true"/>'


def test_shapes_that_share_a_texture_share_one_bitmap(tmp_path: Path) -> None:
    imageio.imwrite(tmp_path / "a.png", np.full((2, 2, 3), 9, dtype=np.uint8))
    body = "".join(
        f'<bsdf type="diffuse" id="b{i}"><texture type="bitmap" name="reflectance">'
        f'<string name="filename" value="a.png"/></texture></bsdf><shape type="cube"><ref id="b{i}"/></shape>'
        for i in range(3)
    )
    flat = flatten(read(tmp_path, body))
    assert len(flat.textures) == 1
    assert flat.materials.texture[:4, 0].tolist() == [0, 0, 0, -1]


def test_ref_of_a_texture_and_twosided(tmp_path: Path) -> None:
    imageio.imwrite(tmp_path / "a.png", np.full((2, 2, 3), 9, dtype=np.uint8))
    body = (
        '<texture type="bitmap" id="t"><string name="filename" value="a.png"/></texture>'
        '<bsdf type="twosided" id="b"><bsdf type="diffuse"><ref name="reflectance" id="t"/></bsdf></bsdf>'
        '<shape type="rectangle"><ref id="b"/></shape>'
    )
    material = read(tmp_path, body).materials[0]
    assert isinstance(material.bsdf, TwoSided)
    assert isinstance(reflectance(material.bsdf.front), Bitmap)


def test_no_sensor_frames_the_scene(tmp_path: Path) -> None:
    scene = read(tmp_path, '<shape type="cube"/>')
    assert any("no sensor" in warning for warning in scene.warnings)


def test_nested_and_foreign_integrators(tmp_path: Path) -> None:
    nested = '<integrator type="aov"><string name="aovs" value="d:depth"/>{}</integrator>'
    inner = '<integrator type="path"><integer name="max_depth" value="3"/></integrator>'
    scene = read(tmp_path, nested.format(inner))
    assert scene.max_depth == 3
    assert any('"aov"' in warning for warning in scene.warnings)
    assert read(tmp_path, '<integrator type="direct"/>').max_depth == 2
    assert read(tmp_path, '<integrator type="path"/>').max_depth is None


# every error: (scene, line of the error, what the message says)
ERRORS = [
    ('\n<shape type="spher"/>', 3, 'unknown shape plugin "spher"; did you mean "sphere"?'),
    (
        '<bsdf type="hair" id="g"/>\n<shape type="cube"><ref id="g"/></shape>',
        2,
        '"hair" is not supported yet',
    ),
    ('<shape type="sphere">\n<float name="radios" value="1"/></shape>', 3, 'did you mean "radius"?'),
    ('<shape type="sphere">\n<float name="radius" value="-1"/></shape>', 3, "greater than 0"),
    ('<shape type="sphere">\n<float name="radius" value="big"/></shape>', 3, "expected numbers"),
    ('<shape type="sphere">\n<float name="radius" value="nan"/></shape>', 3, "expected finite numbers"),
    ('<shape type="cube">\n<ref id="nothing"/></shape>', 3, 'reference to "nothing"'),
    ('<shape type="cube">\n<string name="to_world" value="1"/></shape>', 3, "must be a <transform>"),
    ('<shape type="cube"><transform name="to_world">\n<spin y="1"/></transform></shape>', 3, "unknown element <spin>"),
    ('<shape type="cube"><transform name="to_world">\n<rotate angle="3"/></transform></shape>', 3, "axis is zero"),
    ('<shape type="cube"><transform name="to_world">\n<matrix value="1 2 3"/></transform></shape>', 3, "16 or 9"),
    ('<shape type="cube"><transform name="to_world"><scale x="0"/>\n</transform></shape>', 2, "flattens space"),
    ('<shape type="obj">\n<string name="filename" value="no.obj"/></shape>', 3, 'file "no.obj" not found'),
    ('<shape type="obj"/>', 2, '"filename" is missing'),
    ('<bsdf type="twosided" id="a">\n<ref id="a"/></bsdf>', 3, 'leads back to <bsdf> "a": it would hold itself'),
    (
        '<bsdf type="twosided" id="a">\n<ref id="b"/></bsdf>\n<bsdf type="mask" id="b">\n<ref id="a"/></bsdf>',
        5,
        'leads back to <bsdf> "a": it would hold itself',
    ),
    ('<texture type="scale" id="t">\n<ref id="t"/></texture>', 3, 'leads back to <texture> "t"'),
    ('<shape type="cube"><transform name="to_world"><scale value="1e60"/></transform></shape>', 2, "larger unit"),
    ('<emitter type="collimated"/>', 2, 'emitter plugin "collimated" is not supported yet; supported: area, point'),
    ('<emitter type="area"/>', 2, "must be nested in a shape"),
    ('\n\n<subsurface type="dipole"/>', 4, "<subsurface> is not supported yet"),
    ("<shpe/>", 2, 'unknown element <shpe>; did you mean "shape"?'),
    ('<float name="x" value="1"/>', 2, "does not belong directly into <scene>"),
    ('<sensor type="radiancemeter"/>', 2, '"radiancemeter" is not supported yet'),
    (
        '<sensor type="perspective"><film type="hdrfilm">\n<integer name="width" value="0"/></film></sensor>',
        3,
        "at least 1",
    ),
    (rfilter("sharp"), 2, 'unknown rfilter plugin "sharp"'),
    (rfilter("mitchell", '\n<float name="B" value="1.5"/>'), 3, '"b" must lie between 0 and 1'),
    (rfilter("lanczos", '\n<integer name="lobes" value="0"/>'), 3, '"lobes" must be at least 1'),
    (rfilter("lanczos", '\n<integer name="lobes" value="65"/>'), 2, "it reaches further than 64 pixels"),
    (rfilter("tent", '\n<float name="radius" value="0"/>'), 3, '"radius" must be greater than 0'),
    (rfilter("catmullrom", '\n<float name="radius" value="2"/>'), 3, 'unknown parameter "radius"'),
    ('<sensor type="perspective">\n<float name="fov" value="180"/></sensor>', 3, "between 0 and 180"),
    ('<sensor type="perspective">\n<string name="fov_axis" value="z"/></sensor>', 3, "must be one of x, y,"),
    (
        '<sensor type="perspective"><transform name="to_world"><scale value="2"/></transform></sensor>',
        2,
        "must not scale a sensor",
    ),
    ('<integrator type="path">\n<integer name="max_depth" value="0"/></integrator>', 3, "-1 (no limit) or at least 1"),
    (
        '<shape type="cube"><bsdf type="diffuse">\n<rgb name="reflectance" value="2 0 0"/></bsdf></shape>',
        3,
        "between 0 and 1",
    ),
    ('<shape type="cube"><bsdf type="diffuse">\n<rgb name="reflectance" value="#ffffff"/></bsdf></shape>', 3, "<srgb"),
    ('<shape type="cube"><bsdf type="twosided"/></shape>', 2, "expected one nested bsdf"),
    ('<shape type="cube"><bsdf type="diffuse"/>\n<bsdf type="diffuse"/></shape>', 3, "takes one bsdf, got 2"),
    ('<shape type="cube"><emitter type="area">\n<rgb name="radiance" value="-1"/></emitter></shape>', 3, "negative"),
    ('<bsdf type="diffuse" id="a"/>\n<bsdf type="diffuse" id="a"/>', 3, 'the id "a" is already taken in line 2'),
    ('<default name="size" value="1"/>\n<shape type="$siz"/>', 3, "parameter $siz has no value"),
    ('\n<include filename="none.xml"/>', 3, 'file "none.xml" not found'),
    ('\n<include filename="scene.xml"/>', 3, "does a file include itself?"),
    ("\nsome text", 2, 'text "some text"'),
    ('<shape type="cube"/>\n<shape type=cube/>', 3, "broken XML: not well-formed"),
    ('<shape type="cube">', 3, "broken XML: mismatched tag"),
]


@pytest.mark.parametrize(("body", "line", "message"), ERRORS, ids=[message[:40] for _, _, message in ERRORS])
def test_errors_name_file_and_line(tmp_path: Path, body: str, line: int, message: str) -> None:
    file = write(tmp_path, body)
    with pytest.raises(SceneError, match=re.escape(message)) as caught:
        load(file)
    assert str(caught.value).startswith(f"{file}:{caught.value.line}: ")
    # text is reported where expat gives it out, which may be a line on
    assert caught.value.line in ((line, line + 1) if body == "\nsome text" else (line,))
    assert "\n" not in str(caught.value)


def test_entities_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "bomb.xml"
    file.write_text('<?xml version="1.0"?>\n<!DOCTYPE scene [<!ENTITY a "aaaa">]>\n<scene version="3.0.0"/>')
    with pytest.raises(SceneError, match=r"bomb\.xml:2: document type declarations"):
        load(file)


def test_unused_definition(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match='nothing in the scene uses \\$spq; did you mean "spp"'):
        read(tmp_path, '<default name="spp" value="1"/>', defines={"spq": "3"})


def test_broken_encoding_and_empty_file(tmp_path: Path) -> None:
    for content in (b"", b'<?xml version="1.0" encoding="nonsense"?><scene/>', b"\xff\xfe\x00"):
        file = tmp_path / "broken.xml"
        file.write_bytes(content)
        with pytest.raises(SceneError, match="broken XML"):
            load(file)


TRIANGLE_COUNTS = {"cbox": 36, "bunny": 3 * 69451 + 12, "sibenik": 75284 + 4, "sponza": 66445 + 2}


@pytest.mark.shared
@pytest.mark.parametrize("name", TRIANGLE_COUNTS)
def test_reference_scenes(scenes_dir: Path, name: str) -> None:
    scene = load(scenes_dir / name / "scene.xml", size=(256, 256), defines={"spp": "64"})
    flat = flatten(scene)
    assert len(flat.triangles) + sum(flat.dropped.values()) == TRIANGLE_COUNTS[name]
    assert (scene.samples, scene.camera.width, scene.warnings) == (64, 256, ())


BEYOND_DIFFUSE = {
    "water-caustic": {"Dielectric"},
    "veach-mis": {"Conductor"},
    "box-caustic": {"Conductor", "Dielectric"},
    "glass-cbox": {"Conductor", "Dielectric"},
    "materials": {"Conductor", "Dielectric", "Plastic", "Principled", "Blend", "Mask"},
    "fog-cbox": {"Null"},
    "envmap": {"Conductor", "Dielectric"},
}


@pytest.mark.shared
@pytest.mark.parametrize("name", BEYOND_DIFFUSE)
def test_scenes_beyond_diffuse(scenes_dir: Path, name: str) -> None:
    scene = load(scenes_dir / name / "scene.xml")
    kinds = {type(node).__name__ for material in scene.materials for node in walk(material.bsdf)}
    assert kinds - {"Diffuse", "TwoSided"} == BEYOND_DIFFUSE[name]
