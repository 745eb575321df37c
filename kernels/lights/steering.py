"""Photons steered towards where they are of use: the numbers that they set out by, warped.

Whatever shines, a photon's start is a function of six numbers in [0, 1): one chooses the element, two the point on it
(or where in the scene's silhouette a line of parallel light runs), two the direction, and one, in the caustic pass, at
which target it is aimed. A tree halves this cube again and
again, and of each node knows the chance of its lower half (hierarchical sample warping, Clarberg et al. 2005): numbers
that were stratified stay so. A photon of a leaf carries the leaf's volume over its chance, so that the mean is the same
whatever the tree says, as long as no chance is 0.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_BELOW_ONE = wp.constant(wp.float64(1 - 2.0**-24))

_Numbers = wp.types.vector(length=6, dtype=wp.float64)


@wp.struct
class Steering:
    """The tree, as cluster.steering has it; count 0 where photons are not steered."""

    count: wp.int32
    axis: wp.array[wp.int32]
    lower: wp.array[wp.int32]
    split: wp.array[wp.float64]
    chance: wp.array[wp.float64]


@wp.struct
class StartNumbers:
    """The numbers that a photon sets out by.

    Attributes:
        weight: by which its flux is multiplied.
    """

    element: wp.float64
    point: wp.vec2d
    direction: wp.vec2d
    target: wp.float64
    weight: wp.float32


def upload(
    axis: NDArray[np.int32],
    lower: NDArray[np.int32],
    split: NDArray[np.float64],
    chance: NDArray[np.float64],
    device: str,
) -> Steering:
    """A tree on a device."""
    steering = Steering()
    steering.count = len(axis)
    steering.axis = wp.array(axis, dtype=wp.int32, device=device)
    steering.lower = wp.array(lower, dtype=wp.int32, device=device)
    steering.split = wp.array(split, dtype=wp.float64, device=device)
    steering.chance = wp.array(chance, dtype=wp.float64, device=device)
    return steering


@wp.func
def steered(steering: wp.ref[Steering], start: StartNumbers) -> StartNumbers:
    """Numbers warped by the tree: down from its root, each half chosen by the number of its axis."""
    one = wp.float64(1.0)
    point, direction = start.point, start.direction
    inside = _Numbers(start.element, point[0], point[1], direction[0], direction[1], start.target)
    low = _Numbers()
    width = _Numbers(one, one, one, one, one, one)
    weight = wp.float64(1.0)
    node = wp.int32(0)
    if steering.count == 0:
        node = wp.int32(-1)
    while node >= 0 and steering.lower[node] > 0:
        axis = steering.axis[node]
        chance = steering.chance[node]
        split = steering.split[node]
        lower = steering.lower[node]
        if inside[axis] < chance:
            inside[axis] = wp.min(inside[axis] / chance, _BELOW_ONE)
            width[axis] = width[axis] * split
            weight = weight * split / chance
            node = lower
        else:
            rest = one - chance
            inside[axis] = wp.min((inside[axis] - chance) / rest, _BELOW_ONE)
            low[axis] = low[axis] + width[axis] * split
            width[axis] = width[axis] * (one - split)
            weight = weight * (one - split) / rest
            node = lower + 1
    low = low + wp.cw_mul(inside, width)
    s = StartNumbers()
    s.element = low[0]
    s.point = wp.vec2d(low[1], low[2])
    s.direction = wp.vec2d(low[3], low[4])
    s.target = low[5]
    s.weight = wp.float32(weight)
    return s
