"""Scenes of so many triangles, instances counted where they stand, that not every one of them can be looked at."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.checkup.findings import Finding, Level
from wdpm.scenes.flat.renderer_space import RendererSpace
from wdpm.scenes.model.scene import Instance, Scene, Solid

MOST_STANDING: Final = 2_000_000
"""Triangles of instances that are looked at where they stand: more would take minutes, and tens of gigabytes."""


def looked_at(scene: Scene) -> tuple[Scene, tuple[Instance, ...]]:
    """The scene as it is looked at, and what is left out of it.

    If instances have too many triangles together, of each shape the first stays where it stands.
    """
    standing = [mesh for mesh in scene.meshes if isinstance(mesh, Instance)]
    if sum(len(mesh.shape.faces) for mesh in standing) <= MOST_STANDING:
        return scene, ()
    seen: set[int] = set()
    kept: list[Solid] = []
    left_out: list[Instance] = []
    for mesh in scene.meshes:
        if isinstance(mesh, Instance) and id(mesh.shape) in seen:
            left_out.append(mesh)
            continue
        if isinstance(mesh, Instance):
            seen.add(id(mesh.shape))
        kept.append(mesh)
    return replace(scene, meshes=tuple(kept)), tuple(left_out)


def tell_of(left_out: Sequence[Instance]) -> Iterator[Finding]:
    """Say that not all is looked at."""
    if left_out:
        shapes = len({id(mesh.shape) for mesh in left_out})
        what = "instances are so many that of each shape the first alone is looked at"
        detail = f"{len(left_out)} others of {shapes} shape{'s' if shapes > 1 else ''}"
        yield Finding(Level.NOTE, "instances", what, "renders all of them", "", detail=detail)


def box_corners(instances: Sequence[Instance], space: RendererSpace) -> NDArray[np.float32]:
    """Corners of boxes that hold instances, in the renderer's space, shape [8 x instances, 3]."""
    own: dict[int, NDArray[np.float64]] = {}
    corners: list[NDArray[np.float64]] = [np.zeros((0, 3))]
    for mesh in instances:
        if id(mesh.shape) not in own:
            own[id(mesh.shape)] = _corners_of(mesh.shape.vertices)
        corners.append(own[id(mesh.shape)] @ mesh.to_world[:3, :3].T + mesh.to_world[:3, 3])
    return space.place(np.concatenate(corners)).astype(np.float32)


def _corners_of(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners of the box around points, shape [8, 3]; none where there is no point."""
    if not len(points):
        return np.zeros((0, 3))
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array([[(low, high)[at >> axis & 1][axis] for axis in range(3)] for at in range(8)])
