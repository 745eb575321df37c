"""The choice of a light for a place: an element by the light tree, and a point on it; and the density of what it chose.

Points of a glowing triangle are even over its area. Close to a lamp a few of them would have nearly all of its light:
the squared distance to them may be arbitrarily small, and the variance has no bound. So the points of a lamp that is
near are even over the solid angle in which it is seen (spherical_triangle), and what arrives by them differs by the
cosine at the place alone. So are those of a ball, however far away (balls).
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.lights.balls import solid_angle_of_ball
from wdpm.kernels.lights.elements import Lights, choose_element, probability_of, rest_of_choice
from wdpm.kernels.lights.guide import region_of
from wdpm.kernels.lights.tree import (
    BELOW_ONE,
    DISTANT,
    NOTHING,
    LeafChoice,
    Starts,
    chance_of_leaf,
    chance_of_start,
    find_leaf,
    starts_at,
)
from wdpm.kernels.maths.directions import triangle_weights
from wdpm.kernels.maths.random import rounded_down
from wdpm.kernels.maths.spherical_triangle import direction_in_triangle, solid_angle, weights_seen

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NEAR2 = wp.constant(wp.float32(2.25))
"""Square of the distance up to which a lamp is near, in radii of its sphere: beyond, no point of it is closer than half
a radius, and none further than five times as far as another."""

LEAST_ANGLE = wp.constant(wp.float64(1e-5))
"""Solid angle from which on it is used [sr]. A lamp that is near and seen under less is seen edge-on, lights hardly
anything, and its solid angle is known to few digits."""

_HALF = wp.constant(wp.float64(0.5))
_ONE = wp.constant(wp.float64(1.0))
_ZERO = wp.constant(wp.float64(0.0))


@wp.struct
class ElementChoice:
    """An element and its probability; -1 and 0 where none sends light to the place.

    Attributes:
        ball: radius, if it belongs to a ball, all of which was chosen; else 0.
        leaf: of the ball in the light tree.
        solid_angle: of the triangle or ball, where its point is even over that [sr]; 0 where it is even over the area.
        u: a point of the unit square: what the choice left of the random numbers, as good as fresh ones.
        weights: of corners 1 and 2: the point's place on a triangle.
    """

    element: wp.int32
    ball: wp.float32
    leaf: wp.int32
    probability: wp.float32
    solid_angle: wp.float32
    u: wp.vec2
    weights: wp.vec2


@wp.struct
class LeafSeen:
    """The one or two triangles of a leaf as seen from a place that is near.

    Attributes:
        near: 0 where points are to be even over the area; then nothing else is set.
        first, last: solid angles [sr].
        share: probability of the first triangle in its leaf: by solid angle, and by how strongly it shines.
    """

    near: wp.int32
    first: wp.float64
    last: wp.float64
    share: wp.float64


_EXPECT_TRIANGLE = """
#if !defined(__CUDA_ARCH__)
    const char* three = (const char*)(corners.data + 3 * element);
    __builtin_prefetch(three);
    __builtin_prefetch(three + 35);
    __builtin_prefetch(normal.data + element);
    __builtin_prefetch(within.data + element);
#endif
"""


@wp.func_native(_EXPECT_TRIANGLE)
def expect_triangle(
    corners: wp.array2d[wp.vec3], normal: wp.array[wp.vec3], within: wp.array[wp.float64], element: wp.int32
) -> None:
    """Have a processor fetch all that is asked of a glowing triangle at once, not one after another."""
    ...


@wp.func
def _corner(lights: wp.ref[Lights], element: wp.int32, corner: wp.int32, position: wp.vec3) -> wp.vec3d:
    """A corner of a glowing triangle as seen from a place."""
    return wp.vec3d(lights.corners[element, corner]) - wp.vec3d(position)


@wp.func
def _angle(lights: wp.ref[Lights], element: wp.int32, position: wp.vec3) -> wp.float64:
    return solid_angle(
        _corner(lights, element, 0, position),
        _corner(lights, element, 1, position),
        _corner(lights, element, 2, position),
    )


@wp.func
def leaf_seen(lights: wp.ref[Lights], leaf: wp.int32, position: wp.vec3) -> LeafSeen:
    """How a leaf is seen from a place."""
    seen = LeafSeen()
    node = lights.tree.nodes[leaf]
    if node.first < lights.triangles and wp.length_sq(position - node.center) < NEAR2 * node.radius2:
        seen.share = _ONE
        seen.first = _angle(lights, node.first, position)
        if node.last > node.first:
            seen.last = _angle(lights, node.last, position)
            one = seen.first * lights.tree.within[node.first] / wp.float64(lights.area[node.first])
            other = seen.last * lights.tree.within[node.last] / wp.float64(lights.area[node.last])
            if one + other > _ZERO:
                seen.share = one / (one + other)
        if seen.first + seen.last > LEAST_ANGLE:
            seen.near = 1
    return seen


@wp.func
def _choose_seen(
    lights: wp.ref[Lights], first: wp.int32, last: wp.int32, seen: LeafSeen, position: wp.vec3, u: wp.vec2d
) -> ElementChoice:
    """A point of a leaf that is near, even over the solid angle; its probability is that within the leaf."""
    c = ElementChoice()
    c.element = first
    share = seen.share
    angle = seen.first
    left = u[0]
    if left < share:
        left = wp.min(left / share, BELOW_ONE)
    else:
        left = wp.min((left - share) / (_ONE - share), BELOW_ONE)
        c.element = last
        share = _ONE - share
        angle = seen.last
    c.probability = wp.float32(share)
    c.solid_angle = wp.float32(angle)
    p0 = _corner(lights, c.element, 0, position)
    p1 = _corner(lights, c.element, 1, position)
    p2 = _corner(lights, c.element, 2, position)
    c.weights = weights_seen(p0, p1, p2, direction_in_triangle(p0, p1, p2, angle, wp.vec2d(left, u[1])))
    return c


@wp.func
def light_starts(lights: wp.ref[Lights], position: wp.vec3) -> Starts:
    """What all choices of a light for one place have in common."""
    return starts_at(lights.tree, lights.guide, region_of(lights.guide, position), position)


@wp.func
def choose_light(lights: wp.ref[Lights], position: wp.vec3, starts: wp.ref[Starts], u: wp.vec2d) -> ElementChoice:
    """An element that may light a place, chosen by what it may send there (light_tree), and a point on it.

    The first number chooses, and what is left of it goes into the point: points that are stratified in the unit square
    are stratified over all lights together.

    Args:
        starts: light_starts of the place.
        u: point of the unit square.
    """
    leaf = find_leaf(lights.tree, starts, position, u[0])
    return choose_below(lights, region_of(lights.guide, position), leaf, position, u[1])


@wp.func
def _choose_distant(
    shares: wp.array[wp.float64], lights: wp.ref[Lights], leaf: LeafChoice, u: wp.float64
) -> ElementChoice:
    """One of the lights infinitely far away, by their cumulative shares."""
    c = ElementChoice()
    distant = choose_element(shares, lights.count - lights.first_distant, leaf.u)
    c.element = lights.first_distant + distant
    c.probability = leaf.probability * probability_of(shares, distant)
    c.u = wp.vec2(rounded_down(rest_of_choice(shares, distant, leaf.u)), rounded_down(u))
    c.weights = triangle_weights(c.u)
    return c


@wp.func
def _choose_ball(lights: wp.ref[Lights], leaf: LeafChoice, position: wp.vec3, u: wp.vec2) -> ElementChoice:
    """All of a ball."""
    c = ElementChoice()
    c.element = lights.tree.nodes[leaf.node].first
    c.leaf = leaf.node
    c.ball = lights.tree.ball[leaf.node]
    c.solid_angle = solid_angle_of_ball(lights.tree.nodes[leaf.node], c.ball, position)
    if c.solid_angle > 0.0:
        c.probability = leaf.probability
    c.u = u
    return c


@wp.func
def choose_below(
    lights: wp.ref[Lights], region: wp.int32, leaf: LeafChoice, position: wp.vec3, rest: wp.float64
) -> ElementChoice:
    """An element of a leaf that was chosen for a place, and a point on it.

    Args:
        region: of the place in the guide.
        rest: number in [0, 1), besides the one that the choice of the leaf has left.
    """
    u = wp.vec2d(leaf.u, rest)
    c = ElementChoice()
    c.element = -1
    left = leaf.u
    if leaf.node == DISTANT:
        if region >= 0 and lights.guide.distant.shape[1] > 0:
            return _choose_distant(lights.guide.distant[region], lights, leaf, rest)
        return _choose_distant(lights.distant, lights, leaf, rest)
    if leaf.node != NOTHING:
        c.element = lights.tree.nodes[leaf.node].first
        last = lights.tree.nodes[leaf.node].last
        if last > c.element + 1:
            return _choose_ball(lights, leaf, position, wp.vec2(rounded_down(left), rounded_down(rest)))
        if c.element < lights.triangles:
            expect_triangle(lights.corners, lights.normal, lights.tree.within, c.element)
            if last > c.element:
                expect_triangle(lights.corners, lights.normal, lights.tree.within, last)
        seen = leaf_seen(lights, leaf.node, position)
        if seen.near == 1:
            c = _choose_seen(lights, c.element, last, seen, position, u)
            c.probability = c.probability * leaf.probability
            return c
        c.probability = leaf.probability
        if last > c.element:
            share = lights.tree.within[c.element]
            if share == _HALF:
                across = wp.vec2(rounded_down(left), rounded_down(u[1]))
                if across[0] + across[1] > 1.0:
                    across = wp.vec2(1.0 - across[0], 1.0 - across[1])
                    c.element = last
                c.probability = c.probability * 0.5
                c.weights = turned(across, lights.tree.apex[c.element])
                return c
            if left < share:
                left = wp.min(left / share, BELOW_ONE)
            else:
                left = wp.min((left - share) / (_ONE - share), BELOW_ONE)
                c.element = last
            c.probability = c.probability * wp.float32(lights.tree.within[c.element])
    c.u = wp.vec2(rounded_down(left), rounded_down(u[1]))
    c.weights = triangle_weights(c.u)
    return c


@wp.func
def turned(across: wp.vec2, apex: wp.int32) -> wp.vec2:
    """Weights of corners 1 and 2 from those of the two corners that follow the apex.

    With them the unit square covers a parallelogram evenly and without a seam: one half of it lies on the one
    triangle, with its apex at (0, 0), the other on the other, with its apex at (1, 1).
    """
    weights = across
    if apex == 1:
        weights = wp.vec2(1.0 - across[0] - across[1], across[0])
    elif apex == 2:
        weights = wp.vec2(across[1], 1.0 - across[0] - across[1])
    return weights


@wp.func
def chance_of_light(lights: wp.ref[Lights], element: wp.int32, position: wp.vec3) -> ElementChoice:
    """Probability with which choose_light chooses an element for a place, and how it does so: no u, no weights.

    Of an element of a ball, that of all of the ball.
    """
    c = ElementChoice()
    c.element = element
    region = region_of(lights.guide, position)
    if element >= lights.first_distant:
        distant = element - lights.first_distant
        of_distant = wp.float32(0.0)
        if region >= 0 and lights.guide.distant.shape[1] > 0:
            of_distant = probability_of(lights.guide.distant[region], distant)
        else:
            of_distant = probability_of(lights.distant, distant)
        c.probability = chance_of_start(lights.tree, lights.guide, region, DISTANT, position) * of_distant
        return c
    leaf = lights.tree.leaf[element]
    if leaf < 0:
        return c
    c.probability = chance_of_leaf(lights.tree, lights.guide, region, leaf, position)
    if lights.tree.nodes[leaf].last > lights.tree.nodes[leaf].first + 1:
        c.leaf = leaf
        c.ball = lights.tree.ball[leaf]
        c.solid_angle = solid_angle_of_ball(lights.tree.nodes[leaf], c.ball, position)
        if c.solid_angle <= 0.0:
            c.probability = 0.0
        return c
    seen = leaf_seen(lights, leaf, position)
    if seen.near == 0:
        c.probability = c.probability * wp.float32(lights.tree.within[element])
        return c
    share = seen.share
    angle = seen.first
    if element != lights.tree.nodes[leaf].first:
        share = _ONE - share
        angle = seen.last
    c.probability = c.probability * wp.float32(share)
    c.solid_angle = wp.float32(angle)
    return c


@wp.func
def pdf_to_ball(lights: wp.ref[Lights], leaf: wp.int32, position: wp.vec3) -> wp.float32:
    """pdf_solid_angle with which choose_light finds any point of a ball that a place sees."""
    angle = solid_angle_of_ball(lights.tree.nodes[leaf], lights.tree.ball[leaf], position)
    if angle <= 0.0:
        return 0.0
    return chance_of_leaf(lights.tree, lights.guide, region_of(lights.guide, position), leaf, position) / angle


@wp.func
def pdf_on_triangle(lights: wp.ref[Lights], c: ElementChoice, distance2: wp.float32, cosine: wp.float32) -> wp.float32:
    """pdf_solid_angle about the place of a point on the glowing triangle that was chosen, or may be.

    Args:
        distance2: squared distance to the point.
        cosine: between the triangle's normal and the way from the point to the place, above 0.
    """
    if c.solid_angle > 0.0:
        return c.probability / c.solid_angle
    return distance2 * (c.probability / lights.area[c.element]) / cosine
