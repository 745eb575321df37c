"""Materials as one table, a node of a scattering tree a row, for kernels and for the wire."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.model.bsdfs import (
    LEAVES,
    Blend,
    Bsdf,
    BumpMap,
    Distribution,
    Leaf,
    Mask,
    NormalMap,
    TwoSided,
)
from wdpm.scenes.model.leaf_kind import BLACK, SLOTS, LeafKind, Row
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Color, Number, Texture, VertexColors

# Kinds of inner nodes.
TWO_SIDED: Final = 16
"""child 0: the front's node, child 1: the back's, seen from behind as if that were its front."""
MASK: Final = 17
BLEND: Final = 18
BUMP_MAP: Final = 19
NORMAL_MAP: Final = 20

LEAF_KINDS: Final = {leaf.KIND.number: leaf.KIND for leaf in LEAVES}
"""Kinds of leaves by their numbers."""

NO_MEDIUM: Final = -1


@dataclass(frozen=True, eq=False)
class MaterialTable:
    """All materials. The first rows are the materials that triangles name; nodes inside them follow.

    A leaf's parameters are in the slots of its LeafKind; of an inner node slot 0 is an opacity, a weight, a height
    (times its scale) or normals, and slot 1 Mask.cutoff or NormalMap.along_v.

    Attributes:
        kind: of leaves, scenes.model.leaf_kind; of inner nodes, the numbers above; int32, shape [N].
        child: nodes inside, -1 where there are none, int32, shape [N, 2].
        distribution: of microfacets, 0 Beckmann, 1 GGX, int32, shape [N].
        value: float32, shape [N, SLOTS, 3].
        texture: index into the textures or -1, int32, shape [N, SLOTS].
        medium: media inside (behind the surface) and outside, -1 for none, int32, shape [N, 2]; -2, -2 where the
            surface bounds no medium and a ray that crosses it stays in the one that it is in.
    """

    kind: NDArray[np.int32]
    child: NDArray[np.int32]
    distribution: NDArray[np.int32]
    value: NDArray[np.float32]
    texture: NDArray[np.int32]
    medium: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.kind)

    def leaf(self, node: int) -> tuple[LeafKind, Row] | None:
        """The kind of a node that is a leaf, and its row; None for inner nodes and for black."""
        kind = LEAF_KINDS.get(int(self.kind[node]))
        return None if kind is None else (kind, kind.row(self.value[node], self.texture[node]))


SAME_MEDIUM: Final = -2
"""In MaterialTable.medium: the surface bounds no medium."""

Boundary = tuple[Bsdf, int, int]
"""A material, the medium inside and the one outside (as in MaterialTable.medium)."""


def tabulate(materials: Sequence[Boundary]) -> tuple[MaterialTable, tuple[Texture, ...]]:
    """The table of some materials, and the textures that it names, each once."""
    writer = _Writer(len(materials))
    for row, (bsdf, _, _) in enumerate(materials):
        writer.write(row, bsdf)
    medium = np.full((len(writer.kind), 2), SAME_MEDIUM, np.int32)
    medium[: len(materials)] = np.array([(inside, outside) for _, inside, outside in materials], np.int32).reshape(
        -1, 2
    )
    table = MaterialTable(
        np.array(writer.kind, np.int32),
        np.array(writer.child, np.int32).reshape(-1, 2),
        np.array(writer.distribution, np.int32),
        np.array(writer.value, np.float32).reshape(-1, SLOTS, 3),
        np.array(writer.texture, np.int32).reshape(-1, SLOTS),
        medium,
    )
    return table, tuple(writer.textures)


class _Writer:
    """Rows of the table while it grows."""

    def __init__(self, roots: int) -> None:
        self.kind = [BLACK] * roots
        self.child = [[-1, -1] for _ in range(roots)]
        self.distribution = [0] * roots
        self.value = [np.zeros((SLOTS, 3), np.float32) for _ in range(roots)]
        self.texture = [[-1] * SLOTS for _ in range(roots)]
        self.textures: list[Texture] = []
        self._number: dict[int, int] = {}

    def _new(self) -> int:
        self.kind.append(BLACK)
        self.child.append([-1, -1])
        self.distribution.append(0)
        self.value.append(np.zeros((SLOTS, 3), np.float32))
        self.texture.append([-1] * SLOTS)
        return len(self.kind) - 1

    def write(self, row: int, bsdf: Bsdf) -> None:
        """Fill a row, and append those of the nodes inside."""
        _WRITERS[type(bsdf)](self, row, bsdf)

    def put(self, row: int, slot: int, value: Color | Number | bool, factor: float = 1.0) -> None:
        """A parameter: a value, or a texture."""
        if isinstance(value, Bitmap | Checkerboard | VertexColors):
            if id(value) not in self._number:
                self._number[id(value)] = len(self.textures)
                self.textures.append(value)
            self.texture[row][slot] = self._number[id(value)]
            self.value[row][slot] = factor
        else:
            self.value[row][slot] = np.multiply(value, factor)

    def nest(self, row: int, place: int, bsdf: Bsdf) -> None:
        """A node inside."""
        inner = self._new()
        self.child[row][place] = inner
        self.write(inner, bsdf)


def _leaf(table: _Writer, row: int, b: Leaf) -> None:
    table.kind[row] = b.KIND.number
    table.distribution[row] = int(getattr(b, "distribution", None) is Distribution.GGX)
    for name, slot in b.KIND.slots.items():
        table.put(row, slot, getattr(b, name))


def _two_sided(table: _Writer, row: int, b: TwoSided) -> None:
    table.kind[row] = TWO_SIDED
    table.nest(row, 0, b.front)
    if b.back is None:
        table.child[row][1] = table.child[row][0]
    else:
        table.nest(row, 1, b.back)


def _mask(table: _Writer, row: int, b: Mask) -> None:
    table.kind[row] = MASK
    table.put(row, 0, b.opacity)
    table.put(row, 1, b.cutoff)
    table.nest(row, 0, b.nested)


def _blend(table: _Writer, row: int, b: Blend) -> None:
    table.kind[row] = BLEND
    table.put(row, 0, b.weight)
    table.nest(row, 0, b.first)
    table.nest(row, 1, b.second)


def _bump_map(table: _Writer, row: int, b: BumpMap) -> None:
    table.kind[row] = BUMP_MAP
    table.put(row, 0, b.height, b.scale)
    table.nest(row, 0, b.nested)


def _normal_map(table: _Writer, row: int, b: NormalMap) -> None:
    table.kind[row] = NORMAL_MAP
    table.put(row, 0, b.normals)
    table.put(row, 1, b.along_v)
    table.nest(row, 0, b.nested)


_WRITERS: dict[type, Callable[..., None]] = {
    **dict.fromkeys(LEAVES, _leaf),
    TwoSided: _two_sided,
    Mask: _mask,
    Blend: _blend,
    BumpMap: _bump_map,
    NormalMap: _normal_map,
}
