"""The way of rays through the cells of a top tree: what they find on it is what one cell would find, and no cell that
they must see is left out.

The oracle is one cell: every triangle by intersect_triangle. A ray on its way tests every triangle of the cells that it
visits, with the best hit so far carried along, as between slaves. Planes run through corners, along surfaces and a
float beside.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

import numpy as np
import numpy.typing as npt
import warp as wp
from fuzz_failure import Failure
from fuzz_rays import SHORTEST, rays_at
from fuzz_shapes import KINDS, LATTICE, scaled, triangle_set

from wdpm.cluster.plan.partition import rows_of_cells
from wdpm.cluster.world import Outlines, TopTree
from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.launch import Launcher
from wdpm.kernels.rays import cells as kernel_cells
from wdpm.kernels.rays import outline_build
from wdpm.kernels.rays.bvh import Hit, no_hit
from wdpm.kernels.rays.cells import Cells, cell_of, cell_on_way, next_cell
from wdpm.kernels.rays.triangle import NO_HIT, Ray, intersect_triangle, make_ray

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Array = npt.NDArray[Any]
F32 = np.float32
FIELDS = ("t", "prim", "u", "v")
RAYS = 4096
MOST_LEVELS = 6
LAUNCHER = Launcher("cpu", 1)


@dataclass(frozen=True)
class Case:
    """Triangles, rays, a top tree, and what each cell holds: `held` from begin[cell] to begin[cell + 1].

    The top tree has outlines, of all numbers of boxes: of so many as renders have, of few, and of blocks of a lattice.
    """

    triangles: Array
    origin: Array
    direction: Array
    tree: TopTree
    extent: float
    begin: Array
    held: Array


@dataclass
class Walked:
    """Of each ray: the hit found on the way, that of one cell, the cells visited as bits, their number (-1: without
    end), the cell that owns the hit, and whether a segment to t = 1 is blocked: as all cells know, and on its way."""

    found: Array
    whole: Array
    visited: Array
    steps: Array
    owner: Array
    blocked: Array
    stopped: Array


@wp.func
def nearer(best: Hit, corners: wp.array2d[wp.vec3], k: wp.int32, ray: Ray, pad: wp.float32) -> Hit:
    """The smaller of two hits by (t, triangle)."""
    hit = intersect_triangle(corners[k, 0], corners[k, 1], corners[k, 2], ray, pad)
    result = best
    if hit[0] < best.t or (hit[0] == best.t and hit[0] < NO_HIT and k < best.prim):
        result.t = hit[0]
        result.prim = k
        result.u = hit[1]
        result.v = hit[2]
    return result


@wp.func
def point_of(hit: Hit, corners: wp.array2d[wp.vec3]) -> wp.vec3:
    """Where a hit is: computed in double, rounded once."""
    u = wp.float64(hit.u)
    v = wp.float64(hit.v)
    a = wp.vec3d(corners[hit.prim, 0])
    b = wp.vec3d(corners[hit.prim, 1])
    c = wp.vec3d(corners[hit.prim, 2])
    return wp.vec3(a * (wp.float64(1.0) - u - v) + b * u + c * v)


@wp.func
def stops(
    cells: Cells,
    corners: wp.array2d[wp.vec3],
    begin: wp.array[wp.int32],
    held: wp.array[wp.int32],
    o: wp.vec3,
    d: wp.vec3,
    pad: wp.float32,
) -> wp.bool:
    """Whether a segment to t = 1 is blocked in a cell on its way."""
    ray = make_ray(o, d)
    steps = wp.int32(0)
    cell = cell_on_way(cells, o, d, 1.0, -1, -1, True)
    while cell >= 0 and steps < cells.count:
        best = no_hit()
        for place in range(begin[cell], begin[cell + 1]):
            best = nearer(best, corners, held[place], ray, pad)
        if best.t < 1.0:
            return True
        cell = cell_on_way(cells, o, d, 1.0, cell, -1, True)
        steps += 1
    return False


@wp.kernel
def walk_kernel(
    cells: Cells,
    pad: wp.float32,
    corners: wp.array2d[wp.vec3],
    begin: wp.array[wp.int32],
    held: wp.array[wp.int32],
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    found_out: wp.array[Hit],
    whole_out: wp.array[Hit],
    visited_out: wp.array[wp.uint64],
    steps_out: wp.array[wp.int32],
    owner_out: wp.array[wp.int32],
    blocked_out: wp.array[wp.bool],
    stopped_out: wp.array[wp.bool],
) -> None:
    """One ray in one cell, and on its way through all."""
    i = wp.tid()
    o = origin[i]
    d = direction[i]
    ray = make_ray(o, d)
    whole = no_hit()
    for k in range(corners.shape[0]):
        whole = nearer(whole, corners, k, ray, pad)
    found = no_hit()
    visited = wp.uint64(0)
    steps = wp.int32(0)
    cell = next_cell(cells, o, d, found.t, -1)
    while cell >= 0:
        visited = visited | (wp.uint64(1) << wp.uint64(cell))
        for place in range(begin[cell], begin[cell + 1]):
            found = nearer(found, corners, held[place], ray, pad)
        steps += 1
        cell = next_cell(cells, o, d, found.t, cell)
        if steps > cells.count:
            steps = -1
            cell = -1
    found_out[i] = found
    whole_out[i] = whole
    visited_out[i] = visited
    steps_out[i] = steps
    blocked_out[i] = whole.t < 1.0
    stopped_out[i] = stops(cells, corners, begin, held, o, d, pad)
    owner_out[i] = -1
    if whole.prim >= 0:
        owner_out[i] = cell_of(cells, point_of(whole, corners))


def make_case(seed: int) -> Case:
    """The case of a seed: up to 64 cells and up to 128 triangles of one or two kinds at any scale."""
    rng = np.random.default_rng(seed)
    kinds = tuple(rng.choice(list(KINDS), rng.integers(1, 3)))
    triangles = triangle_set(rng, kinds, int(2 ** rng.uniform(0, 7)))
    if rng.random() < 0.5:
        triangles = scaled(triangles, 10.0 ** rng.uniform(-6, 6))
    origin, direction = rays_at(rng, triangles, RAYS)
    tree = _top_tree(rng, triangles)
    _into_planes(rng, tree, origin, direction)
    _off_surfaces(rng, triangles, origin, direction)
    extent = max(float(np.abs(a).max()) for a in (triangles, origin))
    lattice = {"MANY": 4, "LATTICE": 3, "MOST_LARGE": 2, "AT_ONCE": 16}
    sizes = [{"MOST_BOXES": 112}, {"MOST_BOXES": 3, "MOST_LAMPS": 1}, lattice]
    with patch.multiple(outline_build, **sizes[rng.integers(0, 3)]):
        return with_cells(triangles, origin, direction, tree, extent, rng.integers(-1, 1, len(triangles)))


def with_cells(triangles: Array, origin: Array, direction: Array, tree: TopTree, extent: float, emitter: Array) -> Case:
    """The case, with what each cell holds."""
    rows = rows_of_cells(triangles, tree, extent, LAUNCHER)
    if tree.cells > 1:
        none = [outline_build.NO_ITEMS] * tree.cells
        boxes = kernel_cells.cell_boxes(tree.axis, tree.split)
        tables = outline_build.build_outlines(triangles, emitter, boxes, rows, none, extent)
        tree = replace(tree, outlines=Outlines(**tables))
    begin = np.cumsum([0, *(len(held) for held in rows)]).astype(np.int32)
    return Case(triangles, origin, direction, tree, extent, begin, np.concatenate(rows).astype(np.int32))


def _top_tree(rng: np.random.Generator, triangles: Array) -> TopTree:
    """Planes through corners, a float beside them, on a grid, anywhere and beyond everything."""
    inner = 2 ** int(rng.integers(0, MOST_LEVELS + 1)) - 1
    axis = rng.integers(0, 3, inner).astype(np.int32)
    size = float(np.abs(triangles).max())
    corners = triangles.reshape(-1, 3)[rng.integers(0, 3 * len(triangles), inner), axis]
    beside = np.nextafter(corners, rng.choice(np.array([-np.inf, np.inf], F32), inner))
    grid = (rng.choice(LATTICE, inner) * size).astype(F32)
    free = (rng.uniform(-1, 1, inner) * size).astype(F32)
    beyond = np.full(inner, 16 * size, F32)
    kind = rng.choice(5, inner, p=[0.4, 0.2, 0.2, 0.15, 0.05])
    return TopTree(axis, np.choose(kind, [corners, beside, grid, free, beyond]).astype(F32))


def _into_planes(rng: np.random.Generator, tree: TopTree, origin: Array, direction: Array) -> None:
    """Starts some rays on planes, lets some of these run in them, and some leave them by the least angle."""
    if not len(tree.axis):
        return
    some = np.flatnonzero(rng.random(len(origin)) < 0.3)
    plane = rng.integers(0, len(tree.axis), len(some))
    axis = tree.axis[plane]
    place = tree.split[plane]
    beside = np.nextafter(place, rng.choice(np.array([-np.inf, np.inf], F32), len(some)))
    origin[some, axis] = np.where(rng.random(len(some)) < 0.7, place, beside)
    lean = rng.choice([0.0, -0.0, 1e-7, -1e-7, 1.0], len(some)).astype(F32)
    direction[some, axis] = np.where(lean == 1, direction[some, axis], lean * np.abs(direction[some]).max(axis=1))
    direction[np.abs(direction).max(axis=1) < SHORTEST] = (0, 0, 1)


def _off_surfaces(rng: np.random.Generator, triangles: Array, origin: Array, direction: Array) -> None:
    """Has some rays begin a rounding or a little more off a triangle, and end as near to another, as shadow rays do."""
    some = np.flatnonzero(rng.random(len(origin)) < 0.3)
    ends = []
    for _ in range(2):
        chosen = rng.integers(0, len(triangles), len(some))
        own = triangles[chosen].astype(float)
        normal = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        point = np.einsum("rc,rca->ra", rng.dirichlet([1, 1, 1], len(some)), own)
        off = rng.choice([-1.0, 1.0], len(some)) * 2.0 ** rng.choice([-30, -24, -22, -21, -19], len(some))
        size = np.abs(normal * point).sum(axis=1)
        ends.append((point + normal * (off * size)[:, None]).astype(F32))
    origin[some] = ends[0]
    direction[some] = ends[1] - ends[0]
    direction[np.abs(direction).max(axis=1) < SHORTEST] = (0, 0, 1)


def walk(case: Case) -> Walked:
    """What the rays meet."""
    pad = float(F32(PAD_SHARE * case.extent))
    known = vars(case.tree.outlines) if len(case.tree.outlines.first) else None
    cells = kernel_cells.upload(case.tree.axis, case.tree.split, pad, "cpu", known)
    corners = wp.array(np.ascontiguousarray(case.triangles), dtype=wp.vec3, device="cpu").reshape((-1, 3))
    numbers = [wp.array(a, dtype=wp.int32, device="cpu") for a in (case.begin, case.held)]
    rays = [wp.array(np.ascontiguousarray(a), dtype=wp.vec3, device="cpu") for a in (case.origin, case.direction)]
    count = len(case.origin)
    outputs = [
        wp.empty(count, dtype=t, device="cpu") for t in (Hit, Hit, wp.uint64, wp.int32, wp.int32, wp.bool, wp.bool)
    ]
    wp.launch(walk_kernel, count, inputs=[cells, pad, corners, *numbers, *rays], outputs=outputs, device="cpu")
    return Walked(*(out.numpy() for out in outputs))


def judge(case: Case, walked: Walked) -> list[Failure]:
    """All rays that find something else, go astray or miss the cell that owns their hit."""
    holds = np.zeros((case.tree.cells, len(case.triangles)), bool)
    for cell in range(case.tree.cells):
        holds[cell, case.held[case.begin[cell] : case.begin[cell + 1]]] = True
    hit = walked.whole["prim"] >= 0
    owner = np.where(hit, walked.owner, 0)
    seen = (walked.visited >> owner.astype(np.uint64)) & np.uint64(1) == 1
    differs = np.any(
        [walked.found[name].view(np.int32) != walked.whole[name].view(np.int32) for name in FIELDS], axis=0
    )
    visits = np.array([int(bits).bit_count() for bits in walked.visited])
    wrong = {
        "the cells on the way and one cell disagree": differs,
        "a shadow ray is blocked, and on its way is not": walked.blocked != walked.stopped,
        "a cell is visited twice, or the way has no end": walked.steps != visits,
        "the cell that owns the hit is not on the way": hit & ~seen,
        "the cell that owns the hit does not hold its triangle": hit & ~holds[owner, walked.whole["prim"]],
    }
    data = {"triangles": case.triangles, "axis": case.tree.axis, "split": case.tree.split}
    data["extent"] = np.array(case.extent)
    return [
        Failure(message, data | {"origin": case.origin[i], "direction": case.direction[i]})
        for message, bad in wrong.items()
        for i in np.flatnonzero(bad)
    ]


def run_case(seed: int) -> tuple[int, list[Failure]]:
    """Rays sent, and what went wrong with them."""
    case = make_case(seed)
    return len(case.origin), judge(case, walk(case))
