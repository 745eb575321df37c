"""The evaluated scene of Blender as a wdpm Scene."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from wdpm.blender.export.camera import read_camera
from wdpm.blender.export.images import Images
from wdpm.blender.export.lights import Lamp, read_lights
from wdpm.blender.export.materials import Materials, Surface
from wdpm.blender.export.meshes import Instance, Part, part_of, read_instances
from wdpm.blender.export.notes import Notes
from wdpm.blender.export.world import read_world
from wdpm.scenes.meshes.backs import back_of, is_closed
from wdpm.scenes.model.bsdfs import Null
from wdpm.scenes.model.checks import check_scene
from wdpm.scenes.model.lights import Light
from wdpm.scenes.model.scene import Material, Mesh, Scene


def read_scene(depsgraph: Any) -> Scene:
    """What Blender would render: objects with their modifiers, instances, materials, lights, world and camera.

    What is not supported is named in Scene.warnings, with what stands in its place.

    Args:
        depsgraph: Blender's, evaluated for a render.

    Raises:
        SceneError: there is no camera, no face or no light.
    """
    notes = Notes()
    images = Images(notes)
    materials = Materials(images, notes)
    camera = read_camera(depsgraph, notes)
    override = depsgraph.view_layer_eval.material_override
    meshes = [
        mesh for instance in read_instances(depsgraph, notes) for mesh in _meshes_of(instance, materials, override)
    ]
    lights: list[Light] = []
    glass = len(materials.materials)
    for found in read_lights(depsgraph, camera, notes):
        if isinstance(found, Lamp):
            meshes.append(Mesh(found.name, found.mesh.vertices, found.mesh.faces, None, None, glass, found.emission))
        else:
            lights.append(found)
    environment = read_world(depsgraph.scene.world, images, notes)
    if environment is not None:
        lights.append(environment)
    _note_settings(depsgraph.scene, notes)
    every = (*materials.materials, Material("lamps", Null()))
    scene = Scene(
        depsgraph.scene.name,
        tuple(meshes),
        every,
        tuple(lights),
        camera,
        warnings=notes.lines,
        media=tuple(materials.media),
    )
    return check_scene(scene)


def _note_settings(scene: Any, notes: Notes) -> None:
    """What of the scene's settings changes pictures of Blender's engines, and not ours."""
    render = scene.render
    for on, what in (
        (render.film_transparent, "a transparent film is not supported: the world is seen"),
        (render.use_motion_blur, "motion blur is not supported: all stands still"),
        (render.use_multiview, "stereoscopy is not supported: the camera's own view is rendered"),
    ):
        if on:
            notes.add("render", what)


def _meshes_of(instance: Instance, materials: Materials, override: Any) -> Iterator[Mesh]:
    """The meshes of an instance, one for each of its materials, and another where it glows to the back as well."""
    for slot, material in enumerate(instance.materials):
        surface = materials.surface(material if override is None else override)
        part = part_of(instance, slot, surface.uv_map, surface.colors)
        if part is None:
            continue
        mesh = _mesh(instance.name, part, surface)
        yield mesh
        if mesh.emission is not None and not is_closed(instance.geometry.faces):
            yield back_of(mesh)


def _mesh(name: str, part: Part, surface: Surface) -> Mesh:
    emission = surface.emission
    return Mesh(
        name,
        part.vertices,
        part.faces,
        part.normals,
        part.uvs,
        surface.number,
        emission,
        part.colors,
        interior=surface.medium,
        bounds=surface.medium is not None,
    )
