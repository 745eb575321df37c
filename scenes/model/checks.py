"""What every scene must satisfy before it is rendered, whichever loader it came from."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wdpm.scenes.errors import SceneError
from wdpm.scenes.model.bounds import are_finite
from wdpm.scenes.model.bsdfs import vertex_attributes, walk
from wdpm.scenes.model.lights import DeltaLight, Light
from wdpm.scenes.model.scene import Camera, Instance, Material, Mesh, Scene, Solid
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Color, Texture
from wdpm.scenes.model.volumes import Volume

MOST_WARNINGS = 5
"""That an error repeats."""


def check_scene(scene: Scene, file: Path | None = None, *, drops: bool = False) -> Scene:
    """Returns the scene, or says what is wrong with it.

    Args:
        drops: vertices may be not finite, since who renders leaves out their triangles, and counts them.

    Raises:
        SceneError: no triangles, no light, a size below 1, non-finite values, indices out of range, no arrays.
    """
    for material in scene.materials:
        _check_material(material, file)
    reach: dict[int, float] = {}
    for mesh in scene.meshes:
        shape = mesh.shape if isinstance(mesh, Instance) else mesh
        if id(shape) not in reach:
            check_mesh(shape, len(scene.materials), file, drops=drops)
            reach[id(shape)] = float(max(shape.vertices.max(initial=0.0), -shape.vertices.min(initial=0.0)))
        if isinstance(mesh, Instance):
            _check_place(mesh, reach[id(shape)], file)
        _check_looks(mesh, scene.materials[mesh.material], file)
        for medium in (mesh.interior, mesh.exterior):
            _check_medium(medium, f'mesh "{mesh.name}"', scene, file)
    if sum(len(mesh.faces) for mesh in scene.meshes) == 0:
        raise SceneError(f"the scene is empty: it has no triangles{_as_read(scene)}", file)
    for each in scene.media:
        if not _all_sound((*each.sigma_t, *each.albedo)):
            raise SceneError(f'medium "{each.name}": sigma_t or albedo is negative or not finite in float32', file)
        if not abs(np.float32(each.g)) < 1:
            raise SceneError(f'medium "{each.name}": g is {each.g}; expected between -1 and 1, in float32', file)
        _check_volume(each.density, f'medium "{each.name}": its density', (1,), math.inf, file)
        _check_volume(each.albedo_volume, f'medium "{each.name}": its albedo', (1, 3), 1.0, file)
    _check_lights(scene, file)
    _check_camera(scene.camera, file)
    _check_medium(scene.camera.medium, "the camera", scene, file)
    return scene


def _check_material(material: Material, file: Path | None) -> None:
    for node in walk(material.bsdf):
        for parameter in fields(node):
            value = getattr(node, parameter.name)
            if not _is_sound(value):
                shown = value.name if isinstance(value, Texture) else value
                where = f'material "{material.name}": {type(node).__name__}.{parameter.name}'
                raise SceneError(f"{where} is negative or not finite in float32: {shown}", file)


def _is_sound(value: object) -> bool:
    """Whether a parameter is finite and not negative; names and nested functions are."""
    if isinstance(value, Bitmap | Checkerboard) and not _all_finite(value.to_uv):
        return False
    if isinstance(value, Bitmap):
        return bool(np.isfinite(value.pixels).all())
    if isinstance(value, Checkerboard):
        return _all_sound((*value.color0, *value.color1))
    if isinstance(value, tuple):
        return _all_sound(value)
    # a bump map may be turned inside out
    return not isinstance(value, float) or _all_finite(value)


LARGEST = float(np.finfo(np.float32).max)
"""Number that kernels know: what is larger would be infinite to them."""


def _all_finite(values: ArrayLike) -> bool:
    """Whether numbers are finite in float32 as well, which is what kernels compute in."""
    return bool((np.abs(np.asarray(values, np.float64)) <= LARGEST).all())


def _all_sound(values: Iterable[float]) -> bool:
    return all(0 <= value <= LARGEST for value in values)


FARTHEST = 1e37
"""Largest coordinate. Distances are told in float32, which ends at 3.4e38."""


def check_reach(mesh: Solid, file: Path | None) -> None:
    """Raise SceneError if a vertex lies so far away that distances are no numbers any more."""
    vertices = mesh.vertices
    if not vertices.size or (vertices.min() >= -FARTHEST and vertices.max() <= FARTHEST):
        return
    far = ((np.abs(vertices) > FARTHEST) & np.isfinite(vertices)).any(axis=1)
    if far.any():
        first = int(np.argmax(far))
        where = ", ".join(f"{x:g}" for x in vertices[first])
        raise SceneError(
            f'mesh "{mesh.name}": vertex {first} is ({where}), {int(far.sum())} beyond {FARTHEST:g} in all; '
            "give the scene in a larger unit",
            file,
        )


def _check_place(instance: Instance, own: float, file: Path | None) -> None:
    """Raise SceneError unless an instance stands somewhere, and in reach.

    Args:
        own: the largest absolute coordinate of its shape.
    """
    matrix = instance.to_world
    if not np.isfinite(matrix).all():
        raise SceneError(f'instance "{instance.name}": its transform is not finite', file)
    if np.linalg.matrix_rank(matrix[:3, :3]) < 3:
        raise SceneError(f'instance "{instance.name}": its transform flattens space: the matrix has no inverse', file)
    if not np.abs(matrix[:3, :3]).sum(axis=1).max() * own + np.abs(matrix[:3, 3]).max() <= FARTHEST:
        check_reach(instance, file)


def _check_arrays(mesh: Mesh, file: Path | None) -> None:
    """Raise SceneError unless a mesh, which a program may have built by hand, has arrays where it should."""
    needed: tuple[tuple[str, Any, str, int], ...] = (
        ("vertices", mesh.vertices, "f", 3),
        ("faces", mesh.faces, "iu", 3),
    )
    others = (("normals", mesh.normals, 3), ("uvs", mesh.uvs, 2), ("colors", mesh.colors, 3))
    given = tuple((name, values, "f", columns) for name, values, columns in others if values is not None)
    for name, values, kinds, columns in needed + given:
        is_array = isinstance(values, np.ndarray)
        if not (is_array and (values.dtype.kind in kinds or not values.size) and values.shape[1:] == (columns,)):
            what = "floats" if kinds == "f" else "integers"
            found = f"{values.dtype} of shape {values.shape}" if is_array else type(values).__name__
            raise SceneError(
                f'mesh "{mesh.name}": {name} are {found}; expected an array of {what}, shape [N, {columns}]', file
            )


def check_mesh(mesh: Mesh, material_count: int, file: Path | None, *, drops: bool = False) -> None:
    """Raise SceneError for a mesh with values that are not finite, indices out of range, or no arrays."""
    _check_arrays(mesh, file)
    attributes = (
        ("vertex", mesh.vertices),
        ("normal", mesh.normals),
        ("texture coordinate", mesh.uvs),
        ("colour", mesh.colors),
    )
    for what, values in attributes:
        if values is None or (drops and what == "vertex"):
            continue
        if what != "vertex" and len(values) != len(mesh.vertices):
            raise SceneError(f'mesh "{mesh.name}": {len(values)} {what}s for {len(mesh.vertices)} vertices', file)
        if not are_finite(values):
            finite = np.isfinite(values).all(axis=1)
            first = int(np.argmin(finite))
            bad = f"{what} {first} is ({', '.join(f'{x:g}' for x in values[first])})"
            raise SceneError(f'mesh "{mesh.name}": {bad}, {int(np.sum(~finite))} not finite in all', file)
    check_reach(mesh, file)
    if len(mesh.faces) and not (mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)):
        outside = (mesh.faces < 0) | (mesh.faces >= len(mesh.vertices))
        face = int(np.argmax(outside.any(axis=1)))
        raise SceneError(
            f'mesh "{mesh.name}": face {face} names a vertex out of range (there are {len(mesh.vertices)})', file
        )
    if not 0 <= mesh.material < material_count:
        raise SceneError(f'mesh "{mesh.name}": there is no material {mesh.material} (there are {material_count})', file)
    if not _emits_soundly(mesh.emission):
        raise SceneError(f'mesh "{mesh.name}": emission {mesh.emission} is negative or not finite in float32', file)


def _emits_soundly(emission: Color | None) -> bool:
    if isinstance(emission, Bitmap):
        return bool(np.isfinite(emission.pixels).all() and emission.pixels.min(initial=0.0) >= 0)
    return emission is None or _is_sound(emission)


def _check_looks(mesh: Solid, material: Material, file: Path | None) -> None:
    read = vertex_attributes(material.bsdf, mesh.emission)
    if read and mesh.colors is None:
        names = ", ".join(sorted(read))
        raise SceneError(f'mesh "{mesh.name}": it has no vertex colours, but what it is made of reads {names}', file)


def _check_medium(medium: int | None, owner: str, scene: Scene, file: Path | None) -> None:
    if medium is not None and not 0 <= medium < len(scene.media):
        raise SceneError(f"{owner}: there is no medium {medium} (there are {len(scene.media)})", file)


def _check_volume(volume: Volume | None, owner: str, channels: tuple[int, ...], most: float, file: Path | None) -> None:
    if volume is None:
        return
    values = volume.values
    if values.ndim != 4 or values.size == 0 or values.shape[3] not in channels:
        expected = " or ".join(map(str, channels))
        raise SceneError(f"{owner} has the shape {list(values.shape)}; expected [z, y, x, {expected}]", file)
    if not (np.isfinite(values).all() and values.min() >= 0.0 and values.max() <= most):
        allowed = f"from 0 to {most:g}" if most < math.inf else "finite, and not negative"
        raise SceneError(f"{owner} is {values.min():g} to {values.max():g}; expected {allowed}", file)
    if np.shape(volume.to_world) != (4, 4) or not np.isfinite(volume.to_world).all():
        raise SceneError(f"{owner} has a to_world transform that is no finite matrix [4, 4]", file)


def _check_lights(scene: Scene, file: Path | None) -> None:
    for light in scene.lights:
        place, strength = light.orientation, light.strength
        if not (_all_finite(place) and _all_finite(strength) and strength.min(initial=0.0) >= 0):
            message = f'light "{light.name}": its place or strength is negative or not finite in float32'
            raise SceneError(message, file)
        if not _has_axes(light):
            raise SceneError(f'light "{light.name}": it shines nowhere: its direction has no length', file)
        _check_medium(light.medium, f'light "{light.name}"', scene, file)
    glowing = any(len(mesh.faces) and _is_bright(mesh.emission) for mesh in scene.meshes)
    if not glowing and not any(light.strength.max(initial=0.0) > 0 for light in scene.lights):
        found = "the scene has no light: nothing would be seen; add an area or a point emitter"
        raise SceneError(f"{found}{_as_read(scene)}", file)


def _has_axes(light: Light) -> bool:
    """Whether it is known where a light that is aimed shines."""
    with np.errstate(all="ignore"):
        return not isinstance(light, DeltaLight) or bool(np.isfinite(light.row().axes).all())


def _as_read(scene: Scene) -> str:
    """What the loader warned of, behind an error that says that something is missing: it may well be the reason."""
    told = scene.warnings[:MOST_WARNINGS]
    more = len(scene.warnings) - len(told)
    rest = f", and {more} more" if more else ""
    return f" (warnings: {'; '.join(told)}{rest})" if told else ""


def _is_bright(emission: Color | None) -> bool:
    if isinstance(emission, Bitmap):
        return bool(emission.pixels.max(initial=0.0) > 0)
    if isinstance(emission, Checkerboard):
        return max(*emission.color0, *emission.color1) > 0
    return emission is not None and (not isinstance(emission, tuple) or max(emission) > 0)


def _check_camera(camera: Camera, file: Path | None) -> None:
    if camera.width < 1 or camera.height < 1:
        raise SceneError(f"the image size is {camera.width}x{camera.height}; both must be at least 1", file)
    if not _all_finite(camera.to_world):
        raise SceneError("the camera's transform is not finite in float32", file)
    far_clip = 0.0 if camera.far_clip == math.inf else camera.far_clip
    lens = (camera.near_clip, far_clip, camera.aperture_radius, camera.focus_distance, *camera.principal_point)
    if not _all_finite(lens):
        raise SceneError("the camera's clipping, principal point, aperture or focus is not finite in float32", file)
    if not camera.orthographic and not 0 < camera.fov_x < 180:
        raise SceneError(f"the field of view is {camera.fov_x:g} degrees; expected between 0 and 180", file)
    if not (camera.aperture_radius >= 0 and camera.focus_distance > 0):
        raise SceneError("the lens needs a radius that is not negative and a focus distance greater than 0", file)
