"""A binary tree over all lights that have a place: nodes say how much light they may send anywhere.

After Conty Estevez & Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting": a node holds what
emits within a sphere, how strongly, and into which directions: no element's axis is further from the node's axis than
one angle, and none shines further from its own axis than another.

A leaf is a point, a spot, a glowing triangle, two triangles that make a flat quadrilateral of one light, or all of a
lamp that is a ball (balls.py): a scene with one such lamp has one leaf, and nothing to choose. The tree is built from
the top, halving by number along the longest axis: first between lights, then within each. Only sums, products,
quotients, square roots, comparisons and stable sorts are used, in a fixed order, so that every process builds the same.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.flat.areas import triangle_normals
from wdpm.scenes.flat.balls import balls_of
from wdpm.scenes.flat.light_table import LightTable

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

HEADS = 16
"""Most nodes among which a walk starts: all are looked at, and compared, at once.

Far up, nodes are large and their bounds say little; the paper splits such nodes adaptively.
"""

SAME_NORMAL = 1.0 - 1e-6
"""Least cosine between the normals of two triangles of a flat quadrilateral (0.08 degrees)."""

SAME_HALVES = 2.0**-10
"""Most that a half's share of a quadrilateral's flux may differ from 1/2 and count as half: chosen as often as it
shines to within 0.1 %, which the estimate makes up for."""

SAME_PLACE = 2.0**-20
"""Middles are sorted by multiples of this [the renderer's units]: what lies side by side by symmetry, or in one place,
stays in the order of its number wherever a scene's coordinates were rounded."""

SAME_RANK = 2.0**-12
"""Nodes whose ranks differ by less than about this share count as alike when heads are chosen; as SAME_PLACE."""

ALL_AROUND = -1.0
"""Cosine of the half angle of a cone of axes that says nothing."""


@dataclass(frozen=True, eq=False)
class LightTree:
    """The nodes, parents before children; siblings lie side by side. All numbers of the tree are in units of share.

    Attributes:
        center, radius: of a sphere that holds a node's elements, float64, shapes [N, 3] and [N].
        axis: about which its elements' axes (normals) lie, unit, float64, shape [N, 3].
        cos_axes: cosine of the largest angle between `axis` and an element's own; ALL_AROUND where it does not matter.
        cos_reach: cosine of the largest angle from its own axis at which an element shines, in [0, 1], shape [N].
        strength: radiant intensity along the axes as a share of all flux of the scene's lights [1/sr], shape [N].
        child: the first of its two children, -1 for a leaf, int64, shape [N].
        parent: -1 for the root, int64, shape [N].
        first, last: of a leaf's elements, int64, shape [N].
        ball: radius of the ball that a leaf is, 0 of any other node; its `radius` holds its mesh; float64, shape [N].
        heads: nodes at which walks start: they hold each leaf once, int64, shape [at most HEADS].
        leaf: of each element, -1 where it has none: without power, or infinitely far away; int64, shape [elements].
        within: probability of each element in its leaf, float64, shape [elements]; exactly 1/2 where halves are alike;
            0 in a ball, of which no element is chosen.
        apex: which of a triangle's corners its other half lacks; 0 without one; int64, shape [elements].
        distant: irradiance by the lights infinitely far away, as a share of all flux [1/m²].
    """

    center: Array
    radius: Array
    axis: Array
    cos_axes: Array
    cos_reach: Array
    strength: Array
    child: Numbers
    parent: Numbers
    first: Numbers
    last: Numbers
    ball: Array
    heads: Numbers
    leaf: Numbers
    within: Array
    apex: Numbers
    distant: float


@dataclass(frozen=True, eq=False)
class _Leaves:
    """What leaves hold: elements first to last, their box, axis, intensity, light; `around`: they have no axis.

    Of a ball, its middle and outer radius are told by the box.
    """

    first: Numbers
    last: Numbers
    low: Array
    high: Array
    axis: Array
    other_axis: Array
    around: NDArray[np.bool_]
    cos_reach: Array
    strength: Array
    light: Numbers
    ball: Array


def build_light_tree(table: LightTable) -> LightTree:
    """The tree of a scene's lights. Elements without power are left out."""
    power = np.asarray(table.power, np.float64)
    total = float(np.cumsum(power)[-1]) if len(power) else 0.0
    share = power / total if total > 0 else np.zeros_like(power)
    near = len(table.prim) + table.near
    far = np.cumsum(share[near:])
    distant = float(far[-1]) / (math.pi * table.scene_radius**2) if len(far) else 0.0
    leaves = _leaves(table, share[:near])
    nodes = _Nodes(leaves)
    leaf = np.full(len(power), -1, np.int64)
    within = np.zeros(len(power))
    rows = np.flatnonzero(nodes.child < 0)
    is_ball = nodes.ball[rows] > 0
    for row in rows[is_ball]:
        leaf[nodes.first[row] : nodes.last[row] + 1] = row
    rows = rows[~is_ball]
    first, last = nodes.first[rows], nodes.last[rows]
    leaf[first], leaf[last] = rows, rows
    both = power[first] + np.where(last > first, power[last], 0.0)
    within[first], within[last] = power[first] / both, power[last] / both
    within[np.abs(within - 0.5) < SAME_HALVES] = 0.5
    apex = np.zeros(len(power), np.int64)
    pairs = np.flatnonzero(last > first)
    apex[first[pairs]] = _apexes(table.corners[first[pairs]], table.corners[last[pairs]])
    apex[last[pairs]] = _apexes(table.corners[last[pairs]], table.corners[first[pairs]])
    return LightTree(
        center=nodes.center,
        radius=nodes.radius,
        axis=nodes.axis,
        cos_axes=nodes.cos_axes,
        cos_reach=nodes.cos_reach,
        strength=nodes.strength,
        child=nodes.child,
        parent=nodes.parent,
        first=nodes.first,
        last=nodes.last,
        ball=nodes.ball,
        heads=_heads(nodes),
        leaf=leaf,
        within=within,
        apex=apex,
        distant=distant,
    )


def _apexes(corners: NDArray[np.float32], others: NDArray[np.float32]) -> Numbers:
    """The corner of each triangle that its other half does not have, shape [N]; corners have shapes [N, 3, 3]."""
    return np.argmin(_shared(corners, others), axis=1)


def _shared(corners: NDArray[np.float32], others: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which corners of each triangle another has as well, shape [N, 3]; corners have shapes [N, 3, 3]."""
    shared = np.zeros(corners.shape[:2], np.bool_)
    for corner in range(3):
        other = others[:, None, corner]
        shared |= (
            (corners[..., 0] == other[..., 0]) & (corners[..., 1] == other[..., 1]) & (corners[..., 2] == other[..., 2])
        )
    return shared


def _dot(a: Array, b: Array) -> Array:
    """Row by row, in a fixed order."""
    product: Array = a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
    return product


def _leaves(table: LightTable, share: Array) -> _Leaves:
    triangles = len(table.prim)
    place = table.delta_position[: table.near].astype(np.float64)
    corners = table.corners.astype(np.float64)
    low = np.concatenate([corners.min(axis=1), place])
    high = np.concatenate([corners.max(axis=1), place])
    axis = np.zeros((len(share), 3))
    axis[:triangles] = triangle_normals(table.corners)
    axis[triangles:] = table.delta_axes[: table.near, 2]
    cos_reach = np.zeros(len(share))
    cutoff = table.delta_cutoff[: table.near].astype(np.float64)
    cos_reach[triangles:] = np.maximum(cutoff, 0.0)
    around = np.zeros(len(share), np.bool_)
    around[triangles:] = cutoff <= 0.0
    # Flux over intensity: of a Lambertian emitter along its normal, of a delta light on the mean over its cone.
    solid = np.full(len(share), math.pi)
    solid[triangles:] = 2.0 * math.pi * np.maximum(1.0 - cutoff, 1e-6)
    light = table.light[: len(share)].astype(np.int64)
    balls = balls_of(table)
    shines = share > 0
    for begin, end in zip(balls.first, balls.last, strict=True):
        shines[begin + 1 : end + 1] = False  # their first stands for all
    second = _quadrilaterals(table, axis[:triangles], shines[:triangles])
    first = np.flatnonzero(shines & ~np.concatenate([second, np.zeros(len(share) - triangles, np.bool_)]))
    last = first.copy()
    paired = first < triangles - 1
    paired[paired] = second[first[paired] + 1]
    last[paired] += 1
    strength = share / solid
    ball = np.zeros(len(share))
    for begin, end, center, radius, outside in zip(*vars(balls).values(), strict=True):
        low[begin], high[begin] = center - outside, center + outside
        ball[begin], around[begin] = radius, True
        strength[begin] = float(np.cumsum(share[begin : end + 1])[-1]) / (4.0 * math.pi)
        last[first == begin] = end
    return _Leaves(
        first=first,
        last=last,
        low=np.minimum(low[first], low[last]),
        high=np.maximum(high[first], high[last]),
        axis=axis[first],
        other_axis=axis[last],
        around=around[first],
        cos_reach=cos_reach[first],
        strength=strength[first] + np.where(paired, strength[last], 0.0),
        light=light[first],
        ball=ball[first],
    )


def _quadrilaterals(table: LightTable, normal: Array, shines: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which triangles are the second half of a flat quadrilateral whose first half is the triangle before; shape [E].

    Halves share two corners, a light and a normal.
    """
    second = np.zeros(len(normal), np.bool_)
    if len(normal) < 2:
        return second
    same = (table.light[: len(normal) - 1] == table.light[1 : len(normal)]) & shines[:-1] & shines[1:]
    same &= _dot(normal[:-1], normal[1:]) > SAME_NORMAL
    rows = np.flatnonzero(same)  # few, where lamps are round: corners take longest to compare
    same[rows] = _shared(table.corners[rows], table.corners[rows + 1]).sum(axis=1) == 2
    # In a run of triangles that all go with the one before, every other is a second half.
    start = np.flatnonzero(np.concatenate([[True], ~same]))
    place = np.arange(len(normal)) - np.repeat(start, np.diff(np.append(start, len(normal))))
    return np.asarray(place % 2 == 1)


class _Nodes:
    """The nodes over leaves, level by level. Attributes as in LightTree."""

    def __init__(self, leaves: _Leaves) -> None:
        count = len(leaves.first)
        size = max(2 * count - 1, 0)
        self.center, self.axis = np.zeros((size, 3)), np.zeros((size, 3))
        self.radius, self.cos_axes, self.cos_reach, self.strength = (np.zeros(size) for _ in range(4))
        self.child, self.parent = np.full(size, -1, np.int64), np.full(size, -1, np.int64)
        self.first, self.last = np.full(size, -1, np.int64), np.full(size, -1, np.int64)
        self.ball = np.zeros(size)
        if not count:
            return
        middles = _to_lattice(0.5 * (leaves.low + leaves.high))
        lights = _to_lattice(_light_middles(leaves))
        # All nodes of a level, and leaves of the levels before: node number[i] holds the leaves order[start[i]:end[i]].
        order = np.arange(count)
        number, start = np.zeros(1, np.int64), np.zeros(1, np.int64)
        made = 1
        levels = []
        fresh = np.ones(1, np.bool_)
        while True:
            self._describe(leaves, order, number, start, fresh)
            sizes = np.diff(np.append(start, count))
            inner = sizes > 1
            if not inner.any():
                break
            order, left = _halved(leaves.light, middles, lights, order, start, sizes)
            parents = number[inner]
            children = made + 2 * np.arange(len(parents))
            self.child[parents] = children
            self.parent[children] = self.parent[children + 1] = parents
            levels.append(parents)
            made += 2 * len(parents)
            halves = np.repeat(np.arange(len(sizes)), np.where(inner, 2, 1))
            right = np.concatenate([[False], halves[1:] == halves[:-1]])
            number, start = number[halves], start[halves] + np.where(right, left[halves], 0)
            fresh = inner[halves]
            number[fresh & ~right] = children
            number[fresh & right] = children + 1
        self.first[number], self.last[number] = leaves.first[order], leaves.last[order]
        self.strength[number], self.ball[number] = leaves.strength[order], leaves.ball[order]
        balls = number[leaves.ball[order] > 0]
        self.radius[balls] /= math.sqrt(3.0)  # of the sphere in a cube, from that around it
        for parents in reversed(levels):
            children = self.child[parents]
            self.strength[parents] = self.strength[children] + self.strength[children + 1]

    def _describe(
        self, leaves: _Leaves, order: Numbers, number: Numbers, start: Numbers, fresh: NDArray[np.bool_]
    ) -> None:
        """Spheres and cones of the fresh nodes."""
        member = np.repeat(np.arange(len(start)), np.diff(np.append(start, len(order))))
        low, high = leaves.low[order], leaves.high[order]
        center = 0.5 * (np.minimum.reduceat(low, start) + np.maximum.reduceat(high, start))
        arm = np.maximum(high - center[member], center[member] - low)
        radius = np.sqrt(np.maximum.reduceat(_dot(arm, arm), start))
        one, other = leaves.axis[order], leaves.other_axis[order]
        sums = np.concatenate([np.zeros((1, 3)), np.cumsum(one, axis=0)])
        axis = sums[np.append(start[1:], len(order))] - sums[start]
        length = np.sqrt(_dot(axis, axis))
        axis = np.divide(axis, length[:, None], out=np.zeros_like(axis), where=length[:, None] > 1e-6)
        cosine = np.minimum(_dot(axis[member], one), _dot(axis[member], other))
        cosine[leaves.around[order]] = ALL_AROUND
        cos_axes = np.where(length > 1e-6, np.minimum.reduceat(cosine, start), ALL_AROUND)
        cos_reach = np.minimum.reduceat(leaves.cos_reach[order], start)
        rows = number[fresh]
        self.center[rows], self.radius[rows], self.axis[rows] = center[fresh], radius[fresh], axis[fresh]
        self.cos_axes[rows], self.cos_reach[rows] = np.clip(cos_axes, -1.0, 1.0)[fresh], cos_reach[fresh]


def _light_middles(leaves: _Leaves) -> Array:
    """Middle of the box of each leaf's light, shape [leaves, 3]."""
    lights, row = np.unique(leaves.light, return_inverse=True)
    low, high = np.full((len(lights), 3), np.inf), np.full((len(lights), 3), -np.inf)
    np.minimum.at(low, row, leaves.low)
    np.maximum.at(high, row, leaves.high)
    middles: Array = 0.5 * (low + high)[row]
    return middles


def _to_lattice(places: Array) -> Array:
    rounded: Array = np.round(places / SAME_PLACE)
    return rounded


def _halved(
    light: Numbers, middles: Array, lights: Array, order: Numbers, start: Numbers, sizes: Numbers
) -> tuple[Numbers, Numbers]:
    """The leaves of each node sorted for its halving, and how many go to the left, shape [nodes].

    Args:
        light: number of each leaf's light.
        middles, lights: middle of each leaf, and of its light, as multiples of SAME_PLACE.
    """
    member = np.repeat(np.arange(len(start)), sizes)
    own = light[order]
    several = np.maximum.reduceat(own, start) != np.minimum.reduceat(own, start)
    place = np.where(several[member, None], lights[order], middles[order])
    extent = np.maximum.reduceat(place, start) - np.minimum.reduceat(place, start)
    key = place[np.arange(len(order)), np.argmax(extent, axis=1)[member]]
    order = order[np.lexsort((own, key, member))]
    own = light[order]
    # Number of the light within its node, from 0.
    begins = np.append(True, own[1:] != own[:-1])
    begins[start] = True
    rank = np.cumsum(begins) - 1
    rank = rank - rank[start][member]
    many = np.maximum.reduceat(rank, start) + 1
    before = np.add.reduceat((rank < (many // 2)[member]).astype(np.int64), start)
    return order, np.where(several, before, sizes // 2)


def _heads(nodes: _Nodes) -> Numbers:
    """The root, then again and again instead of the node with the largest strength times radius its children."""
    if not len(nodes.child):
        return np.zeros(0, np.int64)
    heads = [(_rank(nodes, 0), 0)]
    while len(heads) < HEADS and heads[0][0] < math.inf:
        _, node = heapq.heappop(heads)
        for child in (int(nodes.child[node]), int(nodes.child[node]) + 1):
            heapq.heappush(heads, (_rank(nodes, child), child))
    return np.array(sorted(node for _, node in heads), np.int64)


def _rank(nodes: _Nodes, node: int) -> float:
    if nodes.child[node] < 0:
        return math.inf
    mantissa, exponent = math.frexp(float(nodes.strength[node] * nodes.radius[node]))
    return -math.ldexp(round(mantissa / SAME_RANK) * SAME_RANK, exponent)
