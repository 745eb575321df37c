"""Which pixels outlines of lamps cross: a lamp is so bright that what share of a pixel it fills must be known well.

A pixel of which a hundredth is lamp is a hundred times as bright with one sample as with another; a few such pixels
along a lamp have more of an image's error than all others together. Where they are needs no samples: outlines are edges
of lit triangles, seen through the camera, where nothing stands before them.

All is reckoned by single operations that IEEE 754 rounds correctly: which pixels these are decides bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.camera import guide_pilot
from wdpm.kernels.launch import Launcher

Values = NDArray[np.float64]

STEPS = 8
"""Points that an outline is looked at, for each pixel that it passes. Pixels that come within half a step of one count
too, so that none whose corner is cut off is missed."""

STEPS_A_LOOK = 4
"""Points of which one is asked whether it is seen."""

MOST_BLUR = 8.0
"""Radius of a point out of focus up to which an outline is one [pixels]. Beyond, so many pixels have a part of it that
none gets several times the samples."""

INWARDS = 1e-3
"""How far points that are asked whether they are seen lie from the outline, as a share of the way to the middle of
their triangle: a ray to the edge itself might pass by."""

NEAR_ENOUGH = 1e-3
"""How far from the place that a ray is aimed at it may end, as a share of its way."""

MOST_POINTS = 4
"""Of each pixel of the image, on average: outlines that are more than that are everywhere."""

LEAST_DEPTH = 1e-6
"""Along the camera's axis; what is nearer has no place in an image."""


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges of triangles, and the middles of these, shape [N, 3] each."""

    start: Values
    end: Values
    middle: Values


@dataclass(frozen=True, eq=False)
class OutlinePoints:
    """Points along the outlines of lamps.

    Attributes:
        x, y: places in the whole image [pixels], shape [N].
        reach: how far from there the centres of pixels lie that have samples on both sides [pixels], shape [N].
        look: of each, the number of the place that is asked whether it is seen, int64, shape [N].
        origin, target: of rays that tell, shape [looks, 3].
    """

    x: Values
    y: Values
    reach: Values
    look: NDArray[np.int64]
    origin: Values
    target: Values


def outlined_pixels(
    corners: NDArray[np.float32], camera: Any, filter_radius: float, geometry: tuple[Any, Any], materials: int
) -> NDArray[np.int64]:
    """Numbers of the pixels of the whole image that outlines of lamps cross, ascending; none if they are most of all.

    Args:
        corners: of lit triangles, wound so that their normals face the lit side, shape [E, 3, 3].
        camera: kernels.camera.camera.CameraView.
        geometry: of the whole scene: kernels.rays.two_level.Trees and kernels.rays.cell_triangles.Surfaces.
        materials: how many there are.
    """
    width, height = int(camera.whole_width), int(camera.whole_height)
    points = outline_points(outer_edges(corners, camera), camera, filter_radius, MOST_POINTS * width * height)
    if points is None:
        return np.empty(0, np.int64)
    return pixels_about(points, _seen(points, geometry, materials), width, height)


def _seen(points: OutlinePoints, geometry: tuple[Any, Any], materials: int) -> NDArray[np.bool_]:
    """Whether rays come to their targets with nothing before them, shape [looks]."""
    device, count = geometry[1].material.device, len(points.target)
    way = points.target - points.origin
    scene = guide_pilot.PilotScene()
    scene.trees, scene.surfaces = geometry
    scene.through = wp.zeros(materials, dtype=wp.int32, device=device)
    places, normals = (wp.empty(count, dtype=wp.vec3, device=device) for _ in range(2))
    Launcher(device, 1)(
        guide_pilot.walk_on,
        count,
        scene=scene,
        bounce=0,
        seed=wp.uint32(0),
        origin=wp.array(points.origin.astype(np.float32), dtype=wp.vec3, device=device),
        direction=wp.array(way.astype(np.float32), dtype=wp.vec3, device=device),
        position_out=places,
        normal_out=normals,
    )
    off = places.numpy().astype(np.float64) - points.target
    met = normals.numpy().any(axis=1)
    return np.asarray(met & (_dot(off, off) <= NEAR_ENOUGH**2 * _dot(way, way)))


def outer_edges(corners: NDArray[np.float32], camera: Any) -> Edges:
    """Edges that one triangle that faces the camera has alone.

    Args:
        corners: of lamps, wound so that their normals face the lit side, shape [E, 3, 3].
        camera: kernels.camera.camera.CameraView.
    """
    p = corners.astype(np.float64)
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    back = -_vector(camera.forward) if camera.parallel else _vector(camera.eye) - p[:, 0]
    faces = _dot(normal, back) > 0.0
    p, bits = p[faces], (corners[faces] + np.float32(0.0)).view(np.uint32)  # -0 becomes 0
    vertex = _numbered(bits.reshape(-1, 3)).reshape(-1, 3)
    ends = np.stack([vertex, np.roll(vertex, -1, axis=1)], axis=2).reshape(-1, 2)
    key = ends.min(axis=1) * (3 * len(p) + 1) + ends.max(axis=1)
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    alone = np.sort(first[count == 1])
    middle = (p[:, 0] + p[:, 1] + p[:, 2]) / 3.0
    return Edges(p.reshape(-1, 3)[alone], np.roll(p, -1, axis=1).reshape(-1, 3)[alone], middle[alone // 3])


def _numbered(rows: NDArray[np.uint32]) -> NDArray[np.int64]:
    """A number of each row, the same for rows that are alike: np.unique compares rows field by field, and is slow."""
    order = np.lexsort(rows.T)
    ascending = rows[order]
    number = np.empty(len(rows), np.int64)
    number[order] = np.cumsum(np.append(False, (ascending[1:] != ascending[:-1]).any(axis=1)))
    return number


def outline_points(edges: Edges, camera: Any, filter_radius: float, most: int) -> OutlinePoints | None:
    """Points of the outlines that lie in the image; None if they are more than `most`, or there are none."""
    start, end = _seen_by(camera, edges.start), _seen_by(camera, edges.end)
    near = max(float(camera.near), LEAST_DEPTH)
    low, high = _between(start[:, 2] - near, end[:, 2] - near)
    keep = np.flatnonzero(high > low)
    if not len(keep):
        return None
    whole = edges.end[keep] - edges.start[keep]
    a3 = edges.start[keep] + low[keep, None] * whole
    b3 = edges.start[keep] + high[keep, None] * whole
    a, b = _seen_by(camera, a3), _seen_by(camera, b3)
    a[:, 2], b[:, 2] = np.maximum(a[:, 2], near), np.maximum(b[:, 2], near)
    begin, stop = _on_film(camera, a), _on_film(camera, b)
    blur = np.maximum(_blur(camera, a[:, 2]), _blur(camera, b[:, 2]))
    low, high = np.zeros(len(keep)), np.ones(len(keep))
    for axis, size in enumerate((camera.whole_width, camera.whole_height)):
        for sign, bound in ((1.0, -filter_radius), (-1.0, -(size + filter_radius))):
            more, less = _between(sign * begin[:, axis] - bound, sign * stop[:, axis] - bound)
            low, high = np.maximum(low, more), np.minimum(high, less)
    keep = keep[inside := (high > low) & (blur <= MOST_BLUR)]
    across = np.abs(stop[inside] - begin[inside]).max(axis=1) * (high - low)[inside]
    steps = np.ceil(across * STEPS) + 1.0
    if not len(keep) or steps.sum() > most:
        return None
    steps = steps.astype(np.int64)
    edge = np.repeat(np.arange(len(keep)), steps)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(steps) - steps, steps)
    t = number / np.maximum(steps[edge] - 1, 1)
    t = low[inside][edge] + t * (high - low)[inside][edge]
    place = begin[inside][edge] + t[:, None] * (stop - begin)[inside][edge]
    asked = number % STEPS_A_LOOK == 0
    # What is halfway on film is not halfway in space: 1 / depth is.
    nearer, further = 1.0 / a[inside, 2][edge[asked]], 1.0 / b[inside, 2][edge[asked]]
    share = t[asked] if camera.parallel else t[asked] * further / (nearer + t[asked] * (further - nearer))
    point = a3[inside][edge[asked]] + share[:, None] * (b3 - a3)[inside][edge[asked]]
    target = point + INWARDS * (edges.middle[keep][edge[asked]] - point)
    return OutlinePoints(
        place[:, 0],
        place[:, 1],
        filter_radius + blur[inside][edge],
        np.cumsum(asked) - 1,
        _origins(camera, target),
        target,
    )


def pixels_about(points: OutlinePoints, seen: NDArray[np.bool_], width: int, height: int) -> NDArray[np.int64]:
    """Numbers of the pixels of the whole image that outlines cross, ascending.

    Args:
        seen: of each look.
    """
    shown = seen[points.look]
    x, y, reach = points.x[shown] - 0.5, points.y[shown] - 0.5, points.reach[shown] + 0.5 / STEPS
    found = [
        row[inside] * width + column[inside]
        for row, in_rows in _whole_numbers(y, reach, height)
        for column, in_columns in _whole_numbers(x, reach, width)
        if (inside := in_rows & in_columns).any()
    ]
    return np.unique(np.concatenate(found)) if found else np.empty(0, np.int64)


def _whole_numbers(middle: Values, reach: Values, below: int) -> Iterator[tuple[NDArray[np.int64], NDArray[np.bool_]]]:
    """All from 0 on and below a bound that are within reach, one of each at a time, and whether there is one."""
    first, last = np.ceil(middle - reach), np.floor(middle + reach)
    for step in range(int(np.max(last - first, initial=0.0)) + 1):
        number = first + step
        yield number.astype(np.int64), (number <= last) & (number >= 0) & (number < below)


def _between(a: Values, b: Values) -> tuple[Values, Values]:
    """From which share of the way on, and up to which, what goes evenly from a to b is not negative."""
    with np.errstate(divide="ignore", invalid="ignore"):
        zero = a / (a - b)
    low = np.where(a >= 0, 0.0, np.where(b > 0, zero, 1.0))
    high = np.where(b >= 0, 1.0, np.where(a > 0, zero, 0.0))
    return low, high


def _seen_by(camera: Any, point: Values) -> Values:
    """To the right and down, in units of half the image at depth 1, and depth, shape [N, 3]."""
    right, down, forward = (_vector(axis) for axis in (camera.right, camera.down, camera.forward))
    way = point - _vector(camera.eye)
    return np.stack([_dot(way, right) / _dot(right, right), _dot(way, down) / _dot(down, down), _dot(way, forward)], 1)


def _on_film(camera: Any, seen: Values) -> Values:
    """Places in the whole image [pixels], shape [N, 2]; depths above 0."""
    depth = np.ones(len(seen)) if camera.parallel else seen[:, 2]
    sizes = (camera.whole_width, camera.whole_height)
    return np.stack([(seen[:, i] / depth / 2.0 + 0.5 + float(camera.shift[i])) * sizes[i] for i in range(2)], axis=1)


def _blur(camera: Any, depth: Values) -> Values:
    """Radius of what a lens makes of a point [pixels], shape [N]."""
    if camera.lens_radius == 0 or camera.parallel:
        return np.zeros(len(depth))
    right = _vector(camera.right)
    pixel = 2.0 * float(np.sqrt(_dot(right, right))) / camera.whole_width
    return np.asarray(np.abs(1.0 / depth - 1.0 / float(camera.focus)) * float(camera.lens_radius) / pixel)


def _origins(camera: Any, target: Values) -> Values:
    """Where rays that end at some points begin, shape [N, 3]."""
    eye, forward = _vector(camera.eye), _vector(camera.forward)
    depth = _dot(target - eye, forward)
    if camera.parallel:
        return target + (float(camera.near) - depth)[:, None] * forward
    return eye + (float(camera.near) / depth)[:, None] * (target - eye)


def _vector(value: Any) -> Values:
    return np.array([float(x) for x in value])


def _dot(a: Values, b: Values) -> Any:
    """Along the last axis, in one order: np.dot may fuse, or add in another."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
