"""What every scene must satisfy before it is rendered, whichever loader it came from."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from wdpm.scenes.errors import SceneError
from wdpm.scenes.model import Camera, Mesh, Scene


def check_scene(scene: Scene, file: Path | None = None) -> Scene:
    """Returns the scene, or says what is wrong with it.

    Raises:
        SceneError: no triangles, no light, a size below 1, non-finite values, indices out of range.
    """
    for mesh in scene.meshes:
        _check_mesh(mesh, len(scene.materials), file)
    if sum(len(mesh.faces) for mesh in scene.meshes) == 0:
        raise SceneError("the scene is empty: it has no triangles", file)
    _check_lights(scene, file)
    _check_camera(scene.camera, file)
    return scene


def _check_mesh(mesh: Mesh, material_count: int, file: Path | None) -> None:
    for what, values in (("vertex", mesh.vertices), ("normal", mesh.normals), ("texture coordinate", mesh.uvs)):
        if values is None:
            continue
        if what != "vertex" and len(values) != len(mesh.vertices):
            raise SceneError(f'mesh "{mesh.name}": {len(values)} {what}s for {len(mesh.vertices)} vertices', file)
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            first = int(np.argmin(finite))
            bad = f"{what} {first} is ({', '.join(f'{x:g}' for x in values[first])})"
            raise SceneError(f'mesh "{mesh.name}": {bad}, {int(np.sum(~finite))} not finite in all', file)
    if len(mesh.faces) and not (mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)):
        outside = (mesh.faces < 0) | (mesh.faces >= len(mesh.vertices))
        face = int(np.argmax(outside.any(axis=1)))
        raise SceneError(
            f'mesh "{mesh.name}": face {face} names a vertex out of range (there are {len(mesh.vertices)})', file
        )
    if not 0 <= mesh.material < material_count:
        raise SceneError(f'mesh "{mesh.name}": there is no material {mesh.material} (there are {material_count})', file)
    if mesh.emission is not None and not all(math.isfinite(x) and x >= 0 for x in mesh.emission):
        raise SceneError(f'mesh "{mesh.name}": emission {mesh.emission} is negative or not finite', file)


def _check_lights(scene: Scene, file: Path | None) -> None:
    for light in scene.point_lights:
        if not all(math.isfinite(x) for x in (*light.position, *light.intensity)) or min(light.intensity) < 0:
            raise SceneError(f'point light "{light.name}": position or intensity is negative or not finite', file)
    glowing = any(mesh.emission is not None and max(mesh.emission) > 0 and len(mesh.faces) for mesh in scene.meshes)
    if not glowing and not any(max(light.intensity) > 0 for light in scene.point_lights):
        raise SceneError("the scene has no light: nothing would be seen; add an area or a point emitter", file)


def _check_camera(camera: Camera, file: Path | None) -> None:
    if camera.width < 1 or camera.height < 1:
        raise SceneError(f"the image size is {camera.width}x{camera.height}; both must be at least 1", file)
    if not np.isfinite(camera.to_world).all():
        raise SceneError("the camera's transform is not finite", file)
    if not 0 < camera.fov_x < 180:
        raise SceneError(f"the field of view is {camera.fov_x:g} degrees; expected between 0 and 180", file)
