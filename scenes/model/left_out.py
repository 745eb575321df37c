"""A scene without some of its effects, as a person may ask for knowingly."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from wdpm.scenes.model.bsdfs import Blend, Bsdf, BumpMap, Mask, NormalMap, TwoSided
from wdpm.scenes.model.scene import Instance, Mesh, Scene, Solid


def leave_out(scene: Scene, effects: Collection[str]) -> Scene:
    """The scene without effects; names that mean nothing here are not looked at.

    Args:
        effects: of "media" (all space is empty), "lens" (everything is in focus), "bump" (no normal is bent).
    """
    if "lens" in effects:
        scene = replace(scene, camera=replace(scene.camera, aperture_radius=0.0))
    if "media" in effects:
        scene = _without_media(scene)
    if "bump" in effects:
        scene = replace(scene, materials=tuple(replace(m, bsdf=_unbent(m.bsdf)) for m in scene.materials))
    return scene


def _without_media(scene: Scene) -> Scene:
    shapes: dict[int, Mesh] = {}

    def outside(mesh: Solid) -> Solid:
        if not isinstance(mesh, Instance):
            return replace(mesh, interior=None, exterior=None, bounds=False)
        if id(mesh.shape) not in shapes:  # instances go on sharing it
            shapes[id(mesh.shape)] = replace(mesh.shape, interior=None, exterior=None, bounds=False)
        return replace(mesh, shape=shapes[id(mesh.shape)])

    return replace(
        scene,
        media=(),
        meshes=tuple(outside(mesh) for mesh in scene.meshes),
        camera=replace(scene.camera, medium=None),
        lights=tuple(light.outside_media() for light in scene.lights),
    )


def _unbent(bsdf: Bsdf) -> Bsdf:
    if isinstance(bsdf, BumpMap | NormalMap):
        return _unbent(bsdf.nested)
    if isinstance(bsdf, Mask):
        return replace(bsdf, nested=_unbent(bsdf.nested))
    if isinstance(bsdf, Blend):
        return replace(bsdf, first=_unbent(bsdf.first), second=_unbent(bsdf.second))
    if isinstance(bsdf, TwoSided):
        return replace(bsdf, front=_unbent(bsdf.front), back=None if bsdf.back is None else _unbent(bsdf.back))
    return bsdf
