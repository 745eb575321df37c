"""Checks of single triangles: area, shape, copies, vertex normals, proportion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from wdpm.checkup.findings import Finding, Level
from wdpm.checkup.part import Part, is_two_sided, looks
from wdpm.checkup.soup import Soup
from wdpm.scenes.flat.dropped import NO_NORMAL, ZERO_AREA, have_area
from wdpm.scenes.model.scene import Scene

NEEDLE = 1e4
"""Aspect ratio (longest edge over the height on it) above which a triangle's normal has lost four of seven digits."""

SPIKE = 1e6
"""A triangle so many times larger than the median one is most likely a wrong vertex."""


def check_triangles(part: Part, cause: NDArray[np.int8], longest: NDArray[np.float64]) -> Iterator[Finding]:
    """Triangles without area, needles, copies."""
    rows = part.rows
    total = len(part.mesh.faces)
    missing = total - (rows.stop - rows.start)
    if missing:
        texts = ("triangles with a corner that is not finite or does not exist", "refuses the scene", "mend the file")
        yield part.finding(Level.ERROR, "broken-triangles", texts, count=missing, total=total)
    if not total:
        texts = ("a mesh without triangles", "nothing of it is seen", "remove it, or find out where they went")
        yield part.finding(Level.WARNING, "empty-mesh", texts)
    flat = np.flatnonzero(cause[rows] == ZERO_AREA)
    small = have_area(part.mesh, part.soup.row[rows][flat])
    lost, flat = flat[small], flat[~small]
    if len(lost):
        texts = (
            "triangles too small beside the whole scene to have an area in single precision",
            "leaves them out: holes where they were",
            "look for what lies far off (a stray vertex, a large ground), and remove it or make it smaller",
        )
        yield part.finding(Level.WARNING, "too-small", texts, lost)
    if len(flat):
        texts = (
            "triangles without area",
            "leaves them out",
            "leave them, or drop them from the mesh file with --fix: nothing is lost",
        )
        yield part.finding(Level.WARNING, "zero-area", texts, flat)
    tiny = np.flatnonzero(cause[rows] == NO_NORMAL)
    if len(tiny):
        texts = (
            "triangles too small for a normal in single precision",
            "leaves them out: pinholes where they were",
            "scale the scene so that its smallest detail is above 1e-18 units",
        )
        yield part.finding(Level.WARNING, "no-normal", texts, tiny)
    yield from _needles(part, cause[rows], longest[rows])


def _needles(part: Part, cause: NDArray[np.int8], longest: NDArray[np.float64]) -> Iterator[Finding]:
    doubled = np.linalg.norm(part.soup.front[part.rows], axis=1)  # twice the area: longest edge times height
    needle = np.flatnonzero((cause == 0) & (longest**2 > NEEDLE * doubled))
    if len(needle):
        worst = float((longest[needle] ** 2 / doubled[needle]).max())
        texts = (
            f"needles: more than {NEEDLE:,.0f} times longer than wide",
            "hits them exactly where they are; the direction they face is as good as the file's digits",
            "triangulate anew, if they show as streaks",
        )
        yield part.finding(Level.WARNING, "needles", texts, needle, detail=f"up to 1:{worst:.2g}")


def check_copies(scene: Scene, soup: Soup, cause: NDArray[np.int8]) -> Iterator[Finding]:
    """Triangles with the same three corners, in one mesh or in several."""
    kept = np.flatnonzero(cause == 0)
    corners = np.sort(soup.vertex[kept], axis=1)
    order = np.lexsort((kept, corners[:, 2], corners[:, 1], corners[:, 0]))
    new = np.concatenate([[True], (np.diff(corners[order], axis=0) != 0).any(axis=1)])
    group = np.cumsum(new) - 1
    first = kept[order[np.flatnonzero(new)]][group]
    hidden = kept[order]
    copies = hidden != first
    hidden, first = hidden[copies], first[copies]
    look = looks(scene)
    other = look[soup.mesh[hidden]] != look[soup.mesh[first]]
    facing = np.einsum("ij,ij->i", soup.front[hidden], soup.front[first]) > 0
    kinds = (
        (
            "duplicates",
            ~other & facing,
            "triangles that are there twice",
            "sees the first of them; the others are dead",
        ),
        (
            "back-to-back",
            ~other & ~facing,
            "pairs of triangles back to back in the same place",
            "sees the first of each pair, from both sides: black from behind, if it is one-sided",
        ),
        (
            "coplanar",
            other,
            "triangles of different materials in the same place",
            "sees the one that comes first in the file, everywhere alike",
        ),
    )
    advice = {
        "duplicates": "drop them from the mesh file with --fix",
        "back-to-back": "keep one, with a two-sided material",
        "coplanar": "remove the one that should not be seen, or move it by more than a millionth of the scene",
    }
    for kind, chosen, what, renderer in kinds:
        for number in np.unique(soup.mesh[hidden[chosen]]):
            part = Part(scene, soup, int(number))
            mine = np.sort(hidden[chosen & (soup.mesh[hidden] == number)])
            others = {scene.meshes[m].name for m in np.unique(soup.mesh[first[np.isin(hidden, mine)]])}
            detail = f'hidden by "{sorted(others)[0]}"' if others != {part.mesh.name} else ""
            texts = (what, renderer, advice[kind])
            harmless = kind == "back-to-back" and is_two_sided(part.bsdf) and not part.encloses
            level = Level.NOTE if harmless else Level.WARNING
            yield part.finding(level, kind, texts, mine - part.rows.start, detail=detail)


def check_normals(part: Part, cause: NDArray[np.int8]) -> Iterator[Finding]:
    """Vertex normals that lie on the other side of the triangle than its other normals, or are missing."""
    mesh = part.mesh
    if mesh.normals is None or not len(mesh.faces):
        return
    rows = np.arange(part.rows.start, part.rows.stop)[cause[part.rows] == 0]
    normals = mesh.normals[mesh.faces[part.soup.row[rows]]]
    local = rows - part.rows.start
    missing = ~np.any(normals != 0, axis=2).all(axis=1)
    if missing.any() and not missing.all():
        texts = ("triangles that lack a vertex normal", "shades them flat", "compute normals anew")
        yield part.finding(Level.NOTE, "normals-missing", texts, local[missing])
    side = np.einsum("tca,ta->tc", normals, part.soup.front[rows])
    against = ~missing & (side < 0).any(axis=1)
    if against.any():
        texts = (
            "vertex normals that point to the back of their triangle",
            "shades flat where the interpolated normal does: dark or faceted spots",
            "compute normals anew, with a crease angle",
        )
        yield part.finding(Level.WARNING, "normals-against", texts, local[against])


def check_spikes(part: Part, cause: NDArray[np.int8], longest: NDArray[np.float64], median: float) -> Iterator[Finding]:
    """Triangles that are out of all proportion to the scene's others."""
    rows = part.rows
    large = np.flatnonzero((cause[rows] == 0) & (longest[rows] > SPIKE * median))
    if len(large):
        texts = (
            f"triangles more than {SPIKE:,.0f} times larger than the median one",
            "is exact to the largest of them: fine detail is blurred or lost",
            "look for a wrong vertex; replace a huge ground by one that just fills the picture",
        )
        yield part.finding(Level.WARNING, "out-of-proportion", texts, large)
