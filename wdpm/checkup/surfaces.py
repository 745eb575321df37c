"""Checks of how the triangles of a mesh hang together: edges, sides, closed bodies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.checkup.findings import Finding, Level
from wdpm.checkup.part import Part, is_two_sided
from wdpm.checkup.soup import Bools, Ints, Soup, edges_of, pieces, volumes
from wdpm.scenes.meshes.framing import glows
from wdpm.scenes.model.scene import Scene

FLAT_VOLUME = 1e-6
"""A piece that encloses less than this share of its bounding box' volume has neither inside nor outside."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed piece of a mesh.

    Attributes:
        mesh: the mesh it is of.
        triangles: rows of the soup.
        inside_out: whether its front faces inwards.
        low, high: its bounding box, shape [3] each.
    """

    mesh: int
    triangles: Ints
    inside_out: bool
    low: NDArray[np.float64]
    high: NDArray[np.float64]


def check_surface(
    part: Part, cause: NDArray[np.int8], solids: list[Solid], open_rims: set[tuple[int, int]]
) -> Iterator[Finding]:
    """Edges and sides of a mesh; its closed pieces are added to `solids`.

    Args:
        open_rims: open edges of all meshes that enclose something, taken together.
    """
    kept = np.flatnonzero(cause[part.rows] == 0)
    if not len(kept):
        return
    rows = kept + part.rows.start
    vertex = np.unique(part.soup.vertex[rows], return_inverse=True)[1].reshape(-1, 3)
    edges = edges_of(vertex, _against_winding(part, rows))
    yield from _crowded(part, kept, edges.at(edges.crowded), int(edges.crowded.sum()))
    torn = edges.at(edges.torn)
    if len(torn):
        yield _torn(part, kept[torn], int(edges.torn.sum()))
    if part.encloses and edges.open.any():
        places = np.unique(part.soup.vertex[rows])[edges.ends[edges.open]]
        alone = np.array([tuple(ends) in open_rims for ends in places.tolist()])
        if alone.any():
            chosen = edges.open.copy()
            chosen[np.flatnonzero(edges.open)[~alone]] = False
            yield _open(part, kept[edges.at(chosen)], int(alone.sum()))
    piece = pieces(edges)
    size = int(piece.max()) + 1
    closed = np.bincount(piece, (edges.uses[edges.of] % 2 != 0).any(axis=1), size) == 0
    closed &= np.bincount(piece, edges.torn[edges.of].any(axis=1), size) == 0
    volume = volumes(part.soup.positions[rows], part.soup.front[rows], piece)
    order = np.argsort(piece, kind="stable")
    begin = np.searchsorted(piece[order], np.arange(size))
    corners = part.soup.positions[rows[order]].astype(np.float64)
    low = np.minimum.reduceat(corners.min(axis=1), begin)
    high = np.maximum.reduceat(corners.max(axis=1), begin)
    closed &= np.abs(volume) > FLAT_VOLUME * np.prod(high - low, axis=1)
    backwards = closed & (volume < 0)
    for number, mine in enumerate(np.split(rows[order], begin[1:])):
        if closed[number]:
            solids.append(Solid(part.number, mine, bool(backwards[number]), low[number], high[number]))
    yield from _inside_out(part, kept[backwards[piece]], int(backwards.sum()))


def _against_winding(part: Part, rows: Ints) -> Bools:
    """Triangles whose front, by their normals, is not where their corners go counter-clockwise."""
    p = part.soup.positions[rows].astype(np.float64)
    winding = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return np.asarray(np.einsum("ij,ij->i", winding, part.soup.front[rows]) < 0)


def _crowded(part: Part, kept: Ints, triangles: Ints, edges: int) -> Iterator[Finding]:
    if not edges:
        return
    level = Level.WARNING if part.encloses else Level.NOTE
    texts = (
        "edges at which three triangles or more meet",
        "needs no manifold: no ray slips through"
        + ("; but inside and outside are not told apart everywhere" if part.encloses else ""),
        "split the mesh there, if it is to enclose something" if part.encloses else "",
    )
    yield part.finding(level, "non-manifold", texts, kept[triangles], count=edges, total=None)


def _torn(part: Part, triangles: Ints, edges: int) -> Finding:
    matters = part.encloses or glows(part.mesh) or not is_two_sided(part.bsdf)
    texts = (
        "neighbouring triangles that face opposite ways",
        "takes each for what it says: some are black, dark or inside out" if matters else "sees both sides alike",
        "mend the mesh file with --fix" if matters else "",
    )
    level = Level.WARNING if matters else Level.NOTE
    return part.finding(level, "winding", texts, triangles, count=edges, total=None, detail="edges")


def _open(part: Part, triangles: Ints, edges: int) -> Finding:
    what = "boundary of a medium" if part.mesh.bounds else "body of glass"
    texts = (
        f"holes in what should be the closed {what}",
        "lets light in and out there without refraction or change of medium",
        "close it; use thindielectric for panes and films without thickness",
    )
    return part.finding(Level.WARNING, "open-solid", texts, triangles, count=edges, total=None, detail="open edges")


def _inside_out(part: Part, triangles: Ints, bodies: int) -> Iterator[Finding]:
    if not bodies or not (part.encloses or glows(part.mesh)):
        return
    does = "shines into the body only"
    if part.encloses:
        does = "takes the inside for the outside: light is refracted the wrong way"
    texts = (
        "closed bodies whose front faces inwards",
        does,
        "mend the mesh file with --fix, or set flip_normals in a Mitsuba scene",
    )
    yield part.finding(Level.WARNING, "inside-out", texts, triangles, count=bodies, total=None)


def rims(scene: Scene, soup: Soup, cause: NDArray[np.int8]) -> set[tuple[int, int]]:
    """Open edges of all meshes that enclose something, taken together: several may make one body."""
    chosen = [number for number in range(len(scene.meshes)) if Part(scene, soup, number).encloses]
    if not chosen:
        return set()
    rows = np.flatnonzero(np.isin(soup.mesh, chosen) & (cause == 0))
    edges = edges_of(soup.vertex[rows])
    return {(int(a), int(b)) for a, b in edges.ends[edges.open]}
