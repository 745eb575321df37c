"""Cameras and lights of glTF 2.0 files.

Format: Khronos Group, "glTF 2.0 Specification", section 3.10, and the extension KHR_lights_punctual.
"""

from __future__ import annotations

import math
from typing import Any

from wdpm.scenes.gltf.container import GltfFile
from wdpm.scenes.meshes.framing import DEFAULT_SIZE
from wdpm.scenes.model.lights import DirectionalLight, Light, PointLight, SpotLight
from wdpm.scenes.model.scene import Camera, horizontal_fov
from wdpm.scenes.model.textures import RGB
from wdpm.scenes.model.transforms import Matrix, facing_forward

_FAR = 1e10  # metres; glTF allows perspective cameras without a far plane


def read_gltf_light(gltf: GltfFile, node: str, index: Any, to_world: Matrix, warnings: list[str]) -> Light:
    """A point, spot or directional light of KHR_lights_punctual.

    Between its two cones a spot falls as the extension recommends. A `range` is ignored: light falls with the square of
    the distance, and no further.

    Args:
        node: name of the node that it hangs on.
        index: of the light.

    Raises:
        SceneError: there is no such light, or it has values out of range.
    """
    light = _light(gltf, index)
    name = gltf.get(light, "name", str, node)
    kind = light.get("type")
    if kind not in ("point", "spot", "directional"):
        raise gltf.error(f'light "{name}": type "{kind}" does not exist; expected point, spot or directional')
    strength = _strength(gltf, light, name)
    if "range" in light:
        warnings.append(f'light "{name}": range is ignored: light falls with the square of the distance')
    if kind == "point":
        x, y, z = (float(value) for value in to_world[:3, 3])
        return PointLight(name, (x, y, z), strength)
    matrix = facing_forward(to_world)
    if kind == "directional":
        x, y, z = (float(value) for value in matrix[:3, 2])
        return DirectionalLight(name, (x, y, z), strength)
    spot = gltf.get(light, "spot", dict, {})
    inner = gltf.number(spot, "innerConeAngle", 0.0)
    outer = gltf.number(spot, "outerConeAngle", math.pi / 4.0)
    if not 0.0 <= inner < outer <= math.pi / 2.0:
        raise gltf.error(f'light "{name}": expected 0 <= innerConeAngle < outerConeAngle <= pi / 2')
    return SpotLight(name, matrix, strength, math.degrees(outer), math.degrees(inner), squared=True)


def _light(gltf: GltfFile, index: Any) -> dict[str, Any]:
    extension = gltf.get(gltf.json, "extensions", dict, {})
    lights = gltf.get(gltf.get(extension, "KHR_lights_punctual", dict, {}), "lights", list, [])
    if not isinstance(index, int) or not 0 <= index < len(lights) or not isinstance(lights[index], dict):
        raise gltf.error(f"broken glTF: there is no light {index}")
    return dict(lights[index])


def _strength(gltf: GltfFile, light: dict[str, Any], name: str) -> RGB:
    intensity = gltf.number(light, "intensity", 1.0)
    color = gltf.numbers(light, "color", [1.0, 1.0, 1.0])
    if intensity < 0.0 or min(color) < 0.0:
        raise gltf.error(f'light "{name}": intensity and color must not be negative')
    return intensity * color[0], intensity * color[1], intensity * color[2]


def read_gltf_camera(
    gltf: GltfFile, name: str, camera: dict[str, Any], to_world: Matrix, size: tuple[int, int] | None
) -> Camera:
    """A perspective or orthographic camera.

    Args:
        size: width and height in pixels; by default 512 high with the camera's aspect ratio. An image of another
            aspect ratio sees the camera's height.
    """
    kind = camera.get("type")
    if kind not in ("perspective", "orthographic"):
        raise gltf.error(f'camera "{name}": type "{kind}" does not exist; expected perspective or orthographic')
    values = gltf.get(camera, kind, dict, {})
    if kind == "orthographic":
        return _orthographic(gltf, name, values, to_world, size)
    aspect = gltf.number(values, "aspectRatio", 1.0)
    fov_y = gltf.number(values, "yfov", 0.0)
    near, far = gltf.number(values, "znear", 0.0), gltf.number(values, "zfar", _FAR)
    if not (0 < fov_y < math.pi and aspect > 0 and 0 < near < far):
        raise gltf.error(f'camera "{name}": yfov, aspectRatio, znear or zfar is missing or out of range')
    width, height = size or _default_size(aspect)
    fov_x = horizontal_fov(math.degrees(fov_y), "y", width / height)
    return Camera(facing_forward(to_world), fov_x, width, height, near, far)


def _orthographic(
    gltf: GltfFile, name: str, values: dict[str, Any], to_world: Matrix, size: tuple[int, int] | None
) -> Camera:
    half_width, half_height = gltf.number(values, "xmag", 0.0), gltf.number(values, "ymag", 0.0)
    near, far = gltf.number(values, "znear", -1.0), gltf.number(values, "zfar", -1.0)
    if not (half_width > 0 and half_height > 0 and 0 <= near < far):
        raise gltf.error(f'camera "{name}": xmag, ymag, znear or zfar is missing or out of range')
    width, height = size or _default_size(half_width / half_height)
    matrix = facing_forward(to_world)
    # the image is 2 wide and 2 height / width high, times the axes' lengths
    matrix[:3, :2] *= half_height * width / height
    return Camera(matrix, 90.0, width, height, near, far, orthographic=True)


def _default_size(aspect: float) -> tuple[int, int]:
    return max(1, round(DEFAULT_SIZE[1] * aspect)), DEFAULT_SIZE[1]
