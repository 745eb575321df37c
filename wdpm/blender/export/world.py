"""Blender's world: light that arrives from far away."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.blender.export.images import Images
from wdpm.blender.export.notes import Notes
from wdpm.blender.export.shaders import Shaders
from wdpm.blender.export.sockets import Output, Socket, surface_output
from wdpm.blender.export.values import Value, Values, constant
from wdpm.scenes.model.lights import Environment
from wdpm.scenes.model.textures import Bitmap

Array = NDArray[np.float64]

TO_BLENDER = np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From the axes of our environments, whose top is +y and u = atan2(x, -z) / 2 pi, to Blender's, whose top is +z and
u = 1/2 - atan2(y, x) / 2 pi."""

_SKY = (0.2, 0.35, 0.6)
"""Stands for a sky that is computed by nodes."""


def read_world(world: Any, images: Images, notes: Notes) -> Environment | None:
    """The environment; None where the world is black."""
    if world is None:
        return None
    if not world.use_nodes or world.node_tree is None:
        return _environment(world.name, np.array(world.color, np.float64)[None, None], np.eye(3))
    output = surface_output(world.node_tree, "ShaderNodeOutputWorld")
    if output is None:
        return None
    if output.input("Volume").source is not None:
        notes.add(f'world "{world.name}"', "its volume is left out")
    values = _WorldValues(f'world "{world.name}"', images, notes)
    emission = Shaders(values).read(output.input("Surface")).emission
    if emission is None:
        return None
    pixels = emission.array if emission.image is not None else emission.array[None, None]
    return _environment(world.name, pixels, values.turned)


def _environment(name: str, pixels: Array, turned: Array) -> Environment | None:
    light = np.maximum(pixels, 0.0).astype(np.float32)
    if not light.max(initial=0.0) > 0.0:
        return None
    to_world = np.eye(4)
    to_world[:3, :3] = turned.T
    return Environment(name, np.ascontiguousarray(light), to_world @ TO_BLENDER)


class _WorldValues(Values):
    """Reads the sockets of a world, whose images are looked up by direction.

    Attributes:
        turned: rotation from a direction in the world to that in which its image is looked up, shape [3, 3].
    """

    def __init__(self, owner: str, images: Images, notes: Notes) -> None:
        super().__init__(owner, images, notes)
        self.turned: Array = np.eye(3)

    def read(self, socket: Socket) -> Value:
        source = socket.source
        if source is not None and source.kind == "ShaderNodeTexEnvironment":
            return self._panorama(source)
        if source is not None and source.kind == "ShaderNodeTexSky":
            self.note("Sky Texture is not supported: a plain blue stands for it; bake it to an image to keep its sun")
            return constant(_SKY)
        return super().read(socket)

    def _panorama(self, source: Output) -> Value:
        node = source.node
        pixels = None if node.image is None else self.images.read(node.image)
        if pixels is None:
            self.note("an environment texture has no image: it is black")
            return constant(0.0)
        if node.projection != "EQUIRECTANGULAR":
            self.note("mirror balls are not supported: the image is taken as equirectangular")
        self.turned = self._rotation(source.input("Vector"))
        return Value(pixels[0].astype(np.float64), Bitmap(node.image.name, pixels[0]))

    def _rotation(self, vector: Socket) -> Array:
        """What Mapping turns directions by on their way to the image."""
        source = vector.source
        if source is None:
            return np.eye(3)
        if source.kind == "ShaderNodeTexCoord" and source.socket.name in ("Generated", "Object"):
            return np.eye(3)
        if source.kind != "ShaderNodeMapping":
            self.note(f"an environment placed by {source.label} is not supported: it is not turned")
            return np.eye(3)
        angles = source.input("Rotation")
        scale = source.input("Scale")
        if scale.source is not None or tuple(scale.default) != (1.0, 1.0, 1.0):
            self.note("Mapping that scales an environment is not supported: it only turns")
        if angles.source is not None:
            self.note("Rotation of Mapping is computed by nodes: that is ignored")
            return self._rotation(source.input("Vector"))
        turn = euler_matrix(angles.default)
        if source.node.vector_type == "TEXTURE":
            turn = turn.T
        return turn @ self._rotation(source.input("Vector"))


def euler_matrix(angles: tuple[float, ...]) -> Array:
    """Blender's rotation by XYZ Euler angles [radians]: about x first, then y, then z."""
    (cx, cy, cz), (sx, sy, sz) = ([function(angle) for angle in angles[:3]] for function in (math.cos, math.sin))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(about_z @ about_y @ about_x)
