"""Closed meshes leak nothing: rays from inside, aimed at edges and corners, always meet something."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from fuzz_failure import Failure
from fuzz_rays import ON_EDGES, SHORTEST
from fuzz_shapes import ball, box, torus

from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.rays import bvh
from wdpm.kernels.rays.bvh import Bvh, Hit, closest_hit, no_hit

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Array = npt.NDArray[Any]
F32 = np.float32
RAYS = 16384


@wp.kernel
def closest_kernel(tree: Bvh, origin: wp.array[wp.vec3], direction: wp.array[wp.vec3], hit_out: wp.array[Hit]) -> None:
    """The nearest hit of each ray."""
    i = wp.tid()
    hit_out[i] = closest_hit(tree, origin[i], direction[i], no_hit())


def icosphere(levels: int) -> Array:
    """The unit icosahedron, each triangle cut into four and blown up so many times, shape [T, 3, 3]."""
    golden = (1 + 5**0.5) / 2
    around = np.array([[0, 1, golden], [0, 1, -golden], [0, -1, golden], [0, -1, -golden]])
    corners = np.concatenate([np.roll(around, turn, axis=1) for turn in range(3)])
    near = np.linalg.norm(corners[:, None] - corners[None], axis=2) < 2.1
    triples = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    triangles = _unit(corners[np.array(triples)])
    for _ in range(levels):
        a, b, c = triangles.swapaxes(0, 1)
        # A sum is the same whichever neighbour computes it, so shared corners are the same numbers.
        ab, bc, ca = _unit(a + b), _unit(b + c), _unit(c + a)
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(part, axis=1) for part in parts])
    return triangles


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def solid(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """A closed mesh about the origin, and points that lie well inside, shape [count, 3]."""
    kind = rng.integers(0, 4)
    if kind == 0:
        return box(int(rng.integers(1, 12))), rng.uniform(-0.8, 0.8, (count, 3))
    inner = _unit(rng.normal(size=(count, 3))) * 0.5 * rng.random((count, 1)) ** (1 / 3)
    if kind == 1:
        return ball(int(rng.integers(2, 12))), inner
    if kind == 2:
        return icosphere(int(rng.integers(0, 4))), inner
    around, across = rng.integers(6, 24, 2)
    angle = rng.uniform(0, 2 * np.pi, count)
    core = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    # A tube of six sides has its flats at 0.7 * 0.87 from the axis of the ring, and 0.3 * 0.87 from that of the tube.
    return torus(int(around), int(across)), 0.65 * core + 0.1 * (inner / 0.5)


def affine(rng: np.random.Generator) -> Array:
    """A rotation, a stretch by up to 1000 between axes, another rotation, and a scale from 1e-6 to 1e6."""
    first, second = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
    stretch = 10.0 ** rng.uniform(-1.5, 1.5, 3) * 10.0 ** rng.uniform(-6, 6)
    if rng.random() < 0.3:  # along the axes: flat boxes, exact zeros
        return np.diag(stretch)
    return np.asarray(first @ np.diag(stretch) @ second)


def aimed(rng: np.random.Generator, triangles: Array, origin: Array) -> Array:
    """Directions from the origins to corners and edges, some of them along an axis in part, or a float beside."""
    count = len(origin)
    weights = ON_EDGES[rng.integers(0, len(ON_EDGES), count)]
    chosen = triangles[rng.integers(0, len(triangles), count)].astype(float)
    direction = np.einsum("rc,rca->ra", weights, chosen).astype(F32) - origin
    flat = rng.random((count, 3)) < 0.05
    direction[flat] = rng.choice([0.0, -0.0], int(flat.sum())).astype(F32)
    direction[rng.random(count) < 0.2] *= F32(1 + 2.0**-23)
    direction *= rng.choice([1e-3, 1.0, 7.0], (count, 1)).astype(F32)
    direction[np.abs(direction).max(axis=1) < SHORTEST] = (0, 0, 1)
    return direction


def run_case(seed: int) -> tuple[int, list[Failure]]:
    """Rays traced inside the closed mesh of a seed, and those that got out."""
    rng = np.random.default_rng(seed)
    triangles, inside = solid(rng, RAYS)
    matrix = affine(rng)
    triangles, origin = (triangles @ matrix).astype(F32), (inside @ matrix).astype(F32)
    origin[rng.random(RAYS) < 0.1] = origin[0]
    pad = float(F32(PAD_SHARE * np.abs(triangles).max())) if rng.random() < 0.8 else 0.0
    return RAYS, leaks(triangles, origin, aimed(rng, triangles, origin), pad)


def leaks(triangles: Array, origin: Array, direction: Array, pad: float) -> list[Failure]:
    """The rays that meet no triangle."""
    tree = bvh.build(triangles, np.arange(len(triangles), dtype=np.int32), pad)
    rays = [wp.array(np.ascontiguousarray(a), dtype=wp.vec3, device="cpu") for a in (origin, direction)]
    hits = wp.empty(len(origin), dtype=Hit, device="cpu")
    wp.launch(closest_kernel, len(origin), inputs=[tree, *rays], outputs=[hits], device="cpu")
    out = np.flatnonzero(hits.numpy()["prim"] < 0)
    data = {"triangles": triangles, "pad": np.array(pad)}
    return [Failure("a ray left a closed mesh", data | {"origin": origin[i], "direction": direction[i]}) for i in out]
