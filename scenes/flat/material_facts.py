"""What each material of a table calls for: from this follows what kernels are compiled for, and because of what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat import material_table as mt
from wdpm.scenes.flat.material_sides import gathering_sides
from wdpm.scenes.flat.material_table import MaterialTable
from wdpm.scenes.flat.material_ways import check_bumps, root_of, roots
from wdpm.scenes.model.textures import Bitmap, Checkerboard, Texture, VertexColors

_OF_NODES: dict[int, str] = {mt.BLEND: "blend", mt.MASK: "passing", mt.BUMP_MAP: "bent", mt.NORMAL_MAP: "bent"}

_OF_TEXTURES: dict[type[Texture], str] = {
    Bitmap: "bitmaps",
    Checkerboard: "checkerboards",
    VertexColors: "vertex_colors",
}


@dataclass(frozen=True)
class MaterialFacts:
    """What is anywhere in a material's tree.

    Attributes:
        features: fields of kernels.features.Features that it calls for.
        diffuse: photons are stored on it, on one side at least.
        glossy: it has a part that is traced on, not gathered.
        transmits: some light may get to the other side.
    """

    features: frozenset[str]
    diffuse: bool
    glossy: bool
    transmits: bool

    def calls_for(self, name: str) -> bool:
        """Whether it calls for a feature, or is "diffuse" or "glossy"."""
        return name in self.features or {"diffuse": self.diffuse, "glossy": self.glossy}.get(name, False)


def features_of_texture(texture: Texture) -> set[str]:
    """The fields of kernels.features.Features that a texture calls for."""
    tint = {"vertex_colors"} if isinstance(texture, Bitmap) and texture.tinted else set()
    return {_OF_TEXTURES[type(texture)]} | tint


def facts(table: MaterialTable, textures: Sequence[Texture]) -> tuple[MaterialFacts, ...]:
    """The facts of each material, in the order of the table's roots.

    Raises:
        SceneError: a bump map that has no slope (scenes.flat.material_ways.check_bumps).
    """
    check_bumps(table, textures)
    root, sides = root_of(table), gathering_sides(table)
    return tuple(_facts_of(table, textures, np.nonzero(root == row)[0], bool(sides[row])) for row in roots(table))


def _facts_of(
    table: MaterialTable, textures: Sequence[Texture], nodes: NDArray[np.intp], diffuse: bool
) -> MaterialFacts:
    leaves = [leaf for leaf in map(table.leaf, nodes.tolist()) if leaf is not None]
    holes = bool((table.kind[nodes] == mt.MASK).any())
    features = {kind.feature for kind, _ in leaves if kind.feature is not None}
    features |= {"rough" for kind, row in leaves if kind.is_rough(row)}
    features |= {"passing" for kind, _ in leaves if kind.straight}
    features |= {_OF_NODES[kind] for kind in table.kind[nodes].tolist() if kind in _OF_NODES}
    for number in np.unique(table.texture[nodes]).tolist():
        features |= features_of_texture(textures[number]) if number >= 0 else set()
    return MaterialFacts(
        features=frozenset(features),
        diffuse=diffuse,
        glossy=any(kind.glossy for kind, _ in leaves),
        transmits=holes or any(kind.transmits(row) for kind, row in leaves),
    )
