"""Surfaces that lie in one plane or closer to each other than rays start from them: found by rays of the renderer.

From a little above and below each triangle, a ray looks straight at it. Whatever else it meets within that little is
what a render would see there instead, or would look through. Two trees, one numbered backwards, tell both of two
coplanar triangles, of which a render sees the one with the smaller number.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.checkup.findings import Finding, Level
from wdpm.checkup.part import Part, is_solid, looks
from wdpm.checkup.soup import Ints, Soup
from wdpm.kernels.constants import OFFSET_MIN_SHARE, OFFSET_SHARE, PAD_SHARE
from wdpm.kernels.launch import Launcher
from wdpm.kernels.rays.bvh import Bvh, build, closest_hit, no_hit
from wdpm.scenes.meshes.framing import glows
from wdpm.scenes.model.scene import Scene

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

PLACES = np.array([[1 / 3, 1 / 3, 1 / 3], [0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]])
"""Weights of the corners at the places of a triangle that are looked at."""

IN_PLANE = 2.0**-22
"""Two surfaces closer than this, as a share of the coordinates, are in one plane as far as float32 can tell."""


@wp.kernel
def probe_kernel(
    tree: Bvh,
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    offset: wp.int32,
    t_out: wp.array[wp.float32],
    prim_out: wp.array[wp.int32],
) -> None:
    """The nearest hit of each ray."""
    i = offset + wp.tid()
    hit = closest_hit(tree, origin[i], direction[i], no_hit())
    t_out[i] = hit.t
    prim_out[i] = hit.prim


def check_overlaps(scene: Scene, soup: Soup, cause: NDArray[np.int8]) -> Iterator[Finding]:
    """Triangles that overlap others in their plane, or lie closer above others than rays start."""
    rows = np.flatnonzero(cause == 0)
    if not len(rows):
        return
    one, other, apart = _neighbours(soup, rows)
    solid = np.array([is_solid(scene.materials[mesh.material].bsdf) for mesh in scene.meshes])
    facing = np.einsum("ij,ij->i", soup.front[one], soup.front[other]) < 0
    touch = ~apart & facing & solid[soup.mesh[one]] & solid[soup.mesh[other]]
    touching = (
        "faces of glass or water that touch in one plane",
        "crosses one of the two, and takes what is beyond for air",
        "leave a gap of more than a millionth of the scene's size, or one face with the ratio of the two indices",
    )
    yield from _per_mesh(scene, soup, "touching-solids", touching, one[touch], other[touch])
    one, other, apart = one[~touch], other[~touch], apart[~touch]
    copies = (np.sort(soup.vertex[one], axis=1) == np.sort(soup.vertex[other], axis=1)).all(axis=1)
    one, other, apart = one[~copies], other[~copies], apart[~copies]
    look = looks(scene)
    unlike = look[soup.mesh[one]] != look[soup.mesh[other]]
    glowing = np.array([glows(mesh) for mesh in scene.meshes])
    lamps = glowing[soup.mesh[one]] & glowing[soup.mesh[other]]
    near = (
        "closer-than-offset",
        apart,
        "surfaces closer to each other than rays start from them",
        "may look or shine through the nearer one",
        "move them apart by more than a millionth of the scene's size, or remove one",
    )
    planes = (
        "coplanar",
        ~apart & unlike,
        "surfaces of different materials that overlap in one plane",
        "sees the lamp, or else the one that comes first in the file, everywhere alike",
        "remove the one that should not be seen, or move it by more than a millionth of the scene's size",
    )
    doubled = (
        "lamps-overlap",
        ~apart & ~unlike & lamps,
        "lamps that overlap in one plane",
        "shines with both, and sees one",
        "remove one",
    )
    for kind, chosen, *texts in (near, planes, doubled):
        yield from _per_mesh(scene, soup, kind, (texts[0], texts[1], texts[2]), one[chosen], other[chosen])


def _per_mesh(
    scene: Scene, soup: Soup, kind: str, texts: tuple[str, str, str], one: Ints, other: Ints
) -> Iterator[Finding]:
    for number in np.unique(soup.mesh[one]):
        part = Part(scene, soup, int(number))
        mine = soup.mesh[one] == number
        names = sorted({scene.meshes[m].name for m in np.unique(soup.mesh[other[mine]])})
        detail = f'with "{names[0]}"' + (f" and {len(names) - 1} more" if len(names) > 1 else "")
        yield part.finding(Level.WARNING, kind, texts, np.unique(one[mine]) - part.rows.start, detail=detail)


def _neighbours(soup: Soup, rows: Ints) -> tuple[Ints, Ints, NDArray[np.bool_]]:
    """Pairs of triangles, rows of the soup, and whether there is space between them; a pair may come twice."""
    corners = soup.positions[rows]
    pad = float(np.float32(PAD_SHARE * soup.extent))
    point, normal, triangle = _probes(corners, soup.front[rows], pad)
    height = OFFSET_SHARE * np.abs(normal * point).sum(axis=1) + OFFSET_MIN_SHARE * soup.extent
    height = 2.0 * height + IN_PLANE * np.abs(point).max(axis=1)
    count = len(rows)
    numbers = np.arange(count, dtype=np.int32)
    launcher = Launcher("cpu")
    found = []
    for backwards in (False, True):
        ids = numbers[::-1].copy() if backwards else numbers
        tree = build(corners, ids, pad)
        for side in (1.0, -1.0):
            t, prim = _trace(tree, point + side * height[:, None] * normal, -side * normal, launcher)
            hit = np.flatnonzero((prim >= 0) & (t < 2.0 * height))
            seen = count - 1 - prim[hit] if backwards else prim[hit]
            unlike = seen != triangle[hit]
            apart = np.abs(t[hit] - height[hit]) > IN_PLANE * np.abs(point[hit]).max(axis=1)
            found.append(np.stack([triangle[hit], seen, apart], axis=1)[unlike])
    pairs = np.unique(np.concatenate(found).astype(np.int64), axis=0)
    return rows[pairs[:, 0]], rows[pairs[:, 1]], pairs[:, 2].astype(np.bool_)


def _probes(corners: NDArray[np.float32], front: NDArray[np.float64], pad: float) -> tuple[Any, Any, Ints]:
    """Places on triangles that are large enough to have neighbours at all, normals there, and the triangles.

    Those smaller than the tree's pad, of specks in a scene that is far larger, are left out: a ray at one of them may
    hit each of them, as far as the tree can tell, so looking at all would take the square of their number.
    """
    p = corners.astype(np.float64)
    length = np.linalg.norm(front, axis=1)
    longest = np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2).max(axis=1)
    # The circle in a triangle has a radius of at least a fourth of the height on its longest edge; near its rim, a
    # neighbour across the edge is met.
    wide = length / longest > 64.0 * IN_PLANE * np.abs(p).max(axis=(1, 2))
    chosen = np.flatnonzero(wide & (longest > pad))
    places = np.einsum("pc,tca->tpa", PLACES, p[chosen]).reshape(-1, 3)
    normal = np.repeat(front[chosen] / length[chosen, None], len(PLACES), axis=0)
    return places, normal, np.repeat(chosen, len(PLACES))


def _trace(tree: Any, origin: Any, direction: Any, launcher: Launcher) -> tuple[NDArray[np.float64], Ints]:
    count = len(origin)
    rays = {
        name: wp.array(np.ascontiguousarray(array, dtype=np.float32), dtype=wp.vec3, device="cpu")
        for name, array in (("origin", origin), ("direction", direction))
    }
    t = wp.empty(count, dtype=wp.float32, device="cpu")
    prim = wp.empty(count, dtype=wp.int32, device="cpu")
    launcher(probe_kernel, count, tree=tree, **rays, t_out=t, prim_out=prim)
    return t.numpy().astype(np.float64), prim.numpy().astype(np.int64)
