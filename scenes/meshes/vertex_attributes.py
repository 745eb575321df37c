"""Attributes of vertices and faces: how files name them, and which of them a mesh's materials read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.images.read import srgb_to_linear
from wdpm.scenes.meshes.mesh_data import MeshData, VertexAttribute

VERTEX_COLOR: Final = "vertex_color"
_COLOR_NAMES: Final = (("r", "g", "b"), ("red", "green", "blue"))
_CHANNELS: Final = ("rgba", "0123", "xyzw")


def named_attributes(
    columns: Mapping[str, NDArray[np.float64]], whole: Mapping[str, int], element: str = "vertex"
) -> dict[str, VertexAttribute]:
    """The attributes that columns of a PLY file make up, by the names that Mitsuba 3 gives them.

    `red green blue` (or r g b) is "vertex_color"; `foo_r foo_g foo_b` is "vertex_foo_color"; `foo_0 foo_1 ...` and
    `foo_x foo_y ...` are "vertex_foo".

    Args:
        columns: values by property, each of shape [V].
        whole: the largest value of the properties that are whole numbers.
        element: what they are of, "vertex" or "face", which names begin with.
    """
    groups = grouped(columns, element)
    return {group: _attribute(columns, names, whole) for group, names in groups.items()}


def grouped(properties: Iterable[str], element: str) -> dict[str, list[str]]:
    """Which properties of an element make up which attribute."""
    names = list(properties)
    groups: dict[str, list[str]] = {}
    for channels in _COLOR_NAMES:
        if all(name in names for name in channels):
            groups.setdefault(f"{element}_color", list(channels))
    for name in names:
        base, _, channel = name.rpartition("_")
        kind = next((kind for kind in _CHANNELS if base and len(channel) == 1 and channel in kind), None)
        if kind is not None:
            groups.setdefault(f"{element}_{base}_color" if kind == "rgba" else f"{element}_{base}", []).append(name)
    return groups


def _attribute(
    columns: Mapping[str, NDArray[np.float64]], names: Sequence[str], whole: Mapping[str, int]
) -> VertexAttribute:
    scaled = [columns[name] / whole.get(name, 1) for name in names]
    return VertexAttribute(np.stack(scaled, axis=1), coded=all(name in whole for name in names))


def with_colors(mesh: MeshData, names: Iterable[str]) -> tuple[MeshData, NDArray[np.float64] | None]:
    """A mesh with the colours that go with it (Mesh.colors) where its materials read these attributes, shape [V, 3].

    The values are as in the file, without decoding, as in Mitsuba. One channel is spread over three, a fourth dropped.
    Where they are of faces, every face of the mesh that is returned has vertices of its own.

    Args:
        names: of attributes (bsdfs.vertex_attributes).

    Returns:
        The mesh; its colours, None if there are no names.

    Raises:
        ValueError: more than one name, or one that the mesh does not have.
    """
    wanted = sorted(names)
    if not wanted:
        return mesh, None
    if len(wanted) > 1:
        raise ValueError(f"its materials read several attributes of its mesh ({', '.join(wanted)}); one is supported")
    known = {**mesh.attributes, **mesh.face_attributes}
    if wanted[0] not in known:
        has = f"it has {', '.join(known)}" if known else "it has none"
        raise ValueError(f'the mesh has no attribute "{wanted[0]}" ({has})')
    values = known[wanted[0]].values
    colors = np.repeat(values[:, :1], 3, axis=1) if values.shape[1] < 3 else values[:, :3]
    if wanted[0] in mesh.attributes:
        return mesh, colors
    return mesh.apart(), np.repeat(colors, 3, axis=0)


def screen_colors(mesh: MeshData) -> NDArray[np.float64] | None:
    """The vertex colours of a file that comes alone, as linear RGB, shape [V, 3]; None without usable ones.

    Colours that are coded for the screen, as whole numbers are, are decoded from sRGB.
    """
    attribute = mesh.attributes.get(VERTEX_COLOR)
    if attribute is None or attribute.values.shape[1] < 3:
        return None
    values = attribute.values[:, :3]
    if not (np.isfinite(values).all() and values.min(initial=0.0) >= 0.0 and values.max(initial=0.0) <= 1.0):
        return None
    return srgb_to_linear(values) if attribute.coded else values
