"""Sensors of scene files: lenses, parallel projection, crop windows, media; errors with file and line."""

from __future__ import annotations

import json
import math
import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mitsuba_xml import number, read_body

from wdpm.scenes.errors import SceneError
from wdpm.scenes.gltf.read import read_gltf

LIT_FLOOR = '<shape type="rectangle"/><emitter type="constant"/>'

read = partial(read_body, after=LIT_FLOOR)


def film(inside: str) -> str:
    return (
        '<film type="hdrfilm"><integer name="width" value="200"/><integer name="height" value="100"/>'
        + inside
        + "</film>"
    )


def window(x: int, y: int, width: int, height: int) -> str:
    values = {"crop_offset_x": x, "crop_offset_y": y, "crop_width": width, "crop_height": height}
    return "".join(f'<integer name="{name}" value="{value}"/>' for name, value in values.items())


def sensor(kind: str, inside: str = "") -> str:
    return f'<sensor type="{kind}">{inside}</sensor>'


def test_thin_lens(tmp_path: Path) -> None:
    inside = number("aperture_radius", 0.25) + number("focus_distance", 6.4) + number("fov", 30)
    camera = read(tmp_path, sensor("thinlens", inside)).camera
    assert (camera.aperture_radius, camera.focus_distance) == (0.25, 6.4)
    assert camera.fov_x == pytest.approx(30.0)
    assert not camera.orthographic


def test_thin_lens_focuses_on_the_far_clip_by_default(tmp_path: Path) -> None:
    inside = number("apertureRadius", 0.25) + number("farClip", 50)
    assert read(tmp_path, sensor("thinlens", inside)).camera.focus_distance == 50.0


def test_perspective_has_everything_in_focus(tmp_path: Path) -> None:
    scene = read(tmp_path, sensor("perspective", number("focus_distance", 3)))
    assert scene.camera.aperture_radius == 0.0
    assert scene.warnings == ('sensor "perspective": focus_distance is ignored: everything is in focus',)


def test_orthographic_keeps_the_scale(tmp_path: Path) -> None:
    place = '<transform name="to_world"><scale x="3" y="2"/><rotate y="1" angle="90"/></transform>'
    camera = read(tmp_path, sensor("orthographic", place)).camera
    assert camera.orthographic
    np.testing.assert_allclose(np.linalg.norm(camera.to_world[:3, :3], axis=0), [3.0, 2.0, 1.0])


def test_crop_window(tmp_path: Path) -> None:
    body = sensor(
        "perspective", film(window(20, 10, 50, 30)) + number("fov", 40) + '<string name="fov_axis" value="y"/>'
    )
    camera = read(tmp_path, body).camera
    assert (camera.width, camera.height) == (50, 30)
    assert camera.crop == (20, 10, 50, 30)
    assert camera.full_size == (200, 100)
    # the field of view is the whole image's
    assert math.tan(math.radians(camera.fov_x) / 2) == pytest.approx(2.0 * math.tan(math.radians(20.0)))


def test_crop_window_of_the_whole_image_is_none(tmp_path: Path) -> None:
    camera = read(tmp_path, sensor("perspective", film(window(0, 0, 200, 100)))).camera
    assert camera.crop is None
    assert camera.full_size is None


@pytest.mark.parametrize(
    ("size", "expected"),
    [((400, 200), (40, 20, 100, 60)), ((100, 50), (10, 5, 25, 15)), ((2, 1), (0, 0, 1, 1))],
)
def test_crop_window_keeps_its_share_of_another_size(
    tmp_path: Path, size: tuple[int, int], expected: tuple[int, int, int, int]
) -> None:
    camera = read(tmp_path, sensor("perspective", film(window(20, 10, 50, 30))), size=size).camera
    assert camera.crop == expected
    assert camera.full_size == size
    assert (camera.width, camera.height) == expected[2:]


def test_sensor_in_a_medium(tmp_path: Path) -> None:
    body = '<medium type="homogeneous" id="other"/><medium type="homogeneous" id="fog"/>'
    shape = '<shape type="cube"><ref name="interior" id="other"/></shape>'
    scene = read(tmp_path, body + shape + sensor("perspective", '<ref name="medium" id="fog"/>'))
    assert scene.camera.medium == 1
    assert [medium.name for medium in scene.media] == ["other", "fog"]


LENS = number("aperture_radius", 0.1)
ERRORS = (
    (sensor("thinlens"), 2, 'the parameter "aperture_radius" is missing'),
    (sensor("thinlens", "\n" + number("aperture_radius", -1)), 3, '"aperture_radius" must not be negative'),
    (sensor("thinlens", LENS + "\n" + number("focus_distance", 0)), 3, '"focus_distance" must be greater than 0'),
    (sensor("thinlens", LENS + '\n<transform name="to_world"><scale value="2"/></transform>'), 3, "must not scale"),
    (sensor("thinlens", LENS + "\n" + number("principal_point_offset_x", 1)), 3, "unknown parameter"),
    (sensor("orthographic", "\n" + number("fov", 30)), 3, 'unknown parameter "fov"'),
    (sensor("orthographic", '\n<transform name="to_world"><scale x="0"/></transform>'), 3, "must not shear or flatten"),
    (sensor("perspective", "\n" + film("\n" + window(180, 0, 50, 30))), 4, "must lie inside of 200x100 pixels"),
    (sensor("perspective", film("\n" + window(0, 0, 0, 30))), 3, "must lie inside of 200x100 pixels"),
    (sensor("perspective", '\n<ref id="fog"/>'), 3, 'reference to "fog", which no element has'),
    (sensor("perspective_rdist"), 2, "supported: perspective, thinlens, orthographic"),
)


@pytest.mark.parametrize(("body", "line", "message"), ERRORS)
def test_errors_name_file_and_line(tmp_path: Path, body: str, line: int, message: str) -> None:
    with pytest.raises(SceneError, match=re.escape(message)) as caught:
        read(tmp_path, body)
    assert caught.value.line == line
    assert caught.value.file == tmp_path / "scene.xml"


def test_crop_and_fov_agree_with_mitsuba(tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    inside = film(window(20, 10, 50, 30)) + number("fov", 40) + '<string name="fov_axis" value="diagonal"/>'
    camera = read(tmp_path, sensor("perspective", inside)).camera
    theirs = mi.load_string(sensor("perspective", inside).replace("<sensor ", '<sensor version="3.0.0" ', 1))
    for x, y in ((0.0, 0.0), (1.0, 0.25)):
        ray, _ = theirs.sample_ray(0.0, 0.0, mi.Point2f(x, y), mi.Point2f(0.5, 0.5))
        direction = np.array(ray.d) / ray.d[2]
        assert camera.crop is not None
        assert camera.full_size is not None
        half = math.tan(math.radians(camera.fov_x) / 2.0)
        at_x = (camera.crop[0] + x * camera.width) / camera.full_size[0]
        at_y = (camera.crop[1] + y * camera.height) / camera.full_size[1]
        expected = [half * (1.0 - 2.0 * at_x), half * 0.5 * (1.0 - 2.0 * at_y), 1.0]  # +x is to the left
        np.testing.assert_allclose(direction, expected, atol=1e-5)


def test_orthographic_image_agrees_with_mitsuba(tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    inside = film("") + '<transform name="to_world"><scale x="3" y="2"/><translate z="7"/></transform>'
    camera = read(tmp_path, sensor("orthographic", inside)).camera
    theirs = mi.load_string(sensor("orthographic", inside).replace("<sensor ", '<sensor version="3.0.0" ', 1))
    ray, _ = theirs.sample_ray(0.0, 0.0, mi.Point2f(0.0, 0.0), mi.Point2f(0.5, 0.5))
    # half the image is one x axis wide and height / width of a y axis high
    corner = camera.to_world @ [1.0, camera.height / camera.width, camera.near_clip, 1.0]
    np.testing.assert_allclose(np.array(ray.o), corner[:3], atol=1e-5)


def gltf(folder: Path, camera: dict[str, Any]) -> Path:
    file = folder / "scene.gltf"
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "data:application/octet-stream;base64," + "A" * 48, "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "cameras": [camera],
        "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0, 0, 5], "scale": [2, 2, 2]}],
    }
    file.write_text(json.dumps(document))
    return file


def test_gltf_orthographic_camera(tmp_path: Path) -> None:
    values = {"xmag": 3.0, "ymag": 1.5, "znear": 0.0, "zfar": 20.0}
    file = gltf(tmp_path, {"type": "orthographic", "orthographic": values})
    camera = read_gltf(file).camera
    assert camera.orthographic
    assert (camera.width, camera.height) == (1024, 512)
    assert (camera.near_clip, camera.far_clip) == (0.0, 20.0)
    np.testing.assert_allclose(camera.to_world[:3, :3], np.diag([-3.0, 3.0, -1.0]))
    square = read_gltf(file, (64, 64)).camera
    np.testing.assert_allclose(square.to_world[0, 0], -1.5)


def test_gltf_camera_errors(tmp_path: Path) -> None:
    broken = gltf(
        tmp_path, {"type": "orthographic", "orthographic": {"xmag": 1.0, "ymag": 1.0, "znear": 2.0, "zfar": 1.0}}
    )
    with pytest.raises(SceneError, match="xmag, ymag, znear or zfar is missing or out of range"):
        read_gltf(broken)
    with pytest.raises(SceneError, match='type "fisheye" does not exist'):
        read_gltf(gltf(tmp_path, {"type": "fisheye"}))


@pytest.mark.parametrize(
    ("inside", "exposure"),
    [
        ("", 0.0),
        (number("exposure", -2.5), -2.5),
        ('<string name="tonemapMethod" value="reinhard"/>', None),
    ],
)
def test_exposure_of_old_films(tmp_path: Path, inside: str, exposure: float | None) -> None:
    assert read(tmp_path, sensor("perspective", f'<film type="ldrfilm">{inside}</film>')).exposure == exposure


def test_an_exposure_that_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"scene.xml:2: .*exposure.* must be stops between -64 and 64"):
        read(tmp_path, sensor("perspective", f'<film type="ldrfilm">{number("exposure", 1e4)}</film>'))
