"""Where photons of the caustic pass are aimed: spheres that hold all that is specular.

The union of a few spheres stands for the specular surfaces. From a point, a sphere subtends a cone; a direction is
chosen uniformly in one of the cones, and since cones overlap, its density is (cones that hold it) / (sum of all solid
angles). So every direction that meets a sphere is sampled with a density that is known, and none that meets a specular
surface is left out. For parallel light, discs stand for cones.

Where the sum is no less than the measure of the light's own directions (a point within a sphere, spheres all around),
aiming gains nothing, and the light's own distribution is used.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.constants import PI
from wdpm.kernels.directions import around, concentric_disk, uniform_cone

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MOST_TARGETS = 64
"""Most spheres: each is asked twice for every photon, some 10 ns a time."""

GAIN = 0.8
"""A sphere gives way to smaller ones where their silhouettes are together less than this share of its own."""

_LEAVES = 256  # of the tree that the spheres are a cut of
_BINS = 32
_GROWTH = 1.0 + 1e-5  # of radii: float32's roundings leave no vertex outside


@wp.struct
class Targets:
    """Spheres; count 0 where photons are not aimed."""

    count: wp.int32
    center: wp.array[wp.vec3]
    radius: wp.array[wp.float32]


@wp.struct
class Aim:
    """A direction towards a sphere (or, for parallel light, a point in a sphere's silhouette) and its density.

    Attributes:
        vector: direction, unit, or point.
        pdf: pdf_solid_angle, or density over the silhouettes' area; 0 where no sphere can be met.
    """

    vector: wp.vec3
    pdf: wp.float32


def upload_targets(center: NDArray[np.float32], radius: NDArray[np.float32], device: str) -> Targets:
    """Spheres on a device."""
    targets = Targets()
    targets.count = len(radius)
    targets.center = wp.array(center, dtype=wp.vec3, device=device)
    targets.radius = wp.array(radius, dtype=wp.float32, device=device)
    return targets


@dataclass
class _Node:
    """Some of the triangles, and how well spheres do for them.

    Attributes:
        least: sum of squared radii of the best spheres, at most 1, 2, ... of them, shape [MOST_TARGETS].
        left: how many of them the first child has; 0 where one sphere for all is best.
    """

    rows: NDArray[np.intp]
    radius2: float
    children: tuple[_Node, _Node] | None = None
    least: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    left: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))


def cluster_targets(positions: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """At most MOST_TARGETS spheres that hold triangles: the cut of a tree with the least sum of squared radii.

    Args:
        positions: corners, shape [T, 3, 3].

    Returns:
        Centres, float32, shape [S, 3], and radii, float32, shape [S].
    """
    if not len(positions):
        return np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
    corners = positions.astype(np.float64)
    spheres = []
    for rows in _best_cut(_tree(corners), MOST_TARGETS):
        center = _sphere(corners[rows])[0].astype(np.float32)
        far = np.sqrt(((corners[rows] - center.astype(np.float64)) ** 2).sum(axis=2).max())  # from the rounded centre
        spheres.append((center, far * _GROWTH))
    return np.array([center for center, _ in spheres]), np.array([far for _, far in spheres]).astype(np.float32)


def _tree(corners: NDArray[np.float64]) -> _Node:
    """A binary tree of triangles: the largest leaf is split again and again."""
    root = _Node(np.arange(len(corners)), _sphere(corners)[1])
    made = [root]
    waiting = [(-root.radius2, 0)]
    leaves = 1
    while waiting and leaves < _LEAVES:
        node = made[heapq.heappop(waiting)[1]]
        first = _first_half(corners[node.rows])
        if first is None:
            continue
        halves = node.rows[first], node.rows[~first]
        node.children = (
            _Node(halves[0], _sphere(corners[halves[0]])[1]),
            _Node(halves[1], _sphere(corners[halves[1]])[1]),
        )
        for child in node.children:
            heapq.heappush(waiting, (-child.radius2, len(made)))
            made.append(child)
        leaves += 1
    for node in reversed(made):  # children before their parents
        _weigh(node)
    return root


def _weigh(node: _Node) -> None:
    """Set `least` and `left` from those of the children."""
    node.least = np.full(MOST_TARGETS, node.radius2)
    node.left = np.zeros(MOST_TARGETS, np.intp)
    if node.children is None:
        return
    one, other = (child.least for child in node.children)
    for most in range(2, MOST_TARGETS + 1):
        sums = one[: most - 1] + other[most - 2 :: -1][: most - 1]  # 1 .. most - 1 spheres for the first child
        best = int(np.argmin(sums))
        if sums[best] < GAIN * node.radius2:
            node.least[most - 1] = sums[best]
            node.left[most - 1] = best + 1


def _best_cut(node: _Node, most: int) -> list[NDArray[np.intp]]:
    """Triangles of each of the best spheres, at most so many."""
    left = int(node.left[most - 1])
    if node.children is None or left == 0:
        return [node.rows]
    return _best_cut(node.children[0], left) + _best_cut(node.children[1], most - left)


def _sphere(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """The sphere about the middle of the bounding box: centre and squared radius."""
    center = (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2.0
    return center, float(((corners - center) ** 2).sum(axis=2).max())


def _first_half(corners: NDArray[np.float64]) -> NDArray[np.bool_] | None:
    """The best of all splits of triangles at planes across the axes, by bins of their boxes' middles; None if none is.

    Bins tell the radius by the box' diagonal.
    """
    low, high = corners.min(axis=1), corners.max(axis=1)
    middle = (low + high) / 2.0
    best, chosen = np.inf, None
    for axis in range(3):
        start, stop = middle[:, axis].min(), middle[:, axis].max()
        if not stop > start:
            continue
        bins = np.minimum((middle[:, axis] - start) / (stop - start) * _BINS, _BINS - 1).astype(np.uint8)
        order = np.argsort(bins, kind="stable")
        used, first = np.unique(bins[order], return_index=True)
        lows, highs = np.minimum.reduceat(low[order], first), np.maximum.reduceat(high[order], first)
        before = _diagonals2(np.minimum.accumulate(lows), np.maximum.accumulate(highs))[:-1]
        after = _diagonals2(np.minimum.accumulate(lows[::-1]), np.maximum.accumulate(highs[::-1]))[::-1][1:]
        cost = before + after
        plane = int(np.argmin(cost))
        if cost[plane] < best:
            best, chosen = float(cost[plane]), bins <= used[plane]
    return chosen


def _diagonals2(lows: NDArray[np.float64], highs: NDArray[np.float64]) -> NDArray[np.float64]:
    squares: NDArray[np.float64] = ((highs - lows) ** 2).sum(axis=1)
    return squares


@wp.func
def cone_height(targets: Targets, target: wp.int32, origin: wp.vec3) -> wp.float32:
    """1 - cos of the half angle that a sphere subtends; 4, which is more than any, from inside of it."""
    d = targets.center[target] - origin
    distance2 = wp.dot(d, d)
    r2 = targets.radius[target] * targets.radius[target]
    if distance2 <= r2:
        return 4.0
    sine2 = r2 / distance2
    return sine2 / (1.0 + wp.sqrt(1.0 - sine2))


@wp.func
def _lit(
    targets: Targets, target: wp.int32, origin: wp.vec3, axis: wp.vec3, cutoff: wp.float32, height: wp.float32
) -> wp.bool:
    """Whether a sphere reaches into the light's own cone about `axis`: cos of angle to it above cos(cutoff + alpha)."""
    d = wp.normalize(targets.center[target] - origin)
    cosine = 1.0 - height
    if height > 2.0 or cutoff <= -cosine:  # inside, or both cones together are all directions
        return True
    sines = wp.sqrt((1.0 - cutoff * cutoff) * height * (2.0 - height))
    return wp.dot(axis, d) > cutoff * cosine - sines - 1.0e-5


@wp.func
def sum_of_cones(targets: Targets, origin: wp.vec3, axis: wp.vec3, cutoff: wp.float32) -> wp.float32:
    """Sum of the cones' heights (solid angle / 2 pi) of all spheres that a light of a half angle can reach.

    Args:
        axis: of the light's own cone.
        cutoff: cosine of that cone's half angle; 0 for a hemisphere, -1 for all directions.
    """
    total = wp.float32(0.0)
    for i in range(targets.count):
        height = cone_height(targets, i, origin)
        if _lit(targets, i, origin, axis, cutoff, height):
            total += height
    return total


@wp.func
def aim(
    targets: Targets,
    origin: wp.vec3,
    axis: wp.vec3,
    cutoff: wp.float32,
    total: wp.float32,
    u_target: wp.float32,
    u: wp.vec2,
) -> Aim:
    """A direction from `origin` to one of the spheres, none of which it is in.

    Args:
        total: sum_of_cones of the same; below 2.
    """
    a = Aim()
    if total <= 0.0:
        return a
    chosen = wp.int32(-1)
    before = wp.float32(0.0)
    chosen_height = wp.float32(0.0)
    for i in range(targets.count):
        height = cone_height(targets, i, origin)
        if _lit(targets, i, origin, axis, cutoff, height) and (chosen < 0 or before <= u_target * total):
            chosen = i
            chosen_height = height
            before += height
    a.vector = around(wp.normalize(targets.center[chosen] - origin), uniform_cone(u, chosen_height))
    covering = wp.int32(1)
    for i in range(targets.count):
        if i != chosen and _lit(targets, i, origin, axis, cutoff, cone_height(targets, i, origin)):
            d = targets.center[i] - origin
            along = wp.dot(d, a.vector)
            aside = d - a.vector * along
            if along > 0.0 and wp.dot(aside, aside) <= targets.radius[i] * targets.radius[i]:
                covering += 1
    a.pdf = wp.float32(covering) / (2.0 * PI * total)
    return a


@wp.func
def sum_of_discs(targets: Targets) -> wp.float32:
    """Sum of the squared radii of all silhouettes."""
    total = wp.float32(0.0)
    for i in range(targets.count):
        total += targets.radius[i] * targets.radius[i]
    return total


@wp.func
def aim_parallel(targets: Targets, direction: wp.vec3, total: wp.float32, u_target: wp.float32, u: wp.vec2) -> Aim:
    """A point in the silhouette of one of the spheres, seen along `direction`; it lies near that sphere's centre.

    Args:
        total: sum_of_discs; above 0.
    """
    chosen = wp.int32(-1)
    before = wp.float32(0.0)
    for i in range(targets.count):
        if chosen < 0 or before <= u_target * total:
            chosen = i
            before += targets.radius[i] * targets.radius[i]
    d = concentric_disk(u) * targets.radius[chosen]
    a = Aim()
    a.vector = targets.center[chosen] + around(direction, wp.vec3(d[0], d[1], 0.0))
    covering = wp.int32(1)
    for i in range(targets.count):
        if i != chosen:
            to = targets.center[i] - a.vector
            aside = to - direction * wp.dot(to, direction)
            if wp.dot(aside, aside) <= targets.radius[i] * targets.radius[i]:
                covering += 1
    a.pdf = wp.float32(covering) / (PI * total)
    return a
