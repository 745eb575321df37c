"""Scenes for the tests of the add-on; runs inside Blender."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from stage_in_blender import (
    add,
    ball,
    camera,
    empty,
    grey,
    lamp,
    made_of,
    material,
    picture,
    plane,
    shader_of,
    stage,
    world,
)

SCENES: dict[str, Callable[[], None]] = {}


def scene(function: Callable[[], None]) -> Callable[[], None]:
    """Add one to the list, by its name."""
    SCENES[function.__name__] = function
    return function


def ball_on_plane() -> None:
    ball((0, 0, 0), material(Color=(0.8, 0.3, 0.2, 1)))
    plane(6, material(Color=(0.2, 0.3, 0.8, 1)), (0, 0, -1))
    lamp("SUN", (0, 0, 5), (0.3, 0.3, 0), energy=3)


@scene
def default() -> None:
    bpy.ops.wm.read_factory_settings()
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 96, 54, 50


@scene
def perspective_vertical_fit_and_shift() -> None:
    empty(60, 40).render.resolution_percentage = 80
    camera((0, -5, 3), (math.radians(60), 0, 0.2), sensor_fit="VERTICAL", sensor_height=24, lens=35, shift_x=-0.2)
    bpy.context.scene.camera.data.shift_y = 0.1
    ball_on_plane()


@scene
def perspective_tall() -> None:
    empty(32, 60)
    camera((0, -5, 3), (math.radians(60), 0, 0.2), lens=35)
    ball_on_plane()


@scene
def perspective_tall_horizontal_fit() -> None:
    empty(32, 60)
    camera((0, -5, 3), (math.radians(60), 0, 0.2), lens=50, sensor_fit="HORIZONTAL", shift_y=0.15)
    ball_on_plane()


@scene
def orthographic_shift() -> None:
    empty(40, 60)
    camera((0, -5, 3), (math.radians(60), 0, 0.2), type="ORTHO", ortho_scale=5, shift_x=0.1, shift_y=0.2)
    ball_on_plane()


@scene
def crop() -> None:
    _border(cut=True)


@scene
def border() -> None:
    _border(cut=False)


def _border(cut: bool) -> None:
    render = empty(60, 40).render
    camera((0, -5, 3), (math.radians(60), 0, 0.2), lens=35)
    render.use_border, render.use_crop_to_border = True, cut
    render.border_min_x, render.border_max_x = 0.21, 0.73
    render.border_min_y, render.border_max_y = 0.33, 0.91
    ball_on_plane()


@scene
def depth_of_field() -> None:
    empty()
    eye = camera((0, -5, 3), (math.radians(60), 0, 0.2), lens=85)
    eye.data.dof.use_dof, eye.data.dof.aperture_fstop, eye.data.dof.focus_distance = True, 0.2, 4.0
    ball_on_plane()


@scene
def modifiers_and_instances() -> None:
    empty()
    camera((0, -8, 5), (math.radians(55), 0, 0))
    paint = grey()
    plane(20, paint)
    bpy.ops.mesh.primitive_cube_add(size=0.6, location=(-2, 0, 0.5))
    row = made_of(paint)
    row.scale = (1, 1, -1.3)
    array = row.modifiers.new("Row", "ARRAY")
    array.count, array.relative_offset_displace = 4, (1.5, 0.5, 0)
    row.modifiers.new("Round", "BEVEL").width = 0.1
    group = bpy.data.collections.new("Group")
    one = ball((0, 0, 1.5), paint, 0.4)
    bpy.context.scene.collection.objects.unlink(one)
    group.objects.link(one)
    for x in (-1, 1):
        place = add("Place", None, (x, -1, 0), scale=(1, 2, 0.5))
        place.instance_type, place.instance_collection = "COLLECTION", group
    bpy.ops.object.text_add(location=(-1, -3, 0.2))
    made_of(paint).data.extrude = 0.1
    lamp("SUN", (0, 0, 5), (0.5, 0.3, 0), energy=3)
    world((0.3, 0.4, 0.5, 1))


@scene
def light_point() -> None:
    empty()
    stage()
    lamp("POINT", energy=100, color=(1, 0.5, 0.2))


@scene
def light_ball() -> None:
    empty()
    stage()
    lamp("POINT", energy=50, shadow_soft_size=0.3, exposure=1.0, use_soft_falloff=False)


@scene
def light_spot() -> None:
    empty()
    stage()
    lamp("SPOT", rotation=(0.2, 0.1, 0), scale=(2, 2, 2), energy=100, spot_blend=0.5, spot_size=1.5)


@scene
def light_sun() -> None:
    empty()
    stage()
    lamp("SUN", rotation=(0.3, 0, 0), energy=3)


@scene
def light_area() -> None:
    empty()
    stage()
    lamp("AREA", rotation=(0.3, 0.2, 0), scale=(2, 3, 1), energy=100, size=0.5)


@scene
def light_ellipse() -> None:
    empty()
    stage()
    lamp("AREA", energy=100, shape="ELLIPSE", size=0.5, size_y=1.0, normalize=False)


@scene
def light_of_a_mesh() -> None:
    empty()
    stage()
    plane(1, material("ShaderNodeEmission", Strength=5.0), (0, 0, 1), (1.2, 0.2, 0))


@scene
def light_in_view() -> None:
    """Lights with a size that a picture must not show."""
    empty()
    camera((0, -6, 3), (math.radians(65), 0, 0))
    plane(20, grey())
    ball((0, -1, 0.5), grey(0.5), 0.5)
    lamp("AREA", (0, 1, 1.5), (math.radians(-60), 0, 0), energy=50, size=1)
    lamp("POINT", (-1.2, 0, 1), energy=30, shadow_soft_size=0.2, use_soft_falloff=False)


@scene
def light_soft_sun_and_spot() -> None:
    empty()
    stage()
    plane(0.8, grey(), (0, 0, 0.4))
    lamp("SUN", rotation=(0.3, 0, 0), energy=2, angle=0.3)
    lamp("SPOT", (0, -1, 3), (-0.3, 0, 0), energy=100, shadow_soft_size=0.3, use_soft_falloff=False)


@scene
def world_image() -> None:
    _panorama(None)


@scene
def world_image_turned() -> None:
    _panorama((0.3, 0.5, 1.2))


def _panorama(turned: Any) -> None:
    empty()
    camera((0, -6, 3), (math.radians(75), 0, math.radians(20)), lens=18)
    tree = world()
    image = tree.nodes.new("ShaderNodeTexEnvironment")
    image.image = picture(128, 64, light=True)
    tree.links.new(image.outputs[0], tree.nodes["Background"].inputs[0])
    if turned is not None:
        mapping, place = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
        tree.links.new(place.outputs["Generated"], mapping.inputs[0])
        tree.links.new(mapping.outputs[0], image.inputs[0])
        mapping.inputs["Rotation"].default_value = turned
    plane(4, grey())
    ball((0, 0, 1), grey(0.5))


@scene
def image_texture() -> None:
    empty()
    camera((0, -3, 3), (math.radians(45), 0, 0), shift_x=0.15, shift_y=-0.1)
    paint = material()
    tree = paint.node_tree
    image, mapping, place = (tree.nodes.new(f"ShaderNode{name}") for name in ("TexImage", "Mapping", "UVMap"))
    image.image, image.interpolation = picture(64, 32), "Closest"
    mapping.inputs["Scale"].default_value = (2, 3, 1)
    mapping.inputs["Rotation"].default_value = (0, 0, 0.4)
    mapping.inputs["Location"].default_value = (0.1, 0.2, 0)
    tree.links.new(place.outputs[0], mapping.inputs[0])
    tree.links.new(mapping.outputs[0], image.inputs[0])
    tree.links.new(image.outputs[0], shader_of(paint).inputs["Color"])
    plane(4, paint)
    lamp("SUN", (0, 0, 5), energy=3)


@scene
def nodes_and_group() -> None:
    """An image that is mixed, multiplied and inverted on its way, inside a group."""
    empty()
    stage()
    paint = material()
    tree = paint.node_tree
    group = bpy.data.node_groups.new("Darker", "ShaderNodeTree")
    group.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketColor")
    group.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketColor")
    start, end, mix = (group.nodes.new(name) for name in ("NodeGroupInput", "NodeGroupOutput", "ShaderNodeMix"))
    mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
    factor, one, other = (each for each in mix.inputs if each.enabled)
    factor.default_value, other.default_value = 0.7, (0.9, 0.5, 0.2, 1)
    group.links.new(start.outputs[0], one)
    group.links.new(next(each for each in mix.outputs if each.enabled), end.inputs[0])
    inner, image, invert = (tree.nodes.new(f"ShaderNode{name}") for name in ("Group", "TexImage", "Invert"))
    inner.node_tree, image.image = group, picture(64, 32)
    tree.links.new(image.outputs[0], invert.inputs["Color"])
    tree.links.new(invert.outputs[0], inner.inputs[0])
    tree.links.new(inner.outputs[0], shader_of(paint).inputs["Color"])
    plane(2, paint, (0, 0, 0.2), (0.4, 0, 0.3))
    lamp("SUN", (0, 0, 5), energy=3)


def furnace(**inputs: Any) -> None:
    """A ball of Principled BSDF, lit alike from all sides."""
    empty()
    camera((0, -3, 0), (math.radians(90), 0, 0))
    ball((0, 0, 0), material("ShaderNodeBsdfPrincipled", **inputs))
    world((1, 1, 1, 1))


BROWN = (0.8, 0.4, 0.16, 1)


@scene
def principled_smooth() -> None:
    furnace(Base_Color=BROWN, Roughness=0.1)


@scene
def principled() -> None:
    furnace(Base_Color=BROWN, Roughness=0.5)


@scene
def principled_rough() -> None:
    furnace(Base_Color=BROWN, Roughness=1.0)


@scene
def principled_metal() -> None:
    furnace(Base_Color=BROWN, Roughness=0.3, Metallic=1.0)


@scene
def principled_glass() -> None:
    furnace(Base_Color=BROWN, Roughness=0.0, Transmission_Weight=1.0)


@scene
def principled_half_there() -> None:
    furnace(Base_Color=BROWN, Alpha=0.5)


@scene
def glass_and_gloss() -> None:
    empty()
    camera((0, -6, 2), (math.radians(75), 0, 0))
    plane(20, grey())
    ball((-1.1, 0, 1), material("ShaderNodeBsdfGlass", IOR=1.5))
    ball((1.1, 0, 1), material("ShaderNodeBsdfAnisotropic", Color=BROWN, Roughness=0.4))
    world((0.7, 0.8, 1, 1))


@scene
def seen_from_behind() -> None:
    empty()
    camera((0, -5, 3), (math.radians(60), 0, 0))
    plane(3, material(Color=BROWN), rotation=(math.pi, 0, 0))
    lamp("SUN", rotation=(0.3, 0.3, 0), energy=3)


@scene
def interior() -> None:
    """A room with a window of light: most of what is seen is indirect."""
    empty()
    camera((0, -3.6, 1.5), (math.radians(88), 0, 0), lens=24)
    bpy.ops.mesh.primitive_cube_add(size=4, location=(0, 0, 2))
    room = made_of(grey(0.7))
    room.scale = (1, 1.9, 1)
    ball((0.6, 0.5, 0.8), material("ShaderNodeBsdfPrincipled", Base_Color=BROWN), 0.8)
    lamp("AREA", (-1.9, -1, 2.5), (0, math.radians(-90), 0), energy=100, size=1.5)


def _bumpy_floor(kind: str) -> None:
    """A floor with an image of waves, as heights or as normals."""
    empty()
    camera((0, -2, 2), (math.radians(45), 0, 0))
    paint = grey()
    tree = paint.node_tree
    x = (np.arange(64) + 0.5) / 64 * 2 * math.pi
    waves = np.ones((64, 64, 4), np.float32)
    if kind == "Bump":
        waves[:, :, :3] = (0.5 + 0.5 * np.sin(2 * x)[None, :] * np.cos(x)[:, None])[..., None]
    else:
        slopes = np.stack([np.broadcast_to(0.5 * np.sin(2 * x), (64, 64)), np.tile(0.2 * np.cos(x)[:, None], 64)], -1)
        normals = np.concatenate([slopes, np.ones((64, 64, 1))], -1)
        waves[:, :, :3] = normals / np.linalg.norm(normals, axis=-1, keepdims=True) * 0.5 + 0.5
    pixels = bpy.data.images.new("Waves", 64, 64, float_buffer=True)
    pixels.pixels.foreach_set(waves.ravel())
    image, bend = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new(f"ShaderNode{kind}")
    image.image = pixels
    tree.links.new(image.outputs[0], bend.inputs["Height" if kind == "Bump" else "Color"])
    tree.links.new(bend.outputs[0], shader_of(paint).inputs["Normal"])
    if kind == "Bump":
        bend.inputs["Strength"].default_value, bend.inputs["Distance"].default_value = 0.6, 0.2
    else:
        bend.inputs["Strength"].default_value = 0.7
    plane(4, paint)
    lamp("SUN", rotation=(0.5, 0.4, 0), energy=3)


@scene
def normal_map() -> None:
    _bumpy_floor("NormalMap")


@scene
def bump_map() -> None:
    _bumpy_floor("Bump")


@scene
def color_attribute() -> None:
    empty()
    stage()
    paint = material()
    tree = paint.node_tree
    tree.links.new(tree.nodes.new("ShaderNodeVertexColor").outputs["Color"], shader_of(paint).inputs["Color"])
    tree.nodes[-1].layer_name = "Spots"
    thing = plane(2, paint, (0, 0, 0.3))
    spots = thing.data.color_attributes.new("Spots", "FLOAT_COLOR", "POINT")
    spots.data.foreach_set("color", [1, 0, 0, 1, 0, 1, 0, 1, 0, 0, 1, 1, 0.8, 0.8, 0.2, 1])
    lamp("SUN", rotation=(0.2, 0, 0), energy=3)


@scene
def coloured_glass() -> None:
    """A ball that absorbs light on its way through."""
    empty()
    camera((0, -4, 0), (math.radians(90), 0, 0))
    paint = material("ShaderNodeBsdfGlass", IOR=1.2)
    tree = paint.node_tree
    inside = tree.nodes.new("ShaderNodeVolumeAbsorption")
    inside.inputs["Color"].default_value, inside.inputs["Density"].default_value = (0.9, 0.4, 0.1, 1), 1.5
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(inside.outputs[0], output.inputs["Volume"])
    ball((0, 0, 0), paint)
    world((1, 1, 1, 1))


@scene
def cut_out() -> None:
    """A plane that an image makes holes in."""
    empty()
    stage()
    paint = material(Color=BROWN)
    tree = paint.node_tree
    mix, clear, image = (tree.nodes.new(f"ShaderNode{name}") for name in ("MixShader", "BsdfTransparent", "TexImage"))
    image.image, image.interpolation = picture(64, 32, light=True), "Closest"
    split = tree.nodes.new("ShaderNodeSeparateColor")
    tree.links.new(image.outputs[0], split.inputs[0])
    tree.links.new(split.outputs["Blue"], mix.inputs[0])
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(shader_of(paint).outputs[0], mix.inputs[2])
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    plane(2, paint, (0, 0, 0.5))
    lamp("SUN", rotation=(0.2, 0, 0), energy=3)


@scene
def curtains() -> None:
    """A sheet before the sun that is all cloth, and one that is half diffuse, above a floor that they light."""
    empty()
    stage()
    cloth = material("ShaderNodeBsdfTranslucent", Color=BROWN)
    plane(1.2, cloth, (-0.8, 0.3, 0.6), (math.radians(60), 0, 0))
    paper = material(Color=BROWN)
    tree = paper.node_tree
    mix, through = (tree.nodes.new(f"ShaderNode{name}") for name in ("MixShader", "BsdfTranslucent"))
    mix.inputs[0].default_value, through.inputs["Color"].default_value = 0.6, (0.7, 0.7, 0.3, 1)
    tree.links.new(shader_of(paper).outputs[0], mix.inputs[1])
    tree.links.new(through.outputs[0], mix.inputs[2])
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    plane(1.2, paper, (0.8, 0.3, 0.6), (math.radians(60), 0, 0))
    lamp("SUN", rotation=(-0.6, 0, 0), energy=3)
    world((0.2, 0.3, 0.4, 1))


@scene
def diffuse_under_gloss() -> None:
    empty()
    camera((0, -3, 0), (math.radians(90), 0, 0))
    paint = material(Color=BROWN)
    tree = paint.node_tree
    mix, gloss, fresnel = (tree.nodes.new(f"ShaderNode{name}") for name in ("MixShader", "BsdfAnisotropic", "Fresnel"))
    gloss.inputs["Roughness"].default_value, gloss.inputs["Color"].default_value = 0.2, (1, 1, 1, 1)
    tree.links.new(fresnel.outputs[0], mix.inputs[0])
    tree.links.new(shader_of(paint).outputs[0], mix.inputs[1])
    tree.links.new(gloss.outputs[0], mix.inputs[2])
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    ball((0, 0, 0), paint)
    world((1, 1, 1, 1))
