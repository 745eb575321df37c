"""Makes the two meshes of the gallery that no file has: `python docs/gallery/make_meshes.py FOLDER`.

`knot.stl` is a trefoil, and `ripples.ply` the surface of the water in water.xml.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

AROUND, ALONG = 48, 480
"""Corners of the knot: around its tube, and along it."""

RIPPLES = 220
"""Squares of the water along a side."""

WAVES = (
    (1.0, 0.3, 3.1, 0.0),
    (-0.6, 0.8, 4.3, 1.1),
    (0.2, -1.0, 5.2, 2.3),
    (0.9, 0.9, 7.0, 4.0),
    (-1.0, 0.1, 8.3, 0.7),
)
"""Direction (x, z), number of waves over the side of the pool, phase."""

STEEPNESS = 0.018
"""Height of a wave over its length."""


def knot() -> trimesh.Trimesh:
    """A tube about a trefoil knot."""
    t = np.linspace(0, 2 * np.pi, ALONG, endpoint=False)
    line = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1)
    ahead = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
    side = np.cross(ahead, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, ahead)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    a = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)[None, :, None]
    tube = line[:, None] + 0.55 * (np.cos(a) * side[:, None] + np.sin(a) * up[:, None])
    return trimesh.Trimesh(tube.reshape(-1, 3), _grid(ALONG, AROUND, closed=True), process=False)


def ripples() -> trimesh.Trimesh:
    """Waves over the square from -1 to 1 at a height of 0, their normals upwards."""
    x, z = np.meshgrid(*2 * [np.linspace(-1, 1, RIPPLES + 1)], indexing="ij")
    y = np.zeros_like(x)
    for toward_x, toward_z, count, phase in WAVES:
        y += STEEPNESS * 2 / count * np.sin(np.pi * count * (toward_x * x + toward_z * z) + phase)
    corners = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return trimesh.Trimesh(corners, _grid(RIPPLES + 1, RIPPLES + 1, closed=False)[:, ::-1], process=False)


def _grid(rows: int, columns: int, closed: bool) -> NDArray[np.int64]:
    """Two triangles for each square of a grid of corners; the last row and column meet the first if it is closed."""
    at = np.arange(rows * columns).reshape(rows, columns)
    if closed:
        at = np.pad(at, ((0, 1), (0, 1)), mode="wrap")
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(-1, 3)


def main(folder: Path) -> None:
    """Write both."""
    folder.mkdir(parents=True, exist_ok=True)
    knot().export(folder / "knot.stl")
    water = ripples()
    water.export(folder / "ripples.ply", vertex_normal=True)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
