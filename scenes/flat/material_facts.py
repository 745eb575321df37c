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


@dataclass(frozen=True, kw_only=True)
class MaterialFacts:
    """What is anywhere in a material's tree. Names that kernels.features.Features has mean the same here.

    Attributes:
        rough: a conductor, dielectric or plastic whose roughness is not 0; PRINCIPLED needs no such flag.
        passing: light may go straight through: a mask, a boundary of media, a thin dielectric.
        diffuse: photons are stored on it, on one side at least.
        transmits: some light may get to the other side.
    """

    conductor: bool
    dielectric: bool
    thin_dielectric: bool
    plastic: bool
    principled: bool
    rough: bool
    blend: bool
    passing: bool
    bent: bool
    bitmaps: bool
    checkerboards: bool
    vertex_colors: bool
    diffuse: bool
    transmits: bool

    @property
    def glossy(self) -> bool:
        """It has a part that is traced on, not gathered."""
        return self.conductor or self.dielectric or self.thin_dielectric or self.plastic or self.principled


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
    kinds = {int(kind) for kind in table.kind[nodes]}
    read = [textures[number] for number in np.unique(table.texture[nodes]) if number >= 0]
    refracts = any(table.kind[node] == mt.PRINCIPLED and table.value[node, 5, 0] > 0.0 for node in nodes)
    return MaterialFacts(
        conductor=mt.CONDUCTOR in kinds,
        dielectric=mt.DIELECTRIC in kinds,
        thin_dielectric=mt.THIN_DIELECTRIC in kinds,
        plastic=mt.PLASTIC in kinds,
        principled=mt.PRINCIPLED in kinds,
        rough=any(_is_rough(table, int(node)) for node in nodes),
        blend=mt.BLEND in kinds,
        passing=bool(kinds & {mt.MASK, mt.NULL, mt.THIN_DIELECTRIC}),
        bent=bool(kinds & {mt.BUMP_MAP, mt.NORMAL_MAP}),
        bitmaps=any(isinstance(texture, Bitmap) for texture in read),
        checkerboards=any(isinstance(texture, Checkerboard) for texture in read),
        vertex_colors=any(isinstance(texture, VertexColors) for texture in read),
        diffuse=diffuse,
        transmits=refracts or bool(kinds & {mt.DIELECTRIC, mt.THIN_DIELECTRIC, mt.NULL, mt.MASK}),
    )


def _is_rough(table: MaterialTable, node: int) -> bool:
    kind, value = int(table.kind[node]), table.value[node]
    if kind in (mt.CONDUCTOR, mt.DIELECTRIC):
        return bool(value[3, 0] > 0.0 or value[4, 0] > 0.0)
    return kind == mt.PLASTIC and bool(value[3, 0] > 0.0)
