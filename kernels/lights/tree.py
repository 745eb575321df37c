"""Choice of a light by how much it may send to a place: walks down, and chances up, the tree of scenes.flat.light_tree.

What a node may send to a place, its importance, is strength / distance² * cosine, in the terms of Conty Estevez & Kulla
2018: the distance is to the middle of its sphere, at least half the sphere's radius, and the cosine is of the least
angle that may lie between an element's axis and its way to the place. Nothing is asked of the receiver: surfaces may be
glossy or let light through. It is zero only where the angle is certainly (by MARGIN) too large for any light, so all
light that arrives may be found.

A walk starts among the heads and the lights infinitely far away, whose irradiance counts as their importance, and goes
down in proportion to importance, with one random number.

Importance knows nothing of what stands in between: in a closed room next to a far stronger lamp, or under the sun, the
room's own lamp would hardly ever be asked. So a part of the walks (EVEN) starts evenly among those that may send
anything at all ("defensive" sampling, Hesterberg 1995): it costs what the strong ones get less, 1 / (1 - EVEN) of their
variance at most, and bounds the variance of every other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from wdpm.kernels.lights.guide import Guide, start_factor
from wdpm.scenes.flat import light_tree
from wdpm.scenes.flat.light_table import LightTable

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MARGIN = wp.constant(wp.float32(2.0**-8))
"""What a cosine may be below that of the reach and still count; and what cosines count for at least.

In float32 a sine near 0 is known to 3e-4 (the root of 1 - cos²), and three angles are combined: 2^-8 is four times as
much.
"""

CLOSE2 = wp.constant(wp.float32(0.25))
"""Square of the least distance to a node, in radii of its sphere.

Points spread evenly over a ball of radius r send 3 / r² on the mean to its middle: 1 / r² would let a few lights close
by, in a node of many, come off badly. A quarter was best of 1, 1/2 and 1/4 in a hall of 1000 lamps.
"""

IN_PLANE = wp.constant(wp.float32(2.0**-12))
"""Height over a flat lamp, in radii of its sphere, up to which a place counts as in its plane: what is lit there is lit
at grazing angles, and little. The chance is lowered, not taken away, so the estimate stays unbiased."""

LEAST_DISTANCE = 2.0**-20
"""Distances count for at least this share of the scene's radius: a point light's own place is no infinity."""

EVEN = wp.constant(wp.float64(2.0**-4))
"""Part of the walks that start evenly."""

DISTANT = wp.constant(wp.int32(-1))
NOTHING = wp.constant(wp.int32(-2))

BELOW_ONE = wp.constant(wp.float64(1.0 - 2.0**-53))
_ONE = wp.constant(wp.float64(1.0))
_Importances = wp.types.vector(length=light_tree.HEADS, dtype=wp.float32)


@wp.struct
class LightNode:
    """As scenes.flat.light_tree.LightTree has it; the parent of a head is -1.

    Attributes:
        radius2: square of the radius.
        sin_axes: sine that goes with cos_axes.
    """

    center: wp.vec3
    radius: wp.float32
    axis: wp.vec3
    radius2: wp.float32
    cos_axes: wp.float32
    sin_axes: wp.float32
    cos_reach: wp.float32
    strength: wp.float32
    child: wp.int32
    parent: wp.int32
    first: wp.int32
    last: wp.int32


@wp.struct
class LightTree:
    """The tree on a device.

    Attributes:
        choices: heads, and one more if there are lights infinitely far away.
        least2: square of the least distance.
    """

    nodes: wp.array[LightNode]
    heads: wp.array[wp.int32]
    head_count: wp.int32
    choices: wp.int32
    leaf: wp.array[wp.int32]
    within: wp.array[wp.float64]
    apex: wp.array[wp.int32]
    distant: wp.float32
    least2: wp.float32


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
    tree.head_count = len(built.heads)
    tree.choices = len(built.heads) + int(built.distant > 0)
    tree.leaf = wp.array(built.leaf, dtype=wp.int32, device=device)
    tree.apex = wp.array(built.apex, dtype=wp.int32, device=device)
    tree.within = wp.array(built.within, dtype=wp.float64, device=device)
    tree.distant = built.distant
    tree.least2 = (LEAST_DISTANCE * table.scene_radius) ** 2
    return tree


_EXPECT_PAIR = """
#if !defined(__CUDA_ARCH__)
    if (first >= 0) {
        __builtin_prefetch(nodes.data + first);
        __builtin_prefetch(nodes.data + first + 1);
    }
#endif
"""


@wp.func_native(_EXPECT_PAIR)
def expect_pair(nodes: wp.array[LightNode], first: wp.int32) -> None:
    """Have a processor fetch two nodes, a cache line each, while others are looked at; none for a number below 0.

    A tree of many lights is larger than its second-level cache, and each node says where the next ones lie: without
    this, a walk waits for memory at each level, which takes as long as all that is computed there.
    """
    ...


@wp.func
def importance(tree: wp.ref[LightTree], number: wp.int32, position: wp.vec3) -> wp.float32:
    """What a node may send to a place; 0 only where it certainly sends nothing."""
    node = tree.nodes[number]
    way = position - node.center
    distance2 = wp.dot(way, way)
    value = node.strength / wp.max(wp.max(distance2, node.radius2 * CLOSE2), tree.least2)
    if distance2 > node.radius2 and node.cos_axes > -1.0:
        # Of the angle between axis and way, what the spread of the axes leaves, and then what the sphere's size leaves.
        inverse = 1.0 / wp.sqrt(distance2)
        cosine = wp.clamp(wp.dot(way, node.axis) * inverse, -1.0, 1.0)
        sine = wp.float32(0.0)
        if cosine < node.cos_axes:
            whole = wp.sqrt(1.0 - cosine * cosine)
            sine = wp.max(whole * node.cos_axes - cosine * node.sin_axes, 0.0)
            cosine = cosine * node.cos_axes + whole * node.sin_axes
        else:
            cosine = wp.float32(1.0)
        size = node.radius * inverse
        cos_size = wp.sqrt(wp.max(1.0 - size * size, 0.0))
        if cosine < cos_size:
            cosine = cosine * cos_size + sine * size
        else:
            cosine = wp.float32(1.0)
        if cosine < node.cos_reach - MARGIN:
            return 0.0
        value = value * wp.max(cosine, MARGIN)
    elif node.child < 0 and node.cos_axes >= 1.0 and wp.dot(way, node.axis) <= IN_PLANE * node.radius:
        value = value * MARGIN  # a flat lamp seen from a place in its own plane, such as the rest of a glowing wall
    return value


@wp.func
def defensive(value: wp.float64, total: wp.float64, active: wp.int32) -> wp.float64:
    """What an importance above 0 counts for where walks start, mixed with an even share of all; sums stay `total`.

    Args:
        active: how many there are of importance above 0.
    """
    return value * (_ONE - EVEN) + total * (EVEN / wp.float64(active))


@wp.func
def _start(
    tree: wp.ref[LightTree], guide: wp.ref[Guide], region: wp.int32, position: wp.vec3, u: wp.float64
) -> LeafChoice:
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
    values = _Importances()
    distant = tree.distant * start_factor(guide, region, tree.choices - 1)
    total = wp.float64(distant)
    active = wp.int32(distant > 0.0)
    for i in range(tree.head_count):
        values[i] = importance(tree, tree.heads[i], position) * start_factor(guide, region, i)
        total += wp.float64(values[i])
        active += wp.int32(values[i] > 0.0)
    rest = u * total
    value = wp.float64(0.0)
    found = wp.int32(0)
    for i in range(tree.head_count):
        if found == 0 and values[i] > 0.0:
            # The last that has any is kept if rounding leaves a rest beyond all.
            c.node = tree.heads[i]
            value = defensive(wp.float64(values[i]), total, active)
            if rest < value:
                found = 1
            else:
                rest -= value
    if found == 0 and distant > 0.0:
        c.node = DISTANT
        value = defensive(wp.float64(distant), total, active)
        found = 1
    if c.node != NOTHING:
        c.u = BELOW_ONE
        if found == 1:
            c.u = wp.min(rest / value, BELOW_ONE)
        c.probability = wp.float32(value / total)
    return c


@wp.func
def find_leaf(
    tree: wp.ref[LightTree], guide: wp.ref[Guide], region: wp.int32, position: wp.vec3, u: wp.float64
) -> LeafChoice:
    """A leaf, chosen for a place.

    Args:
        region: of the place in the guide.
        u: number in [0, 1).
    """
    return walk_down(tree, _start(tree, guide, region, position, u), position)


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
        one = wp.float64(importance(tree, child, position))
        other = wp.float64(importance(tree, child + 1, position))
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
    distant = tree.distant * start_factor(guide, region, tree.choices - 1)
    total = wp.float64(distant)
    active = wp.int32(distant > 0.0)
    own = wp.float64(0.0)
    for i in range(tree.head_count):
        value = wp.float64(importance(tree, tree.heads[i], position) * start_factor(guide, region, i))
        total += value
        active += wp.int32(value > wp.float64(0.0))
        if tree.heads[i] == number:
            own = value
    if number == DISTANT:
        own = wp.float64(distant)
    if not own > wp.float64(0.0):
        return 0.0
    return wp.float32(defensive(own, total, active) / total)


@wp.func
def chance_of_leaf(
    tree: wp.ref[LightTree], guide: wp.ref[Guide], region: wp.int32, leaf: wp.int32, position: wp.vec3
) -> wp.float32:
    """Probability with which find_leaf comes to a leaf."""
    probability = wp.float32(1.0)
    node = wp.int32(leaf)
    while tree.nodes[node].parent >= 0:
        sibling = ((node - 1) ^ 1) + 1
        expect_pair(tree.nodes, ((tree.nodes[node].parent - 1) & -2) + 1)
        own = wp.float64(importance(tree, node, position))
        if not own > wp.float64(0.0):
            return 0.0
        probability = probability * wp.float32(own / (own + wp.float64(importance(tree, sibling, position))))
        node = tree.nodes[node].parent
    return probability * chance_of_start(tree, guide, region, node, position)
