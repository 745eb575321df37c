"""Choice of a light by how much it may send to a place: walks down, and chances up, the tree of scenes.flat.light_tree.

What a node may send to a place is its importance (importance.py). A walk starts among the heads and the lights
infinitely far away, whose irradiance counts as their importance, and goes down in proportion to importance, with one
random number.

Importance knows nothing of what stands in between: in a closed room next to a far stronger lamp, or under the sun, the
room's own lamp would hardly ever be asked. So a part of the walks (EVEN) starts evenly among those that may send
anything at all ("defensive" sampling, Hesterberg 1995): it costs what the strong ones get less, 1 / (1 - EVEN) of their
variance at most, and bounds the variance of every other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.lights.guide import Guide, start_factor
from wdpm.kernels.lights.importance import (
    ASKED,
    LANES,
    LightNode,
    expect_pair,
    importances_of_block,
    importances_of_pair,
)
from wdpm.kernels.rays.lanes import vec8
from wdpm.scenes.flat import light_tree
from wdpm.scenes.flat.light_table import LightTable

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LEAST_DISTANCE = 2.0**-20
"""Distances count for at least this share of the scene's radius: a point light's own place is no infinity."""

EVEN = wp.constant(wp.float64(2.0**-4))
"""Part of the walks that start evenly."""

DISTANT = wp.constant(wp.int32(-1))
NOTHING = wp.constant(wp.int32(-2))

BELOW_ONE = wp.constant(wp.float64(1.0 - 2.0**-53))
_ONE = wp.constant(wp.float64(1.0))
if TYPE_CHECKING:
    _Importances = Any
else:
    _Importances = wp.types.vector(length=light_tree.HEADS, dtype=wp.float32)


@wp.struct
class LightTree:
    """The tree on a device.

    Attributes:
        head_rows: the heads, as importances_of_block takes them.
        choices: heads, and one more if there are lights infinitely far away.
        ball: as scenes.flat.light_tree.LightTree has it, by node.
        ball_of: by glowing mesh, the leaf that it is as a ball; -1 of any other.
        least2: square of the least distance.
    """

    nodes: wp.array[LightNode]
    heads: wp.array[wp.int32]
    head_rows: wp.array[vec8]
    head_count: wp.int32
    choices: wp.int32
    leaf: wp.array[wp.int32]
    within: wp.array[wp.float64]
    apex: wp.array[wp.int32]
    ball: wp.array[wp.float32]
    ball_of: wp.array[wp.int32]
    distant: wp.float32
    least2: wp.float32


@wp.struct
class Starts:
    """Where walks for one place may start; nothing where there is no choice.

    Attributes:
        values: importances of the heads, as the guide weighs them.
        distant: that of the lights infinitely far away.
        total: of all.
        active: how many of them are above 0.
    """

    values: _Importances
    distant: wp.float32
    total: wp.float64
    active: wp.int32


@wp.struct
class LeafChoice:
    """A leaf, or DISTANT, or NOTHING, its probability, and the random number that is left, in [0, 1)."""

    node: wp.int32
    probability: wp.float32
    u: wp.float64


def upload(table: LightTable, device: str) -> LightTree:
    """Build the tree of a scene's lights, and bring it to a device."""
    built = light_tree.build_light_tree(table)
    node: Any = LightNode  # a warp struct, which type checkers take for the class that it was made of
    rows: Any = np.zeros(len(built.child), node.numpy_dtype())
    for name in ("center", "radius", "axis", "cos_axes", "cos_reach", "strength", "child", "parent", "first", "last"):
        rows[name] = getattr(built, name)
    rows["parent"][built.heads] = -1  # climbs end there
    rows["sin_axes"] = np.sqrt(1.0 - built.cos_axes**2)
    rows["radius2"] = built.radius**2
    tree = LightTree()
    tree.nodes = wp.array(rows, dtype=LightNode, device=device)
    tree.heads = wp.array(built.heads, dtype=wp.int32, device=device)
    tree.head_rows = wp.array(_rows_of(rows[built.heads]), dtype=vec8, device=device)
    tree.head_count = len(built.heads)
    tree.choices = len(built.heads) + int(built.distant > 0)
    tree.leaf = wp.array(built.leaf, dtype=wp.int32, device=device)
    tree.apex = wp.array(built.apex, dtype=wp.int32, device=device)
    tree.within = wp.array(built.within, dtype=wp.float64, device=device)
    tree.ball = wp.array(built.ball, dtype=wp.float32, device=device)
    tree.ball_of = wp.array(_balls_of(table, built), dtype=wp.int32, device=device)
    tree.distant = built.distant
    tree.least2 = (LEAST_DISTANCE * table.scene_radius) ** 2
    return tree


def _balls_of(table: LightTable, built: light_tree.LightTree) -> NDArray[np.int64]:
    """LightTree.ball_of."""
    ball_of = np.full(len(table.emitter_texture), -1, np.int64)
    leaves = np.flatnonzero(built.ball > 0)
    ball_of[table.emitter[built.first[leaves]]] = leaves
    return ball_of


def _rows_of(nodes: NDArray[Any]) -> NDArray[np.float32]:
    """Nodes as blocks of LANES, shape [blocks * ASKED, LANES]; lanes that are left are 0."""
    rows = np.zeros((-(-len(nodes) // LANES) * LANES, len(ASKED)), np.float32)
    for row, asked in enumerate(ASKED):
        name, _, axis = asked.partition(".c")
        if name == "flat_from":
            rows[: len(nodes), row] = np.where(nodes["child"] < 0, 1.0, 2.0)
        else:
            rows[: len(nodes), row] = nodes[name][:, int(axis[1])] if axis else nodes[name]
    return np.ascontiguousarray(rows.reshape(-1, LANES, len(ASKED)).transpose(0, 2, 1)).reshape(-1, LANES)


@wp.func
def defensive(value: wp.float64, total: wp.float64, active: wp.int32) -> wp.float64:
    """What an importance above 0 counts for where walks start, mixed with an even share of all; sums stay `total`.

    Args:
        active: how many there are of importance above 0.
    """
    return value * (_ONE - EVEN) + total * (EVEN / wp.float64(active))


@wp.func
def starts_at(tree: wp.ref[LightTree], guide: wp.ref[Guide], region: wp.int32, position: wp.vec3) -> Starts:
    """Where walks for a place may start.

    Args:
        region: of the place in the guide.
    """
    s = Starts()
    if tree.choices == 1:
        return s  # nothing to choose
    s.distant = tree.distant * start_factor(guide, region, tree.choices - 1)
    s.total = wp.float64(s.distant)
    s.active = wp.int32(s.distant > 0.0)
    for block in range((tree.head_count + LANES - 1) // LANES):
        importances = importances_of_block(tree.head_rows, block, position, tree.least2)
        for lane in range(wp.min(LANES, tree.head_count - LANES * block)):
            i = LANES * block + lane
            value = importances[lane] * start_factor(guide, region, i)
            s.values[i] = value
            s.total += wp.float64(value)
            s.active += wp.int32(value > 0.0)
    return s


@wp.func
def _start(tree: wp.ref[LightTree], starts: wp.ref[Starts], u: wp.float64) -> LeafChoice:
    """A head, or DISTANT, or NOTHING."""
    c = LeafChoice()
    c.u = u
    c.node = NOTHING
    if tree.choices == 1:
        c.probability = 1.0
        c.node = DISTANT
        if tree.head_count == 1:
            c.node = tree.heads[0]
        return c
    total = starts.total
    rest = u * total
    value = wp.float64(0.0)
    found = wp.int32(0)
    for i in range(tree.head_count):
        if found == 0 and starts.values[i] > 0.0:
            # The last that has any is kept if rounding leaves a rest beyond all.
            c.node = tree.heads[i]
            value = defensive(wp.float64(starts.values[i]), total, starts.active)
            if rest < value:
                found = 1
            else:
                rest -= value
    if found == 0 and starts.distant > 0.0:
        c.node = DISTANT
        value = defensive(wp.float64(starts.distant), total, starts.active)
        found = 1
    if c.node != NOTHING:
        c.u = BELOW_ONE
        if found == 1:
            c.u = wp.min(rest / value, BELOW_ONE)
        c.probability = wp.float32(value / total)
    return c


@wp.func
def find_leaf(tree: wp.ref[LightTree], starts: wp.ref[Starts], position: wp.vec3, u: wp.float64) -> LeafChoice:
    """A leaf, chosen for a place.

    Args:
        starts: of the place.
        u: number in [0, 1).
    """
    return walk_down(tree, _start(tree, starts, u), position)


@wp.func
def walk_down(tree: wp.ref[LightTree], start: LeafChoice, position: wp.vec3) -> LeafChoice:
    """A leaf below a node that was chosen; DISTANT and NOTHING stay what they are."""
    c = start
    child = wp.int32(-1)
    if c.node >= 0:
        child = tree.nodes[c.node].child
    while child >= 0:
        expect_pair(tree.nodes, tree.nodes[child].child)
        expect_pair(tree.nodes, tree.nodes[child + 1].child)
        both = importances_of_pair(tree.nodes, child, position, tree.least2)
        one = wp.float64(both[0])
        other = wp.float64(both[1])
        total = one + other
        if not total > wp.float64(0.0):
            c.node = NOTHING
            return c
        share = one / total
        if c.u < share:
            c.u = wp.min(c.u / share, BELOW_ONE)
            c.probability = c.probability * wp.float32(share)
            c.node = child
        else:
            c.u = wp.min((c.u - share) / (_ONE - share), BELOW_ONE)
            c.probability = c.probability * wp.float32(other / total)
            c.node = child + 1
        child = tree.nodes[c.node].child
    return c


@wp.func
def chance_of_start(
    tree: wp.ref[LightTree], guide: wp.ref[Guide], region: wp.int32, number: wp.int32, position: wp.vec3
) -> wp.float32:
    """Probability with which a walk for a place starts at a head, or DISTANT."""
    if tree.choices == 1:
        return 1.0
    starts = starts_at(tree, guide, region, position)
    own = wp.float64(0.0)
    for i in range(tree.head_count):
        if tree.heads[i] == number:
            own = wp.float64(starts.values[i])
    if number == DISTANT:
        own = wp.float64(starts.distant)
    if not own > wp.float64(0.0):
        return 0.0
    return wp.float32(defensive(own, starts.total, starts.active) / starts.total)


@wp.func
def chance_of_leaf(
    tree: wp.ref[LightTree], guide: wp.ref[Guide], region: wp.int32, leaf: wp.int32, position: wp.vec3
) -> wp.float32:
    """Probability with which find_leaf comes to a leaf."""
    probability = wp.float32(1.0)
    node = wp.int32(leaf)
    parent = tree.nodes[node].parent
    while parent >= 0:
        pair = ((node - 1) & -2) + 1
        expect_pair(tree.nodes, ((parent - 1) & -2) + 1)
        both = importances_of_pair(tree.nodes, pair, position, tree.least2)
        own = wp.float64(both[node - pair])
        if not own > wp.float64(0.0):
            return 0.0
        probability = probability * wp.float32(own / (own + wp.float64(both[1 - (node - pair)])))
        node = parent
        parent = tree.nodes[node].parent
    return probability * chance_of_start(tree, guide, region, node, position)
