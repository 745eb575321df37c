"""The same scene elsewhere, or in other units: what an image must not depend on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wdpm.cluster.render_settings import RenderSettings
from wdpm.scenes.model.bsdfs import BumpMap
from wdpm.scenes.model.lights import Light, PointLight, SpotLight
from wdpm.scenes.model.scene import Camera, Scene

Array = NDArray[np.float64]


def scaled(scene: Scene, by: float) -> Scene:
    """All lengths times `by`, so that radiance stays: intensities times by², extinction divided by it."""
    return replace(
        scene,
        meshes=tuple(replace(mesh, vertices=mesh.vertices * by) for mesh in scene.meshes),
        materials=tuple(replace(m, bsdf=_bumps_scaled(m.bsdf, by)) for m in scene.materials),
        lights=tuple(_light_scaled(light, by) for light in scene.lights),
        camera=_camera_scaled(scene.camera, by),
        media=tuple(replace(medium, sigma_t=_times(medium.sigma_t, 1.0 / by)) for medium in scene.media),
    )


def moved(scene: Scene, by: ArrayLike) -> Scene:
    """Everything moved by a vector."""
    offset = np.asarray(by, np.float64)
    lights: list[Light] = []
    for light in scene.lights:
        if isinstance(light, PointLight):
            light = replace(light, position=tuple(np.asarray(light.position) + offset))
        elif isinstance(light, SpotLight):
            light = replace(light, to_world=_matrix_moved(light.to_world, offset))
        lights.append(light)
    return replace(
        scene,
        meshes=tuple(replace(mesh, vertices=mesh.vertices + offset) for mesh in scene.meshes),
        lights=tuple(lights),
        camera=replace(scene.camera, to_world=_matrix_moved(scene.camera.to_world, offset)),
    )


def scaled_settings(settings: RenderSettings, by: float) -> RenderSettings:
    """Radii are lengths too."""
    radii = {name: getattr(settings, name) for name in ("radius", "caustic_radius", "volume_radius")}
    return replace(settings, **{name: radius * by for name, radius in radii.items() if radius is not None})


def size_of(scene: Scene) -> float:
    """The longest side of the box around all meshes."""
    corners = np.concatenate([mesh.vertices for mesh in scene.meshes])
    return float(np.ptp(corners, axis=0).max())


def on_lattice(scene: Scene, bits: int = 20) -> Scene:
    """All places rounded to multiples of 2^-bits of a power of two about the scene's size.

    Doubles then hold the scene exactly after it has been moved by up to 2^(53 - bits - 2) times that.
    """
    step = 2.0 ** (np.ceil(np.log2(size_of(scene))) - bits)

    def rounded(places: ArrayLike) -> Array:
        return np.asarray(np.round(np.asarray(places, np.float64) / step) * step)

    def matrix(m: Array) -> Array:
        copy = np.array(m, np.float64)
        copy[:3, 3] = rounded(copy[:3, 3])
        return copy

    lights: list[Light] = []
    for light in scene.lights:
        if isinstance(light, PointLight):
            light = replace(light, position=tuple(rounded(light.position)))
        elif isinstance(light, SpotLight):
            light = replace(light, to_world=matrix(light.to_world))
        lights.append(light)
    return replace(
        scene,
        meshes=tuple(replace(mesh, vertices=rounded(mesh.vertices)) for mesh in scene.meshes),
        lights=tuple(lights),
        camera=replace(scene.camera, to_world=matrix(scene.camera.to_world)),
    )


def small(scene: Scene, width: int, height: int | None = None) -> Scene:
    """The scene through a coarse film, without a crop."""
    camera = scene.camera
    rows = height or max(1, round(width * camera.height / camera.width))
    return replace(scene, camera=replace(camera, width=width, height=rows, crop=None, full_size=None))


def _camera_scaled(camera: Camera, by: float) -> Camera:
    to_world = np.array(camera.to_world, np.float64)
    to_world[:3, 3] *= by
    if camera.orthographic:
        to_world[:3, :2] *= by  # the image plane is as wide as these columns are long
    return replace(
        camera,
        to_world=to_world,
        near_clip=camera.near_clip * by,
        far_clip=camera.far_clip * by,
        aperture_radius=camera.aperture_radius * by,
        focus_distance=camera.focus_distance * by,
    )


def _light_scaled(light: Light, by: float) -> Light:
    if isinstance(light, PointLight):
        position = tuple(np.asarray(light.position, np.float64) * by)
        return replace(light, position=position, intensity=_times(light.intensity, by * by))
    if isinstance(light, SpotLight):
        to_world = np.array(light.to_world, np.float64)
        to_world[:3, 3] *= by
        return replace(light, to_world=to_world, intensity=_times(light.intensity, by * by))
    return light


def _bumps_scaled(bsdf: Any, by: float) -> Any:
    """A material whose bumps are `by` times higher."""
    if not is_dataclass(bsdf) or isinstance(bsdf, type):
        return bsdf
    changed = {}
    for field in fields(bsdf):
        value = getattr(bsdf, field.name)
        new = _bumps_scaled(value, by)
        if new is not value:
            changed[field.name] = new
    if isinstance(bsdf, BumpMap):
        changed["scale"] = bsdf.scale * by
    return replace(bsdf, **changed) if changed else bsdf


def _matrix_moved(matrix: Array, offset: Array) -> Array:
    copy = np.array(matrix, np.float64)
    copy[:3, 3] += offset
    return copy


def _times(values: Sequence[float], by: float) -> tuple[float, float, float]:
    red, green, blue = (float(value) * by for value in values)
    return red, green, blue
