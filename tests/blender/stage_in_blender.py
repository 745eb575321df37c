"""What scenes of the add-on's tests are made of; runs inside Blender."""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np


def empty(width: int = 48, height: int = 32) -> Any:
    """A file with nothing in it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    return bpy.context.scene


def add(name: str, data: Any, location: Any = (0, 0, 0), rotation: Any = (0, 0, 0), scale: Any = (1, 1, 1)) -> Any:
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    thing.location, thing.rotation_euler, thing.scale = location, rotation, scale
    return thing


def camera(location: Any, rotation: Any, **settings: Any) -> Any:
    lens = bpy.data.cameras.new("Eye")
    for name, value in settings.items():
        setattr(lens, name, value)
    bpy.context.scene.camera = add("Eye", lens, location, rotation)
    return bpy.context.scene.camera


def lamp(kind: str, location: Any = (0.5, 0, 2), rotation: Any = (0, 0, 0), scale: Any = (1, 1, 1), **how: Any) -> Any:
    light = bpy.data.lights.new(kind.capitalize(), kind)
    for name, value in how.items():
        setattr(light, name, value)
    return add(kind.capitalize(), light, location, rotation, scale)


def material(kind: str = "ShaderNodeBsdfDiffuse", name: str = "Paint", **inputs: Any) -> Any:
    """A material of one shader node; inputs by name, with _ for a space."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes = made.node_tree.nodes
    nodes.clear()
    shader = nodes.new(kind)
    made.node_tree.links.new(shader.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    for each, value in inputs.items():
        shader.inputs[each.replace("_", " ")].default_value = value
    return made


def shader_of(made: Any) -> Any:
    return made.node_tree.nodes[0]


def plane(size: float, made: Any = None, location: Any = (0, 0, 0), rotation: Any = (0, 0, 0)) -> Any:
    bpy.ops.mesh.primitive_plane_add(size=size, location=location, rotation=rotation)
    return made_of(made)


def ball(location: Any = (0, 0, 0), made: Any = None, radius: float = 1.0) -> Any:
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius, location=location, segments=48, ring_count=24)
    bpy.ops.object.shade_smooth()
    return made_of(made)


def made_of(made: Any) -> Any:
    """The object that was added last, of a material or none."""
    thing = bpy.context.object
    if made is not None:
        thing.data.materials.append(made)
    return thing


def world(colour: Any = (0.5, 0.5, 0.5, 1), strength: float = 1.0) -> Any:
    """A world of one colour; returns its node tree."""
    made = bpy.data.worlds.new("World")
    bpy.context.scene.world = made
    made.use_nodes = True
    background = made.node_tree.nodes["Background"]
    background.inputs[0].default_value, background.inputs[1].default_value = colour, strength
    return made.node_tree


def picture(width: int, height: int, light: bool = False) -> Any:
    """An image that is different everywhere, so that whatever turns or mirrors it is seen."""
    image = bpy.data.images.new("Picture", width, height, float_buffer=light)
    x, y = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    squares = ((x * 4).astype(int) + (y * 4).astype(int)) % 2 * 0.8
    image.pixels.foreach_set(np.stack([x, y, squares, np.ones_like(x)], -1).astype(np.float32).ravel())
    return image


def grey(value: float = 0.8) -> Any:
    return material(Color=(value, value, value, 1))


def stage(**how: Any) -> None:
    """A grey floor, seen from the side."""
    camera((0, -3, 3), (math.radians(45), 0, 0), **how)
    plane(20, grey())
