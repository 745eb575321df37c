"""Blender's lights in our units.

Blender gives the power of a light in watts, and of a sun its irradiance [W/m²]. What Cycles 4.5 makes of that is held by
tests against it.

Lights with a size are meshes that glow: spheres and, to the front, areas. Light passes through them, as in Blender; but
a camera sees them, which it does not in Blender.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.blender.export.notes import Notes
from wdpm.scenes.meshes.mesh_data import MeshData
from wdpm.scenes.meshes.primitives import disk, rectangle, sphere
from wdpm.scenes.model.lights import DirectionalLight, Light, PointLight, SpotLight
from wdpm.scenes.model.scene import Camera
from wdpm.scenes.model.textures import RGB, Bitmap, Wrap
from wdpm.scenes.model.transforms import apply_to_points

Array = NDArray[np.float64]

INTENSITY_OF_WATT = 1.0 / (4.0 * math.pi)
"""Radiant intensity [W/sr] of a point or spot light of 1 W."""

RADIANCE_OF_WATT = 1.0 / math.pi
"""Radiance [W/(m² sr)] of an area light of 1 W and 1 m²."""

_AROUND_SPHERE = 16
_AROUND_DISK = 32
_TURNED = np.diag([-1.0, 1.0, -1.0, 1.0])
"""Blender's lights shine along -z; ours along +z."""

WIDEST_PATTERN = 80.0
"""Half angle of a spot in degrees up to which its edge is drawn as Blender does: the pattern lies in a plane."""

PATTERN = 128
"""Side of a spot's pattern in pixels."""

SHARP_SUN = math.radians(1.0)
"""Angle of a sun up to which its shadows are sharp without a word about it; ours has no size."""


@dataclass(frozen=True, eq=False)
class Lamp:
    """A light with a size: a mesh that glows to its front and lets light pass.

    Attributes:
        mesh: in world space.
        emission: radiance.
    """

    name: str
    mesh: MeshData
    emission: RGB


def read_lights(depsgraph: Any, camera: Camera, notes: Notes) -> Iterator[Light | Lamp]:
    """All lights that are to be rendered.

    Args:
        camera: decides about lights with a size that it would see.
    """
    for each in depsgraph.object_instances:
        if each.object.type == "LIGHT" and each.show_self:
            found = _read(each.object, np.array(each.matrix_world, np.float64), camera, notes)
            if found is not None:
                yield found


def _read(thing: Any, to_world: Array, camera: Camera, notes: Notes) -> Light | Lamp | None:
    light, owner = thing.data, f'light "{thing.name}"'
    colour = _color(light, owner, notes)
    if not max(colour) > 0.0:
        return None
    if light.type == "SUN":
        return _sun(thing.name, light, to_world, colour, notes)
    if light.type == "AREA":
        return _area(thing, to_world, colour, camera, notes)
    if light.type == "SPOT":
        return _spot(thing.name, light, to_world, colour, notes)
    return _point(thing, to_world, colour, camera, notes)


def _color(light: Any, owner: str, notes: Notes) -> RGB:
    """The light's energy as a colour, with its temperature, exposure and nodes."""
    colour = np.array(light.color, np.float64) * light.energy
    if getattr(light, "use_temperature", False):
        colour = colour * np.array(light.temperature_color)[:3]
    colour = colour * 2.0 ** getattr(light, "exposure", 0.0)
    if light.use_nodes and light.node_tree is not None:
        colour = colour * _nodes_factor(light, owner, notes)
    red, green, blue = (max(float(each), 0.0) for each in colour)
    return red, green, blue


def _nodes_factor(light: Any, owner: str, notes: Notes) -> Array:
    """What an Emission node multiplies the light by."""
    from wdpm.blender.export.images import Images
    from wdpm.blender.export.shaders import Shaders
    from wdpm.blender.export.sockets import surface_output
    from wdpm.blender.export.values import Values

    output = surface_output(light.node_tree, "ShaderNodeOutputLight")
    look = None if output is None else Shaders(Values(owner, Images(notes), notes)).read(output.input("Surface"))
    if look is None or look.emission is None:
        notes.add(owner, "its nodes end in no Emission: they are ignored")
        return np.ones(3)
    if look.emission.image is not None:
        notes.add(owner, "images that a light casts are not supported: their mean is used")
    return np.array(look.emission.mean)


def _point(thing: Any, to_world: Array, colour: RGB, camera: Camera, notes: Notes) -> Light | Lamp:
    light = thing.data
    place = to_world[:3, 3]
    radius = float(light.shadow_soft_size)
    intensity = _times(colour, INTENSITY_OF_WATT)
    if not getattr(light, "normalize", True) and radius > 0.0:
        intensity = _times(intensity, 4.0 * math.pi * radius**2)
    if radius > 0.0 and not thing.visible_camera and in_view(camera, place[None]):
        notes.add(f'light "{thing.name}"', "it is in view, where Blender hides it: it has no size, and sharp shadows")
        radius = 0.0
    if radius <= 0.0:
        return PointLight(thing.name, (float(place[0]), float(place[1]), float(place[2])), intensity)
    ball = sphere(_AROUND_SPHERE, true_area=True)
    ball = MeshData(ball.vertices * radius + place, ball.faces, ball.normals)
    return Lamp(thing.name, ball, _times(intensity, 1.0 / (math.pi * radius**2)))


def _sun(name: str, light: Any, to_world: Array, colour: RGB, notes: Notes) -> Light:
    if light.angle > SHARP_SUN:
        notes.add(f'light "{name}"', f"its angle of {math.degrees(light.angle):.3g}° is left out: shadows are sharp")
    x, y, z = (-to_world[:3, 2] / np.linalg.norm(to_world[:3, 2])).tolist()
    return DirectionalLight(name, (x, y, z), colour)


def _spot(name: str, light: Any, to_world: Array, colour: RGB, notes: Notes) -> Light:
    if light.shadow_soft_size > 0.0:
        notes.add(f'light "{name}"', "the radius of a spot is left out: shadows are sharp")
    if light.use_square:
        notes.add(f'light "{name}"', "square spots are not supported: its cone is round")
    cutoff = min(light.spot_size / 2.0, math.radians(89.9))
    edge = math.cos(light.spot_size / 2.0)
    full = edge + (1.0 - edge) * light.spot_blend
    angle, beam = math.degrees(cutoff), math.degrees(math.acos(min(full, 1.0)))
    drawn = light.spot_blend > 0.0 and angle <= WIDEST_PATTERN
    unscaled = np.array(to_world)
    unscaled[:3, :3] /= np.linalg.norm(unscaled[:3, :3], axis=0)
    return SpotLight(
        name,
        unscaled @ _TURNED,
        _times(colour, INTENSITY_OF_WATT),
        cutoff_angle=angle,
        beam_width=angle if drawn or light.spot_blend == 0.0 else min(beam, angle),
        texture=_soft_edge(math.tan(cutoff), edge, full) if drawn else None,
    )


def _soft_edge(tangent: float, edge: float, full: float) -> Bitmap:
    """The fall of a spot's light towards the edge of its cone: Cycles' smoothstep in the cosine."""
    across = ((np.arange(PATTERN) + 0.5) / PATTERN * 2.0 - 1.0) * tangent
    cosine = 1.0 / np.sqrt(1.0 + across[:, None] ** 2 + across[None, :] ** 2)
    share = np.clip((cosine - edge) / max(full - edge, 1e-9), 0.0, 1.0)
    fall = share * share * (3.0 - 2.0 * share)
    return Bitmap("spot", np.repeat(fall[..., None], 3, axis=2).astype(np.float32), Wrap.CLAMP)


def _area(thing: Any, to_world: Array, colour: RGB, camera: Camera, notes: Notes) -> Lamp:
    light, owner = thing.data, f'light "{thing.name}"'
    if light.spread < math.pi - 1e-3:
        notes.add(owner, f"a spread of {math.degrees(light.spread):.0f}° is not supported: it shines to all sides")
    width = float(light.size)
    height = float(light.size_y) if light.shape in ("RECTANGLE", "ELLIPSE") else width
    round_one = light.shape in ("DISK", "ELLIPSE")
    shape = disk(_AROUND_DISK, true_area=True) if round_one else rectangle()
    half = np.diag([max(width, 1e-6) / 2.0, max(height, 1e-6) / 2.0, 1.0, 1.0])
    vertices = apply_to_points(to_world @ _TURNED @ half, shape.vertices)
    faces = shape.faces if np.linalg.det(to_world[:3, :3]) > 0 else shape.faces[:, ::-1]
    area = float(np.linalg.norm(np.cross(to_world[:3, 0] * width, to_world[:3, 1] * height)))
    area *= math.pi / 4.0 if round_one else 1.0
    facing = -to_world[:3, 2] @ (camera.to_world[:3, 3] - to_world[:3, 3]) > 0.0
    if facing and not thing.visible_camera and in_view(camera, vertices):
        notes.add(owner, "the camera sees its shape, which Blender hides: move it out of the picture if that disturbs")
    strength = RADIANCE_OF_WATT / area if getattr(light, "normalize", True) else RADIANCE_OF_WATT
    return Lamp(thing.name, MeshData(vertices, faces), _times(colour, strength))


def in_view(camera: Camera, points: Array) -> bool:
    """Whether any of some points, shape [N, 3], lies in the picture; its edges are not looked at closely."""
    if camera.orthographic:
        return True
    axes = camera.to_world[:3, :3]
    local = (points - camera.to_world[:3, 3]) @ axes
    depth = np.maximum(local[:, 2], 1e-9)
    half = math.tan(math.radians(camera.fov_x) / 2.0)
    width, height = camera.full_size or (camera.width, camera.height)
    across = -local[:, 0] / (depth * half) / 2.0 + camera.principal_point[0]
    down = -local[:, 1] / (depth * half) * (width / height) / 2.0 + camera.principal_point[1]
    return bool(((local[:, 2] > 0.0) & (np.abs(across) < 0.5) & (np.abs(down) < 0.5)).any())


def _times(colour: RGB, factor: float) -> RGB:
    red, green, blue = (each * factor for each in colour)
    return red, green, blue
