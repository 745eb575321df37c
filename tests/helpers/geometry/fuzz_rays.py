"""Rays that traversal finds hard, aimed at a set of triangles: origins and directions float32, shape [R, 3] each."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
F32 = np.float32

ON_EDGES = np.array([[0.5, 0.5, 0.0], [1, 0, 0], [0.25, 0, 0.75], [0, 0, 1], [0, 1 / 3, 2 / 3]])
GRAZING = 1e-7
"""Radians."""

SHORTEST = 1e-30
"""Of a direction's largest component: slab arithmetic takes components below 1e-37 for zero."""


def rays_at(rng: np.random.Generator, triangles: Array, count: int) -> tuple[Array, Array]:
    """Rays at corners, edges, inner points and past them; from anywhere, from corners, edges, planes and far away;
    along axes (with -0.0 and with numbers near the smallest), within planes and grazing them."""
    size = max(float(np.abs(triangles).max()), 1e-30)
    target = points_of(rng, triangles, count)
    origin = rng.uniform(-1.5, 1.5, (count, 3)) * size
    coarse = rng.random(count) < 0.3
    origin[coarse] = np.round(origin[coarse] / size * 4) / 4 * size
    far = rng.random(count) < 0.1
    origin[far] *= 10.0 ** rng.uniform(0, 3, (int(far.sum()), 1))
    on = rng.random(count) < 0.15  # on a corner, an edge or a plane
    origin[on] = points_of(rng, triangles, int(on.sum()))
    origin = origin.astype(F32)
    direction = (target.astype(F32) - origin).astype(float)
    _along_axes(rng, origin, direction, target)
    _grazing(rng, origin, direction, triangles, size)
    beside = rng.random(count) < 0.2  # a few floats beside what was aimed at
    direction[beside] *= 1 + 2.0**-23 * rng.integers(-3, 4, (int(beside.sum()), 3))
    _nearly_flat(rng, direction)
    direction *= 10.0 ** rng.choice([-3.0, 0.0, 0.0, 1.3], (count, 1))
    with np.errstate(under="ignore"):
        direction = direction.astype(F32)
    direction[np.abs(direction).max(axis=1) < SHORTEST] = (0, 0, 1)
    return origin, direction


def points_of(rng: np.random.Generator, triangles: Array, count: int) -> Array:
    """Points of triangles, half of them on edges and at corners, float64, shape [count, 3]."""
    chosen = triangles[rng.integers(0, len(triangles), count)].astype(float)
    weights = rng.dirichlet([1, 1, 1], count)
    on_edge = rng.random(count) < 0.5
    weights[on_edge] = ON_EDGES[rng.integers(0, len(ON_EDGES), int(on_edge.sum()))][:, rng.permutation(3)]
    return np.einsum("rc,rca->ra", weights, chosen)


def _along_axes(rng: np.random.Generator, origin: Array, direction: Array, target: Array) -> None:
    """Turns some rays to an axis, still at their targets: the other components are 0.0 or -0.0."""
    some = np.flatnonzero(rng.random(len(origin)) < 0.2)
    axis = rng.integers(0, 3, len(some))
    unit = np.where(rng.random((len(some), 3)) < 0.5, 0.0, -0.0)
    sign = rng.choice([-1.0, 1.0], len(some))
    unit[np.arange(len(some)), axis] = sign
    through = target[some].astype(F32)
    through[np.arange(len(some)), axis] = origin[some, axis]
    origin[some] = through
    direction[some] = unit


def _grazing(rng: np.random.Generator, origin: Array, direction: Array, triangles: Array, size: float) -> None:
    """Turns some rays into the plane of a triangle, or GRAZING off it."""
    some = np.flatnonzero(rng.random(len(origin)) < 0.15)
    a, b, c = triangles[rng.integers(0, len(triangles), len(some))].astype(float).swapaxes(0, 1)
    normal = _unit(np.cross(b - a, c - a))
    within = _unit(rng.normal(size=(len(some), 1)) * (b - a) + rng.normal(size=(len(some), 1)) * (c - a))
    lean = rng.choice([0.0, GRAZING, -GRAZING, 1e-4], (len(some), 1))
    weights = rng.dirichlet([1, 1, 1], len(some))[:, :, None]
    through = weights[:, 0] * a + weights[:, 1] * b + weights[:, 2] * c
    along = within + lean * normal
    origin[some] = (through - size * rng.uniform(0, 2, (len(some), 1)) * along).astype(F32)
    direction[some] = along


def _nearly_flat(rng: np.random.Generator, direction: Array) -> None:
    """Gives some rays a component far below the others: denormal, at the bound of slab arithmetic, or just small."""
    some = np.flatnonzero((rng.random(len(direction)) < 0.1) & direction.any(axis=1))
    longest = np.abs(direction[some]).argmax(axis=1)
    axis = (longest + rng.integers(1, 3, len(some))) % 3
    tiny = rng.choice([1e-45, 1e-40, 0.9e-37, 1.1e-37, 1e-30, 1e-20, 1e-10], len(some))
    direction[some, axis] = tiny * rng.choice([-1.0, 1.0], len(some))


def _unit(v: Array) -> Array:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.divide(v, length, out=np.tile([0.0, 0.0, 1.0], (len(v), 1)), where=length > 0)
