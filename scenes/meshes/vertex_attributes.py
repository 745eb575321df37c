"""Attributes of vertices: how files name them, and which of them a mesh's materials read."""

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
    columns: Mapping[str, NDArray[np.float64]], whole: Mapping[str, int]
) -> dict[str, VertexAttribute]:
    """The attributes that columns of a PLY file make up, by the names that Mitsuba 3 gives them.

    `red green blue` (or r g b) is "vertex_color"; `foo_r foo_g foo_b` is "vertex_foo_color"; `foo_0 foo_1 ...` and
    `foo_x foo_y ...` are "vertex_foo".

    Args:
        columns: values by property, each of shape [V].
        whole: the largest value of the properties that are whole numbers.
    """
    groups: dict[str, list[str]] = {}
    for names in _COLOR_NAMES:
        if all(name in columns for name in names):
            groups.setdefault(VERTEX_COLOR, list(names))
    for name in columns:
        base, _, channel = name.rpartition("_")
        kind = next((kind for kind in _CHANNELS if base and len(channel) == 1 and channel in kind), None)
        if kind is not None:
            groups.setdefault(f"vertex_{base}_color" if kind == "rgba" else f"vertex_{base}", []).append(name)
    return {group: _attribute(columns, names, whole) for group, names in groups.items()}


def _attribute(
    columns: Mapping[str, NDArray[np.float64]], names: Sequence[str], whole: Mapping[str, int]
) -> VertexAttribute:
    scaled = [columns[name] / whole.get(name, 1) for name in names]
    return VertexAttribute(np.stack(scaled, axis=1), coded=all(name in whole for name in names))


def colors_of(mesh: MeshData, names: Iterable[str]) -> NDArray[np.float64] | None:
    """The colours that go with a mesh (Mesh.colors) whose materials read these attributes, shape [V, 3].

    The values are as in the file, without decoding, as in Mitsuba. One channel is spread over three, a fourth dropped.

    Args:
        names: of attributes (bsdfs.vertex_attributes).

    Returns:
        None if there are no names.

    Raises:
        ValueError: more than one name, or one that the mesh does not have.
    """
    wanted = sorted(names)
    if not wanted:
        return None
    if len(wanted) > 1:
        raise ValueError(f"its materials read several attributes of vertices ({', '.join(wanted)}); one is supported")
    if wanted[0] not in mesh.attributes:
        has = f"it has {', '.join(mesh.attributes)}" if mesh.attributes else "it has none"
        raise ValueError(f'the mesh has no attribute "{wanted[0]}" ({has})')
    values = mesh.attributes[wanted[0]].values
    return np.repeat(values[:, :1], 3, axis=1) if values.shape[1] < 3 else values[:, :3]


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
