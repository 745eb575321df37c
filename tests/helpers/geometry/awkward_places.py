"""Points as searches among points find them hardest: many as near as each other, far off, in one plane or place."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st

F32 = np.float32
Array = npt.NDArray[Any]
AXES = np.concatenate([np.eye(3), -np.eye(3)]).astype(F32)

KIND_NAMES = ("lattice", "one place", "clusters", "far off", "plane", "volume", "line", "scales")
KINDS = st.sampled_from(KIND_NAMES)
COUNTS = st.one_of(st.sampled_from([0, 1, 2, 7, 8, 9, 16, 17, 64, 65, 512, 513, 3000]), st.integers(0, 1500))
SEEDS = st.integers(0, 2**32 - 1)


def dot(a: Array, b: Array) -> Array:
    """In the order of the kernels, in float32."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def make_positions(rng: np.random.Generator, kind: str, count: int) -> Array:
    """Points of a kind, shape [count, 3]."""
    if kind == "lattice":  # many equal distances, and several points in one place
        p = rng.integers(0, 6, (count, 3)) / 8
    elif kind == "one place":
        p = np.full((count, 3), 0.25)
    elif kind == "clusters":
        p = rng.random((5, 3))[rng.integers(0, 5, count)] + 1e-4 * rng.standard_normal((count, 3))
    elif kind == "far off":  # differences lose most of their bits
        p = 4096 + np.floor(rng.random((count, 3)) * 512) / 512
    elif kind == "plane":
        p = rng.random((count, 3)) * [1, 1, 0]
    elif kind == "line":
        p = rng.random((count, 1)) * [1.0, 0.5, 0.25]
    elif kind == "scales":  # ever closer to one place
        p = 0.5 + 10.0 ** rng.uniform(-7, 0, (count, 1)) * rng.standard_normal((count, 3))
    else:
        p = rng.random((count, 3))
    return p.astype(F32)


def make_ids(rng: np.random.Generator, count: int) -> Array:
    """As many numbers, each another one, in any order."""
    return rng.permutation(10 * count)[:count].astype(np.int64) * 2**33


def make_queries(rng: np.random.Generator, kind: str, position: Array, count: int) -> Array:
    """Places to search around, shape [count, 3]: two of five of them at points."""
    at_points = position[rng.integers(0, max(len(position), 1), count)] if len(position) else np.zeros((count, 3), F32)
    return np.where(rng.random((count, 1)) < 0.4, at_points, make_positions(rng, kind, count)).astype(F32)


def unit(v: Array) -> Array:
    """Of length 1."""
    return (v / np.linalg.norm(v, axis=-1, keepdims=True)).astype(F32)
