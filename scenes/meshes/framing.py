"""A camera and lights for scenes that come without: all of it in view, from the front and a little above."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.meshes.interior import interior_view, is_room
from wdpm.scenes.meshes.primitives import rectangle
from wdpm.scenes.model.bounds import bounding_box
from wdpm.scenes.model.bsdfs import BLACK, GREY
from wdpm.scenes.model.checks import check_reach
from wdpm.scenes.model.lights import Light, PointLight
from wdpm.scenes.model.scene import Camera, Material, Mesh, Scene, Solid, diffuse
from wdpm.scenes.model.textures import RGB
from wdpm.scenes.model.transforms import look_at, rotation, scaling, translation

FRAMING_FOV = 35.0  # degrees; a portrait lens, little perspective distortion
FRAMING_DIRECTION = (0.55, 0.4, 1.0)  # from the scene's middle to the camera: front, right side and top are seen
DEFAULT_SIZE = (512, 512)

# all in units of the bounding sphere's radius
FLOOR_SIZE = 8.0  # half its side: its edge is out of sight
LAMP_SIZE = 1.0  # half its side: large enough for soft shadows
LAMP_DISTANCE = 4.0

# Direction from the scene's middle, and radiance. A lamp's irradiance there is about radiance * (2 / 4)²; the two
# together give about 1.5 pi there, so grey that faces them is about as bright as paper in a photograph.
_LAMPS: dict[str, tuple[tuple[float, float, float], RGB]] = {
    "key lamp": ((-0.7, 1.0, 0.8), (14.5, 14.0, 13.2)),
    "fill lamp": ((1.0, 0.7, 0.5), (4.4, 4.7, 5.3)),
}


class Frame(Enum):
    """From where a model that has no camera is seen."""

    INSIDE = "inside"
    OUTSIDE = "outside"


def glows(mesh: Solid) -> bool:
    """Whether a mesh emits light; a textured one is taken to."""
    return mesh.emission is not None and (not isinstance(mesh.emission, tuple) or max(mesh.emission) > 0)


def framing_camera(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    size: tuple[int, int] | None = None,
    direction: tuple[float, float, float] = FRAMING_DIRECTION,
) -> Camera:
    """A camera that sees the bounding sphere of a bounding box in full; +y is up.

    Args:
        direction: from the scene's middle to the camera.
    """
    width, height = size or DEFAULT_SIZE
    centre, radius = (low + high) / 2.0, bounding_radius(low, high)
    half_x = math.radians(FRAMING_FOV) / 2.0
    half_y = math.atan(math.tan(half_x) * height / width)
    distance = radius / math.sin(min(half_x, half_y))
    position = centre + distance * np.array(direction) / np.linalg.norm(direction)
    to_world = look_at(position, centre, (0.0, 1.0, 0.0))
    # tied to the distance rather than fixed, so that tiny and huge models are not cut off
    return Camera(to_world, FRAMING_FOV, width, height, near_clip=1e-4 * distance, far_clip=1e3 * distance)


def added_camera(
    meshes: Sequence[Solid],
    size: tuple[int, int] | None,
    frame: Frame | None,
    warnings: list[str],
    lack: str = "no camera in the file",
) -> Camera:
    """A camera for a scene that has lights, but no camera; said in `warnings`.

    Args:
        lack: what there is not, and where.
    """
    if frame is Frame.INSIDE or (frame is None and is_room(meshes)):
        warnings.append(f"{lack}: {_INSIDE}")
        return interior_view(meshes, size or DEFAULT_SIZE).camera
    warnings.append(f"{lack}: the camera frames the bounding box")
    return framing_camera(*bounding_box(meshes), size)


_INSIDE = "it is seen from inside, along the longest way (--frame outside: from outside)"


def refuse_frame(frame: Frame | None, file: Path) -> None:
    """Raise SceneError if a frame is wanted where there is a camera."""
    if frame is not None:
        raise SceneError(f"--frame {frame.value}: the file has a camera; give --camera FROM/AT to look elsewhere", file)


def bounding_radius(low: NDArray[np.float64], high: NDArray[np.float64]) -> float:
    """Half the diagonal of a bounding box; 1 for a single point, so that something can be framed."""
    radius = float(np.linalg.norm(high - low)) / 2.0
    return radius if radius > 0 else 1.0


def completed_scene(
    name: str,
    meshes: Sequence[Solid],
    materials: Sequence[Material],
    lights: Sequence[Light] = (),
    camera: Camera | None = None,
    *,
    size: tuple[int, int] | None,
    warnings: Sequence[str],
    place: str = "the file",
    frame: Frame | None = None,
) -> Scene:
    """A scene with what it lacks: a camera, lights, or both. What is added is said in Scene.warnings.

    Args:
        place: where neither was found, in words.
        frame: from where a scene without a camera is seen; None for from inside where it is a closed room.
    """
    if camera is None and not lights:
        return framed_scene(name, meshes, materials, size=size, warnings=warnings, place=place, frame=frame)
    notes = list(warnings)
    if camera is None:
        camera = added_camera(meshes, size, frame, notes, f"no camera in {place}")
    if not lights and all(mesh.emission is None for mesh in meshes):
        notes.append(f"no lights in {place}: a point light at the camera is added")
        lights = (_headlamp(meshes, camera),)
    return Scene(name, tuple(meshes), tuple(materials), tuple(lights), camera, warnings=tuple(notes))


def _headlamp(meshes: Sequence[Solid], camera: Camera) -> PointLight:
    """A lamp at the camera, so that what it sees is lit."""
    position = camera.to_world[:3, 3]
    distance = np.mean([np.linalg.norm(mesh.vertices.mean(axis=0) - position) for mesh in meshes])
    strength = math.pi * float(distance) ** 2  # irradiance pi at that distance
    return PointLight("headlamp", (position[0], position[1], position[2]), (strength, strength, strength))


def framed_scene(
    name: str,
    meshes: Sequence[Solid],
    materials: Sequence[Material],
    *,
    size: tuple[int, int] | None,
    warnings: Sequence[str],
    place: str = "the file",
    frame: Frame | None = None,
) -> Scene:
    """A scene of meshes that came without a camera: framed, and on a floor under two soft lamps if nothing in it glows.

    What is added is said in Scene.warnings.

    Args:
        place: where it was not found, in words.
        frame: from where it is seen; None for from inside where it is a closed room.
    """
    for mesh in meshes:
        check_reach(mesh, None)
    low, high = bounding_box(meshes)
    if frame is Frame.INSIDE or (frame is None and is_room(meshes, (low, high))):
        return _seen_from_inside(name, meshes, materials, size or DEFAULT_SIZE, warnings, place)
    if any(glows(mesh) for mesh in meshes):
        # lamps of its own: most likely a room that is open to the front
        camera = framing_camera(low, high, size, direction=(0.0, 0.0, 1.0))
        note = f"no camera in {place}: it looks along -z at the whole bounding box"
        return Scene(name, tuple(meshes), tuple(materials), (), camera, warnings=(*warnings, note))
    camera = framing_camera(low, high, size)
    stage, stage_materials = stage_for(low, high, first_material=len(materials))
    note = f"no camera and no lights in {place}: framed from the front, put on a grey floor and lit by two soft lamps"
    return Scene(name, (*meshes, *stage), (*materials, *stage_materials), (), camera, warnings=(*warnings, note))


def _seen_from_inside(
    name: str,
    meshes: Sequence[Solid],
    materials: Sequence[Material],
    size: tuple[int, int],
    warnings: Sequence[str],
    place: str,
) -> Scene:
    view = interior_view(meshes, size)
    lamps = () if any(glows(mesh) for mesh in meshes) else (view.lamp,)
    note = (
        f"no camera {'and no lights ' if lamps else ''}in {place}: {_INSIDE}{', by the light of a lamp' * len(lamps)}"
    )
    return Scene(name, tuple(meshes), tuple(materials), lamps, view.camera, warnings=(*warnings, note))


def stage_for(
    low: NDArray[np.float64], high: NDArray[np.float64], *, first_material: int
) -> tuple[tuple[Mesh, ...], tuple[Material, ...]]:
    """A floor and two lamps around a bounding box, with their materials.

    Args:
        first_material: the number that the first of the materials will have in the scene.
    """
    centre, radius = (low + high) / 2.0, bounding_radius(low, high)
    # a little below, so that a model with a flat underside does not flicker between its bottom and the floor
    ground = (centre[0], low[1] - 1e-3 * radius, centre[2])
    floor = translation(ground) @ rotation((1.0, 0.0, 0.0), -90.0) @ scaling([FLOOR_SIZE * radius] * 3)
    meshes = [_rectangle("floor", floor, first_material, None)]
    for name, (direction, radiance) in _LAMPS.items():
        position = centre + LAMP_DISTANCE * radius * np.array(direction) / np.linalg.norm(direction)
        place = look_at(position, centre, (0.0, 1.0, 0.0)) @ scaling([LAMP_SIZE * radius] * 3)
        meshes.append(_rectangle(name, place, first_material + 1, radiance))
    materials = (diffuse("floor", GREY, twosided=True), diffuse("lamp", BLACK))
    return tuple(meshes), materials


def _rectangle(name: str, to_world: NDArray[np.float64], material: int, emission: RGB | None) -> Mesh:
    mesh = rectangle().transformed(to_world)
    return Mesh(name, mesh.vertices, mesh.faces, None, mesh.uvs, material, emission)
