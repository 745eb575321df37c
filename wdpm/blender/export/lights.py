"""Blender's lights in our units.

Blender gives the power of a light in watts, and of a sun its irradiance [W/m²]. What Cycles 4.5 makes of that is held
by tests against it.

Lights with a size are meshes that glow: spheres and, to the front, areas. Light passes through them, as in Blender; but
a camera sees them, which it does not in Blender. So those in view, and others that we have no mesh for (a sun, a spot
with a size), are clouds of lights without size: as soft, in steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
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

_AROUND_SPHERE = 32
_AROUND_DISK = 32
_TURNED = np.diag([-1.0, 1.0, -1.0, 1.0])
"""Blender's lights shine along -z; ours along +z."""

WIDEST_PATTERN = 80.0
"""Half angle of a spot in degrees up to which its edge is drawn as Blender does: the pattern lies in a plane."""

WIDEST_COSINE = 84.0
"""Half angle of the spots that stand for an area in view."""

PATTERN = 128
"""Side of a spot's pattern in pixels."""

SHARP_SUN = math.radians(1.0)
"""Angle of a sun up to which its shadows are sharp."""

CLOUD = 64
"""Lights that stand for one with a size."""


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
            yield from _read(each.object, np.array(each.matrix_world, np.float64), camera, notes)


def _read(thing: Any, to_world: Array, camera: Camera, notes: Notes) -> Sequence[Light | Lamp]:
    light, owner = thing.data, f'light "{thing.name}"'
    colour = _color(light, owner, notes)
    if not max(colour) > 0.0:
        return ()
    if light.type == "SUN":
        return _sun(thing.name, light, to_world, colour)
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


def _point(thing: Any, to_world: Array, colour: RGB, camera: Camera, notes: Notes) -> Sequence[Light | Lamp]:
    light = thing.data
    place = to_world[:3, 3]
    radius = float(light.shadow_soft_size)
    intensity = _times(colour, INTENSITY_OF_WATT)
    if not getattr(light, "normalize", True) and radius > 0.0:
        intensity = _times(intensity, 4.0 * math.pi * radius**2)
    if radius <= 0.0:
        return (_point_at(thing.name, place, intensity),)
    if not thing.visible_camera and in_view(camera, place + radius * on_sphere(CLOUD)):
        _note_cloud(thing.name, notes)
        share = _times(intensity, 1.0 / CLOUD)
        return [_point_at(thing.name, place + radius * way, share) for way in on_sphere(CLOUD)]
    ball = sphere(_AROUND_SPHERE, true_area=True)
    ball = MeshData(ball.vertices * radius + place, ball.faces)
    return (Lamp(thing.name, ball, _times(intensity, 1.0 / (math.pi * radius**2))),)


def _point_at(name: str, place: Array, intensity: RGB) -> PointLight:
    x, y, z = (float(each) for each in place)
    return PointLight(name, (x, y, z), intensity)


def _sun(name: str, light: Any, to_world: Array, colour: RGB) -> Sequence[Light]:
    axes = to_world[:3, :3] / np.linalg.norm(to_world[:3, :3], axis=0)
    if light.angle <= SHARP_SUN:
        ways = -axes[:, 2][None]
    else:
        across = on_disk(CLOUD) * math.tan(min(light.angle, math.radians(170.0)) / 2.0)
        ways = across @ axes[:, :2].T - axes[:, 2]
    share = _times(colour, 1.0 / len(ways))
    suns = []
    for way in ways / np.linalg.norm(ways, axis=1, keepdims=True):
        x, y, z = (float(each) for each in way)
        suns.append(DirectionalLight(name, (x, y, z), share))
    return suns


def _spot(name: str, light: Any, to_world: Array, colour: RGB, notes: Notes) -> Sequence[Light]:
    if light.use_square:
        notes.add(f'light "{name}"', "square spots are not supported: its cone is round")
    cutoff = min(light.spot_size / 2.0, math.radians(89.9))
    edge = math.cos(light.spot_size / 2.0)
    full = edge + (1.0 - edge) * light.spot_blend
    angle, beam = math.degrees(cutoff), math.degrees(math.acos(min(full, 1.0)))
    drawn = light.spot_blend > 0.0 and angle <= WIDEST_PATTERN
    unscaled = np.array(to_world)
    unscaled[:3, :3] /= np.linalg.norm(unscaled[:3, :3], axis=0)
    radius = float(light.shadow_soft_size)
    offsets = np.zeros((1, 2)) if radius <= 0.0 else radius * on_disk(CLOUD)
    spot = SpotLight(
        name,
        unscaled @ _TURNED,
        _times(colour, INTENSITY_OF_WATT / len(offsets)),
        cutoff_angle=angle,
        beam_width=angle if drawn or light.spot_blend == 0.0 else min(beam, angle),
        texture=_soft_edge(math.tan(cutoff), edge, full) if drawn else None,
    )
    return [replace(spot, to_world=_moved(spot.to_world, offset)) for offset in offsets]


def _moved(to_world: Array, offset: Array) -> Array:
    """Moved along its own x and y."""
    moved = np.array(to_world)
    moved[:3, 3] += moved[:3, :2] @ offset
    return moved


def _soft_edge(tangent: float, edge: float, full: float) -> Bitmap:
    """The fall of a spot's light towards the edge of its cone: Cycles' smoothstep in the cosine."""
    across = ((np.arange(PATTERN) + 0.5) / PATTERN * 2.0 - 1.0) * tangent
    cosine = 1.0 / np.sqrt(1.0 + across[:, None] ** 2 + across[None, :] ** 2)
    share = np.clip((cosine - edge) / max(full - edge, 1e-9), 0.0, 1.0)
    fall = share * share * (3.0 - 2.0 * share)
    return Bitmap("spot", np.repeat(fall[..., None], 3, axis=2).astype(np.float32), Wrap.CLAMP)


def _area(thing: Any, to_world: Array, colour: RGB, camera: Camera, notes: Notes) -> Sequence[Light | Lamp]:
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
    strength = RADIANCE_OF_WATT / area if getattr(light, "normalize", True) else RADIANCE_OF_WATT
    facing = -to_world[:3, 2] @ (camera.to_world[:3, 3] - to_world[:3, 3]) > 0.0
    spread = on_disk(CLOUD) if round_one else on_square(8)
    everywhere = np.concatenate([vertices, apply_to_points(to_world @ half, np.pad(spread, ((0, 0), (0, 1))))])
    if facing and not thing.visible_camera and in_view(camera, everywhere):
        _note_cloud(thing.name, notes)
        return _cosine_spots(thing.name, to_world @ half, spread, _times(colour, strength * area))
    return (Lamp(thing.name, MeshData(vertices, faces), _times(colour, strength)),)


def _cosine_spots(name: str, to_world: Array, places: Array, intensity: RGB) -> Sequence[Light]:
    """Lights without size that stand for an area.

    Args:
        to_world: from the area, which is within the unit square or disk and shines along -z.
        places: of the lights there, shape [N, 2].
        intensity: of all together, on the axis [W/sr].
    """
    axes = to_world[:3, :3].copy()
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    axes[:, 2] *= np.sign(axes[:, 2] @ to_world[:3, 2]) or 1.0
    frame = np.eye(4)
    frame[:3, 2] = -axes[:, 2] / np.linalg.norm(axes[:, 2])
    frame[:3, 0] = axes[:, 0] / np.linalg.norm(axes[:, 0])
    frame[:3, 1] = np.cross(frame[:3, 2], frame[:3, 0])
    tangent = math.tan(math.radians(WIDEST_COSINE))
    across = ((np.arange(2 * PATTERN) + 0.5) / (2 * PATTERN) * 2.0 - 1.0) * tangent
    cosine = 1.0 / np.sqrt(1.0 + across[:, None] ** 2 + across[None, :] ** 2)
    pattern = Bitmap("area", np.repeat(cosine[..., None], 3, axis=2).astype(np.float32), Wrap.CLAMP)
    # The cone leaves out what goes out along the surface; the rest is brighter by as much.
    share = _times(intensity, 1.0 / (len(places) * math.sin(math.radians(WIDEST_COSINE)) ** 2))
    spots = []
    for place in places:
        frame[:3, 3] = to_world[:3, 3] + to_world[:3, :2] @ place
        spots.append(SpotLight(name, frame.copy(), share, WIDEST_COSINE, WIDEST_COSINE, pattern))
    return spots


def _note_cloud(name: str, notes: Notes) -> None:
    notes.add(
        f'light "{name}"', f"it is in view, where Blender hides it: {CLOUD} lights without size, that nothing reflects"
    )


def on_disk(count: int) -> Array:
    """Points spread evenly over the unit disk, shape [count, 2] (Vogel 1979: a sunflower)."""
    number = np.arange(count) + 0.5
    turn = number * (math.pi * (3.0 - math.sqrt(5.0)))
    return np.sqrt(number / count)[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def on_square(side: int) -> Array:
    """Points spread evenly over the square [-1, 1]², shape [side², 2]."""
    steps = (np.arange(side) + 0.5) / side * 2.0 - 1.0
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)


def on_sphere(count: int) -> Array:
    """Points spread evenly over the unit sphere, shape [count, 3]."""
    z = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    turn = np.arange(count) * (math.pi * (3.0 - math.sqrt(5.0)))
    radius = np.sqrt(1.0 - z**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


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
