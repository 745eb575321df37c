"""Another view of a scene than its file asks for: from elsewhere, or a part of the image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from wdpm.scenes.errors import SceneError
from wdpm.scenes.model.scene import Scene
from wdpm.scenes.model.transforms import look_at

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Viewpoint:
    """Where to look from, and where to.

    Attributes:
        origin, target: in the scene's own units.
        up: what is up in the image.
        fov: full horizontal field of view, degrees; None for the scene's own.
    """

    origin: Point
    target: Point
    up: Point = (0.0, 1.0, 0.0)
    fov: float | None = None

    def __str__(self) -> str:
        where = (" ".join(f"{axis:g}" for axis in point) for point in (self.origin, self.target, self.up))
        words = "from {} to {}, up {}".format(*where)
        return words if self.fov is None else f"{words}, {self.fov:g} degrees wide"


def seen_from(scene: Scene, viewpoint: Viewpoint) -> Scene:
    """The scene with its camera put elsewhere, which is said in Scene.warnings; lens, film and medium stay.

    Raises:
        SceneError: there is no such view.
    """
    if viewpoint.fov is not None and scene.camera.orthographic:
        raise SceneError("--camera: the scene's camera is orthographic and has no field of view; leave FOV out")
    try:
        to_world = look_at(viewpoint.origin, viewpoint.target, viewpoint.up)
    except ValueError as error:
        raise SceneError(f"--camera: {viewpoint}: {error}") from error
    if scene.camera.orthographic:
        to_world[:3, :3] *= math.sqrt(float((scene.camera.to_world[:3, 0] ** 2).sum()))
    fov = scene.camera.fov_x if viewpoint.fov is None else viewpoint.fov
    camera = replace(scene.camera, to_world=to_world, fov_x=fov)
    return replace(scene, camera=camera, warnings=(*scene.warnings, f"--camera: it looks {viewpoint}"))


def named_camera(name: str, names: Sequence[str], file: Path) -> int:
    """The number of the camera of that name among those of a file.

    Raises:
        SceneError: there is none of that name, or several.
    """
    if names.count(name) == 1:
        return names.index(name)
    many = f"{names.count(name)} cameras" if name in names else "no camera"
    known = ", ".join(f'"{each}"' for each in names) or "none"
    raise SceneError(f'--camera: there is {many} of the name "{name}"; the file has {known}', file)


def cropped(scene: Scene, region: tuple[int, int, int, int]) -> Scene:
    """The scene with a part of its image alone to render: bit for bit what the whole image has there.

    Args:
        region: left, top, right and bottom in pixels of the whole image, in place of the file's crop window.

    Raises:
        SceneError: it is empty, or reaches beyond the image.
    """
    left, top, right, bottom = region
    camera = scene.camera
    width, height = camera.full_size or (camera.width, camera.height)
    if not (0 <= left < right <= width and 0 <= top < bottom <= height):
        raise SceneError(
            f"--crop {left},{top},{right},{bottom} is empty or reaches beyond the image of {width}x{height} pixels; "
            "expected LEFT,TOP,RIGHT,BOTTOM within it"
        )
    window = (left, top, right - left, bottom - top)
    part = replace(camera, crop=window, full_size=(width, height), width=window[2], height=window[3])
    note = f"--crop: {window[2]}x{window[3]} pixels at {left},{top} of {width}x{height}"
    return replace(scene, camera=part, warnings=(*scene.warnings, note))
