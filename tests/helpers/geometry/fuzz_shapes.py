"""Triangle sets that traversal finds hard, each a function of a seed: corners float32, shape [T, 3, 3]."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
F32 = np.float32
LATTICE = np.linspace(-1.0, 1.0, 9)


def anywhere(rng: np.random.Generator, count: int) -> Array:
    """Triangles of middling size."""
    return rng.uniform(-1, 1, (count, 1, 3)) + 0.3 * rng.normal(size=(count, 3, 3))


def lattice(rng: np.random.Generator, count: int) -> Array:
    """Corners on a coarse grid: shared edges, coplanar overlaps, zero areas, half of them along the axes."""
    corners = rng.choice(LATTICE, (count, 3, 3))
    flat = rng.random(count) < 0.5
    corners[flat, :, rng.integers(0, 3)] = corners[flat, :1, 0]
    return corners


def needles(rng: np.random.Generator, count: int) -> Array:
    """Two corners 1e-9 to 1e-2 apart, the third about 1 away: aspect ratios up to beyond 1e7."""
    tip = rng.choice(LATTICE, (count, 3)) if rng.random() < 0.5 else rng.uniform(-1, 1, (count, 3))
    thick = 10.0 ** rng.uniform(-9, -2, (count, 1))
    return np.stack([tip, tip + thick * rng.normal(size=(count, 3)), -tip + rng.normal(size=(count, 3))], axis=1)


def slivers(rng: np.random.Generator, count: int) -> Array:
    """Three corners that nearly lie on a line, the third between the others."""
    a, b = rng.uniform(-1, 1, (2, count, 3))
    share = rng.random((count, 1))
    off = 10.0 ** rng.uniform(-8, -3, (count, 1))
    return np.stack([a, b, a + share * (b - a) + off * rng.normal(size=(count, 3))], axis=1)


def scales(rng: np.random.Generator, count: int) -> Array:
    """Huge ones next to tiny ones: sizes from 1e-7 to 2."""
    size = 10.0 ** rng.uniform(-7, 0.3, (count, 1, 1))
    return rng.uniform(-1, 1, (count, 1, 3)) + size * rng.normal(size=(count, 3, 3))


def coplanar(rng: np.random.Generator, count: int) -> Array:
    """Overlapping triangles in one plane: along the axes, or slanted, where rounding lifts them off it."""
    corners = rng.uniform(-1, 1, (count, 3, 3))
    corners[:, :, rng.integers(0, 3)] = rng.choice(LATTICE)
    if rng.random() < 0.5:
        corners = corners @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return corners


def fan(rng: np.random.Generator, count: int) -> Array:
    """Around one vertex, each sharing edges with its neighbours."""
    angle = np.sort(rng.uniform(0, 2 * np.pi, count + 1))
    height = rng.normal(size=count + 1) * rng.choice([0.0, 0.2])
    rim = np.stack([np.cos(angle), np.sin(angle), height], axis=1)
    rim[-1] = rim[0]
    hub = np.broadcast_to(rng.choice(LATTICE, 3) * 0.2, (count, 3))
    return np.stack([hub, rim[:-1], rim[1:]], axis=1)[..., rng.permutation(3)]


def sheet(rng: np.random.Generator, count: int) -> Array:
    """A height field whose squares share all edges; some borders have T-junctions with a coarser one beside it."""
    side = max(1, int((count / 2) ** 0.5))
    x, y = np.meshgrid(np.linspace(-1, 1, side + 1), np.linspace(-1, 1, side + 1))
    z = rng.choice(LATTICE, x.shape) * rng.choice([0.0, 0.25])
    points = np.stack([x, y, z], axis=-1)[..., rng.permutation(3)]
    return squares(points)


def point(rng: np.random.Generator, count: int) -> Array:
    """Nearly all in one place."""
    size = 10.0 ** rng.uniform(-12, -6)
    return rng.choice(LATTICE, 3) + size * rng.normal(size=(count, 3, 3))


def closed(rng: np.random.Generator, count: int) -> Array:
    """A box, a ball or a torus."""
    side = max(2, int((count / 12) ** 0.5))
    kind = rng.integers(0, 3)
    return box(side) if kind == 0 else ball(side) if kind == 1 else torus(side + 1, side + 2)


KINDS: dict[str, Callable[[np.random.Generator, int], Array]] = {
    function.__name__: function
    for function in (anywhere, lattice, needles, slivers, scales, coplanar, fan, sheet, point, closed)
}


def triangle_set(rng: np.random.Generator, kinds: tuple[str, ...], count: int) -> Array:
    """A mixture of kinds about 2 across, with some exact duplicates whose corners may be turned around."""
    share = max(1, count // len(kinds))
    parts = [KINDS[kind](rng, share) for kind in kinds]
    corners = np.concatenate(parts).astype(F32)
    copies = corners[rng.random(len(corners)) < rng.choice([0.0, 0.1])]
    turned = copies[:, rng.permutation(3)]
    return np.concatenate([corners, turned])[:, :, rng.permutation(3)]


def scaled(corners: Array, scale: float) -> Array:
    """The set enlarged and rounded again."""
    return (corners.astype(float) * scale).astype(F32)


def squares(points: Array) -> Array:
    """Two triangles for each square of a grid of points [m, n, 3]."""
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)


def box(side: int) -> Array:
    """The cube [-1, 1]³ of uneven squares; corners that are shared are the same numbers."""
    cuts = np.sin(np.linspace(-np.pi / 2, np.pi / 2, side + 1))
    x, y = np.meshgrid(cuts, cuts)
    square = np.stack([x, y], axis=-1)
    return np.concatenate([squares(np.insert(square, axis, z, axis=-1)) for axis in range(3) for z in (-1.0, 1.0)])


def ball(side: int) -> Array:
    """The box blown up to a unit ball."""
    corners = box(side)
    return corners / np.linalg.norm(corners, axis=-1, keepdims=True)


def torus(around: int, across: int) -> Array:
    """A closed tube of radius 0.3 around a circle of radius 0.7; the seams are the same numbers."""
    u, v = np.meshgrid(np.arange(around + 1) % around, np.arange(across + 1) % across, indexing="ij")
    big, small = 2 * np.pi * u / around, 2 * np.pi * v / across
    ring = 0.7 + 0.3 * np.cos(small)
    return squares(np.stack([ring * np.cos(big), ring * np.sin(big), 0.3 * np.sin(small)], axis=-1))
