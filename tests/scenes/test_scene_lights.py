"""Lights of scene files: parameters, errors with file and line, and the same values as Mitsuba's."""

from __future__ import annotations

import json
import math
import re
from functools import partial
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import OpenEXR
import pytest
from mitsuba_xml import emitter, number, read_body
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.gltf.read import read_gltf
from wdpm.scenes.mitsuba import sky
from wdpm.scenes.model.lights import DirectionalLight, Environment, PointLight, SpotLight
from wdpm.scenes.model.scene import Scene
from wdpm.scenes.model.textures import Bitmap, Checkerboard

FLOOR = '<shape type="rectangle"/>'
SLIDE = '<texture type="checkerboard" name="irradiance"/>'
WIDE = '<transform name="to_world"><scale x="2"/></transform>'

read = partial(read_body, after=FLOOR)


def write_exr(file: Path, pixels: NDArray[np.float32]) -> None:
    channels = {name: np.ascontiguousarray(pixels[:, :, index]) for index, name in enumerate("RGB")}
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, channels) as image:
        image.write(str(file))


def only_environment(scene: Scene) -> Environment:
    (light,) = scene.lights
    assert isinstance(light, Environment)
    return light


def radiance(environment: Environment, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bilinear lookup as Environment describes it: columns centred, the first and last row at the poles."""
    local = directions @ environment.to_world[:3, :3]
    rows, columns = environment.pixels.shape[:2]
    x = np.arctan2(local[:, 0], -local[:, 2]) / (2.0 * np.pi) * columns - 0.5
    y = np.arccos(np.clip(local[:, 1], -1.0, 1.0)) / np.pi * (rows - 1)
    column, row = np.floor(x).astype(int), np.minimum(np.floor(y).astype(int), rows - 2)
    total = np.zeros((len(directions), 3))
    for right in (0, 1):
        for down in (0, 1):
            weight = np.abs(1 - right - (x - column)) * np.abs(1 - down - (y - row))
            total += weight[:, None] * environment.pixels[row + down, (column + right) % columns]
    return total


def unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_spot(tmp_path: Path) -> None:
    place = '<transform name="to_world"><lookat origin="0 0 5" target="0 0 0" up="0 1 0"/></transform>'
    body = emitter("spot", f'{place}<rgb name="intensity" value="1 2 3"/>{number("cutoff_angle", 40)}')
    (light,) = read(tmp_path, body).lights
    assert isinstance(light, SpotLight)
    assert (light.intensity, light.cutoff_angle, light.beam_width) == ((1.0, 2.0, 3.0), 40.0, 30.0)
    np.testing.assert_allclose(light.to_world[:3, 2], [0.0, 0.0, -1.0])
    np.testing.assert_allclose(light.to_world[:3, 3], [0.0, 0.0, 5.0])


def test_spot_in_older_spelling_with_a_texture(tmp_path: Path) -> None:
    imageio.imwrite(tmp_path / "slide.png", np.full((2, 2, 3), 255, np.uint8))
    texture = '<texture type="bitmap" name="texture"><string name="filename" value="slide.png"/></texture>'
    body = emitter("spot", number("cutoffAngle", 30) + number("beamWidth", 10) + texture)
    (light,) = read(tmp_path, body, "0.6.0").lights
    assert isinstance(light, SpotLight)
    assert isinstance(light.texture, Bitmap)
    assert (light.cutoff_angle, light.beam_width) == (30.0, 10.0)


def test_directional_by_vector_and_by_transform(tmp_path: Path) -> None:
    by_vector = emitter("directional", '<vector name="direction" value="0 -2 0"/>' + number("irradiance", 3))
    turn = '<transform name="to_world"><rotate x="1" angle="90"/></transform>'
    lights = read(tmp_path, by_vector + emitter("directional", turn)).lights
    first, second = lights
    assert isinstance(first, DirectionalLight)
    assert isinstance(second, DirectionalLight)
    assert (first.direction, first.irradiance) == ((0.0, -1.0, 0.0), (3.0, 3.0, 3.0))
    np.testing.assert_allclose(second.direction, [0.0, -1.0, 0.0], atol=1e-15)


def test_area_light_with_a_texture(tmp_path: Path) -> None:
    board = '<texture type="checkerboard" name="radiance"><rgb name="color0" value="9 8 7"/></texture>'
    scene = read(tmp_path, f'<shape type="rectangle">{emitter("area", board)}</shape>')
    assert isinstance(scene.meshes[0].emission, Checkerboard)
    assert scene.meshes[0].emission.color0 == (9.0, 8.0, 7.0)


def test_constant_environment(tmp_path: Path) -> None:
    environment = only_environment(read(tmp_path, emitter("constant", '<rgb name="radiance" value="1 2 3"/>')))
    assert environment.constant
    np.testing.assert_array_equal(environment.pixels, [[[1.0, 2.0, 3.0]]])


def test_point_light_in_a_medium(tmp_path: Path) -> None:
    body = '<medium type="homogeneous" id="air"/>' + emitter("point", '<ref id="air"/>')
    scene = read(tmp_path, body)
    (light,) = scene.lights
    assert isinstance(light, PointLight)
    assert light.medium == 0
    assert scene.media[0].name == "air"


def test_environment_map_of_8_bits_is_decoded_and_scaled(tmp_path: Path) -> None:
    imageio.imwrite(tmp_path / "sky.png", np.full((2, 4, 3), 188, np.uint8))
    body = emitter("envmap", '<string name="filename" value="sky.png"/>' + number("scale", 2))
    np.testing.assert_allclose(only_environment(read(tmp_path, body)).pixels, 1.0, atol=0.01)


def test_environment_map_in_radiance_s_format(tmp_path: Path) -> None:
    pixels = np.full((2, 8, 4), (128, 64, 32, 130), np.uint8)  # mantissas over 256, times 2 to the power of 130 - 128
    (tmp_path / "sky.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 8\n" + pixels.tobytes())
    body = emitter("envmap", '<string name="filename" value="sky.hdr"/>')
    expected = np.broadcast_to([2.0, 1.0, 0.5], (3, 8, 3))
    np.testing.assert_array_equal(only_environment(read(tmp_path, body)).pixels, expected)
    (tmp_path / "sky.hdr").write_bytes(b"no picture")
    with pytest.raises(SceneError, match="not a Radiance picture"):
        read(tmp_path, body)


def test_negative_pixels_of_an_environment_map_are_told(tmp_path: Path) -> None:
    write_exr(tmp_path / "sky.exr", np.array([[[-1.0] * 3, [1.0] * 3]] * 2, np.float32))
    scene = read(tmp_path, emitter("envmap", '<string name="filename" value="sky.exr"/>'))
    assert only_environment(scene).pixels.min() == 0.0
    assert "negative pixels of sky.exr are taken as black" in scene.warnings[0]


ERRORS = (
    (emitter("spot", "\n" + number("cutoff_angle", 0)), 3, '"cutoff_angle" must lie between 0 and 180'),
    (emitter("spot", "\n" + number("beam_width", 21)), 3, '"beam_width" must lie between 0 and cutoff_angle (20'),
    (emitter("spot", '\n<transform name="to_world"><scale x="2"/></transform>'), 3, "must be a rotation"),
    (emitter("directional", '\n<vector name="direction" value="0 0 0"/>'), 3, '"direction" is zero'),
    (emitter("directional", '\n<rgb name="irradiance" value="-1 0 0"/>'), 3, "must not be negative"),
    (emitter("constant") + "\n" + emitter("sunsky"), 3, 'one environment, and line 2 has emitter "constant"'),
    (emitter("envmap", '\n<string name="filename" value="none.exr"/>'), 3, 'file "none.exr" not found'),
    (emitter("envmap"), 2, 'the parameter "filename" is missing'),
    (emitter("sunsky", "\n" + number("turbidity", 11)), 3, '"turbidity" must lie between 1 and 10'),
    (emitter("sunsky", "\n" + number("sun_aperture", 90)), 3, '"sun_aperture" must lie between'),
    (
        emitter("sunsky", '<vector name="sun_direction" value="0 0 1"/>\n' + number("hour", 3)),
        3,
        "cannot both be given",
    ),
    (emitter("sunsky", "\n" + number("stretch", 2)), 3, 'unknown parameter "stretch"'),
    (emitter("collimated"), 2, '"collimated" is not supported yet; supported: area, point, spot'),
    (emitter("projector", number("scale", -1)), 2, '"scale" must not be negative'),
    (emitter("projector", number("fov", 180)), 2, '"fov" must lie between 0 and 180 degrees'),
    (emitter("projector", SLIDE), 2, '"irradiance" must be a bitmap, not a checkerboard'),
    (emitter("projector", WIDE), 2, '"to_world" must not scale an emitter'),
    (emitter("spot", "\n" + number("cutof_angle", 9)), 3, 'did you mean "cutoff_angle"?'),
    (f'<shape type="cube">\n{emitter("spot")}</shape>', 3, 'a shape takes an emitter "area"'),
    (emitter("area"), 2, 'emitter "area" must be nested in a shape'),
    (f'<shape type="cube">\n{emitter("directionalarea")}</shape>', 3, '"directionalarea" is not supported yet'),
)


@pytest.mark.parametrize(("body", "line", "message"), ERRORS)
def test_errors_name_file_and_line(tmp_path: Path, body: str, line: int, message: str) -> None:
    with pytest.raises(SceneError, match=re.escape(message)) as caught:
        read(tmp_path, body)
    assert caught.value.line == line
    assert caught.value.file == tmp_path / "scene.xml"


def test_sun_keeps_its_energy_on_the_map() -> None:
    for direction in ((0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (-0.3, 0.85, 0.43)):
        x, y, z = unit(np.array([direction]))[0]
        light = sky.Daylight((x, y, z), sky_scale=0.0)
        pixels = sky.sky_map(light).astype(np.float64)
        rows, columns = pixels.shape[:2]
        # the integral of a bilinear lookup over a fine grid of each row's neighbourhood
        theta = np.pi * (np.arange(64 * (rows - 1)) + 0.5) / (64 * (rows - 1))
        place = theta / np.pi * (rows - 1)
        row = np.floor(place).astype(int)
        share = (place - row)[:, None]
        across = pixels.sum(axis=1) * (2.0 * np.pi / columns)
        values = (1.0 - share) * across[row] + share * across[row + 1]
        energy = (values * np.sin(theta)[:, None]).sum(axis=0) * np.pi / len(theta)
        solid_angle = 2.0 * np.pi * (1.0 - math.cos(math.radians(sky.SUN_APERTURE / 2.0)))
        np.testing.assert_allclose(energy, sky.sun_radiance(light) * solid_angle, rtol=1e-4)


def test_a_wider_sun_has_the_same_irradiance() -> None:
    def irradiance(aperture: float) -> NDArray[np.float64]:
        light = sky.Daylight((0.0, 0.6, 0.8), sun_aperture=aperture)
        return sky.sun_radiance(light) * (1.0 - math.cos(math.radians(aperture / 2.0)))

    np.testing.assert_allclose(irradiance(5.0), irradiance(sky.SUN_APERTURE), rtol=1e-12)


def test_no_light_from_a_sun_below_the_horizon(tmp_path: Path) -> None:
    scene = read(tmp_path, emitter("sunsky", '<vector name="sun_direction" value="1 0 -0.1"/>'))
    assert not only_environment(scene).pixels.any()
    assert "the sun is below the horizon" in scene.warnings[0]


def test_the_sun_at_noon_and_at_its_solstice() -> None:
    # Greenwich, June solstice: 90 - 51.48 + 23.44 degrees high in the south (+x), within the equation of time
    x, y, z = sky.sun_direction(51.48, 0.0, 0.0, (2010, 6, 21), 12.03)
    assert math.degrees(math.asin(z)) == pytest.approx(61.96, abs=0.05)
    assert x > 0
    assert math.degrees(math.atan2(y, x)) == pytest.approx(0.0, abs=0.5)


def test_old_sky_has_its_zenith_at_y(tmp_path: Path) -> None:
    direction = '<vector name="sunDirection" value="0 1 0"/>'
    environment = only_environment(read(tmp_path, emitter("sky", direction), "0.6.0"))
    up, down, sideways = radiance(environment, np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.8, 0.6, 0.0]]))
    assert (up > 1.2 * sideways).all()  # the glow around the sun
    assert (sideways > 0.0).all()
    assert not down.any()


def test_gltf_lights(tmp_path: Path) -> None:
    half = math.sqrt(0.5)
    lights = [
        {"type": "point", "intensity": 5, "color": [1, 0.5, 0], "range": 3},
        {"type": "spot", "intensity": 2, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.5}},
        {"type": "directional", "intensity": 7},
    ]
    extension = "KHR_lights_punctual"
    nodes: list[dict[str, Any]] = [
        {"translation": [1, 2, 3], "rotation": [-half, 0, 0, half], "extensions": {extension: {"light": index}}}
        for index in range(3)
    ]
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "data:application/octet-stream;base64," + "A" * 48, "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}, *nodes],
        "extensions": {extension: {"lights": lights}},
    }
    file = tmp_path / "scene.gltf"
    file.write_text(json.dumps(document))
    scene = read_gltf(file)
    point, spot, directional = scene.lights
    assert isinstance(point, PointLight)
    assert isinstance(spot, SpotLight)
    assert isinstance(directional, DirectionalLight)
    assert (point.position, point.intensity) == ((1.0, 2.0, 3.0), (5.0, 2.5, 0.0))
    np.testing.assert_allclose(spot.to_world[:3, 2:4].T, [[0.0, -1.0, 0.0], [1.0, 2.0, 3.0]], atol=1e-15)
    assert (spot.cutoff_angle, spot.beam_width) == (math.degrees(0.5), math.degrees(0.1))
    np.testing.assert_allclose(directional.direction, [0.0, -1.0, 0.0], atol=1e-15)
    assert directional.irradiance == (7.0, 7.0, 7.0)
    assert any("1 candela is taken as 1 W/sr and 1 lux as 1 W/m²" in warning for warning in scene.warnings)
    assert any("range is ignored" in warning for warning in scene.warnings)

    lights[1]["spot"] = {"innerConeAngle": 0.6, "outerConeAngle": 0.5}
    file.write_text(json.dumps(document))
    with pytest.raises(SceneError, match="innerConeAngle < outerConeAngle"):
        read_gltf(file)


@pytest.fixture(scope="module")
def mi() -> Any:
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


def seen_by_mitsuba(mi: Any, xml: str, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radiance that arrives from unit directions."""
    light = mi.load_string(xml.replace("<emitter ", '<emitter version="3.0.0" ', 1))
    values = []
    for direction in directions:
        interaction = mi.SurfaceInteraction3f()
        interaction.wi = mi.Vector3f(*(-direction))
        values.append(np.array(light.eval(interaction)))
    return np.array(values, np.float64)


@pytest.mark.parametrize("size", [(5, 8), (2, 4), (1, 3), (4, 1)])  # what is smaller than 3x2 is filled up
def test_environment_map_points_where_mitsuba_s_does(tmp_path: Path, mi: Any, size: tuple[int, int]) -> None:
    random = np.random.default_rng(3)
    write_exr(tmp_path / "sky.exr", random.random((*size, 3)).astype(np.float32))
    name = f'<string name="filename" value="{tmp_path / "sky.exr"}"/>{number("scale", 1.5)}'
    directions = unit(random.normal(size=(200, 3)))
    for steps in (
        "",
        '<rotate x="1" angle="70"/><rotate y="1" angle="25"/>',
        '<scale x="-1"/><rotate z="1" angle="30"/>',
    ):
        xml = emitter("envmap", f'{name}<transform name="to_world">{steps}</transform>')
        environment = only_environment(read(tmp_path, xml))
        expected = seen_by_mitsuba(mi, xml, directions)
        np.testing.assert_allclose(radiance(environment, directions), expected, atol=2e-5)


def test_sky_equals_mitsuba_s(tmp_path: Path, mi: Any) -> None:
    random = np.random.default_rng(4)
    directions = unit(random.normal(size=(60, 3)))
    for turbidity, albedo, sun in ((3.0, 0.3, "0.3 0.2 0.93"), (7.4, 0.6, "-0.8 0.5 0.12")):
        parameters = (
            number("turbidity", turbidity)
            + number("albedo", albedo)
            + number("sun_scale", 0)
            + f'<vector name="sun_direction" value="{sun}"/>'
            + '<transform name="to_world"><rotate x="1" angle="-90"/></transform>'
        )
        # Mitsuba wants a unit vector, and turns it by to_world like everything else
        xml = emitter("sunsky", parameters)
        environment = only_environment(read(tmp_path, xml))
        up = directions @ environment.to_world[:3, 1]
        clear = np.abs(up) > 0.02  # the map has a soft horizon
        expected = seen_by_mitsuba(mi, xml, directions[clear])
        got = radiance(environment, directions[clear])
        np.testing.assert_allclose(got, expected, rtol=0.02, atol=1e-4)


def test_sun_equals_mitsuba_s(mi: Any) -> None:
    for elevation in (20.0, 45.0, 80.0):  # Mitsuba interpolates a coarse table, which is worse near the horizon
        angle = math.radians(elevation)
        direction = (math.cos(angle), 0.0, math.sin(angle))
        vector = " ".join(map(str, direction))
        xml = emitter("sunsky", f'<vector name="sun_direction" value="{vector}"/>{number("sky_scale", 0)}')
        expected = seen_by_mitsuba(mi, xml, np.array([direction]))[0]
        np.testing.assert_allclose(sky.sun_radiance(sky.Daylight(direction)), expected, rtol=3e-3)


def test_sun_stands_where_mitsuba_s_does(mi: Any) -> None:
    place = {"latitude": -30.0, "longitude": 10.0, "timezone": 1.0, "year": 2005, "month": 1, "day": 5, "hour": 10.5}
    light = mi.load_dict({"type": "sunsky", **place})
    expected = np.array(mi.traverse(light)["sun_direction"])
    got = sky.sun_direction(-30.0, 10.0, 1.0, (2005, 1, 5), 10.5)
    np.testing.assert_allclose(got, expected, atol=2e-3)  # Mitsuba counts days in single precision


def test_spot_falls_off_as_mitsuba_s_does(mi: Any) -> None:
    xml = emitter("spot", number("cutoff_angle", 30) + number("beam_width", 12))
    light = mi.load_string(xml.replace("<emitter ", '<emitter version="3.0.0" ', 1))
    for degrees in (0.0, 11.9, 12.1, 20.0, 29.9, 30.1):
        interaction = mi.SurfaceInteraction3f()
        interaction.p = mi.Point3f(math.sin(math.radians(degrees)), 0.0, math.cos(math.radians(degrees)))
        _, weight = light.sample_direction(interaction, mi.Point2f(0.5, 0.5))
        share = min(max((30.0 - degrees) / (30.0 - 12.0), 0.0), 1.0)  # what SpotLight says
        assert np.array(weight)[0] == pytest.approx(share, abs=1e-4)
