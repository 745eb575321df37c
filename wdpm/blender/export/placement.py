"""Where on a surface an image lies: what feeds the Vector of its node."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.blender.export.notes import Notes
from wdpm.blender.export.sockets import Socket


@dataclass(frozen=True, eq=False)
class Placement:
    """A map of texture coordinates.

    Attributes:
        uv_map: name of the UV map, "" for the active one.
        to_uv: affine, shape [3, 3], as that of scenes.model.Bitmap.
    """

    uv_map: str = ""
    to_uv: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))


def read_placement(vector: Socket, owner: str, notes: Notes) -> Placement:
    """What UV map feeds a texture, and how it is moved on the way.

    Args:
        owner: the material, for notes.
    """
    source = vector.source
    if source is None:
        return Placement()
    if source.kind == "ShaderNodeUVMap":
        return Placement(source.node.uv_map)
    if source.kind == "ShaderNodeMapping":
        inner = read_placement(source.input("Vector"), owner, notes)
        return Placement(inner.uv_map, _mapping(source, owner, notes) @ inner.to_uv)
    if source.kind == "ShaderNodeTexCoord" and source.socket.name == "UV":
        return Placement()
    what = f'"{source.socket.name}" of {source.label}'
    notes.add(owner, f"textures placed by {what} are not supported: its UV map is used")
    return Placement()


def _mapping(source: Any, owner: str, notes: Notes) -> NDArray[np.float64]:
    """What a Mapping node does to u and v."""
    location, rotation, scale = (_constant(source, name, owner, notes) for name in ("Location", "Rotation", "Scale"))
    if rotation[0] or rotation[1]:
        notes.add(owner, "Mapping turns an image out of its plane: that is ignored")
    c, s = math.cos(rotation[2]), math.sin(rotation[2])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    size = np.diag([scale[0], scale[1], 1.0])
    move = np.array([[1.0, 0.0, location[0]], [0.0, 1.0, location[1]], [0.0, 0.0, 1.0]])
    matrix: NDArray[np.float64] = move @ turn @ size
    if source.node.vector_type == "TEXTURE":
        return np.asarray(np.linalg.inv(matrix), np.float64) if scale[0] and scale[1] else np.eye(3)
    return matrix if source.node.vector_type == "POINT" else np.asarray(turn @ size)


def _constant(source: Any, name: str, owner: str, notes: Notes) -> tuple[float, ...]:
    neutral = (1.0, 1.0, 1.0) if name == "Scale" else (0.0, 0.0, 0.0)
    if source.node.vector_type == "VECTOR" and name == "Location":
        return neutral  # the socket is not in use
    socket = source.input(name)
    if socket.source is not None:
        notes.add(owner, f"{name} of Mapping is computed by nodes: that is ignored")
        return neutral
    return tuple(float(value) for value in socket.default)
