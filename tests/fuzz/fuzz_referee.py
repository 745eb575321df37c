"""Exact arithmetic decides where float64 is in doubt: one ray and one triangle in rational numbers.

All inputs are floats, so corners, directions and all that follows from them by + - * / are exact fractions. What is
asked is not whether the ray meets the triangle, but whether it meets it by more than the renderer's own error bound:
only then must the renderer have found it.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

EDGE_MARGIN = Fraction(1, 2**47)
"""Of (projected size) * (distance): an edge function of the triangle test is known to that.

With r = 2^-53, a sheared coordinate x - (d0 / d2) z is off by at most 6 r C, where C is the largest component of a
corner less the origin; an edge function, a difference of two products of coordinates of size s, by
4 s * 6 r C + 3 r s², and s is at most 2 C: 30 r s C < 2^-48 s C.
"""


@dataclass(frozen=True)
class Meeting:
    """A ray that surely meets a triangle.

    Attributes:
        t: where, in units of the direction.
        slack: how far the t that is found may be above, since weights and edge crossings are rounded.
    """

    t: float
    slack: float


def sure_meeting(triangle: Array, origin: Array, direction: Array) -> Meeting | None:
    """Where the ray meets the triangle, or None if it does not, or by less than the renderer can tell."""
    corners = [[Fraction(float(x)) for x in corner] for corner in triangle]
    o = [Fraction(float(x)) for x in origin]
    d = [Fraction(float(x)) for x in direction]
    k = max(range(3), key=lambda axis: abs(d[axis]))
    i, j = (k + 1) % 3, (k + 2) % 3
    moved = [[corner[axis] - o[axis] for axis in range(3)] for corner in corners]
    x = [p[i] - d[i] / d[k] * p[k] for p in moved]
    y = [p[j] - d[j] / d[k] * p[k] for p in moved]
    weights = [x[2] * y[1] - y[2] * x[1], x[0] * y[2] - y[0] * x[2], x[1] * y[0] - y[1] * x[0]]
    size = max(abs(value) for value in (*x, *y))
    reach = max(abs(value) for p in moved for value in p)
    margin = EDGE_MARGIN * size * reach
    if not (all(w > margin for w in weights) or all(w < -margin for w in weights)):
        return None
    z = [p[k] / d[k] for p in moved]
    t = sum(w * depth for w, depth in zip(weights, z, strict=True)) / sum(weights)
    if min(z) <= 0 and _edge_on(x, y, [abs(p[k]) for p in moved]):
        return None
    slack = slack_of(float(t), float(max(z) - min(z)), float(reach), float(size))
    return Meeting(float(t), slack) if float(t) > slack else None


def _edge_on(x: list[Fraction], y: list[Fraction], depth: list[Fraction]) -> bool:
    """Whether a ray from beside the triangle lies in its plane, as far as float32 coordinates tell.

    triangle.py takes such a ray (EDGE_ON, 2^-28; twice that here) to meet the edges only, and the first of them may be
    behind it: it leaves by another, and no float tells where in between it went through.
    """
    det = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    size = sum(abs(value) for value in (*x, *y))
    return abs(det) < Fraction(1, 2**27) * size * (size + sum(depth))


def slack_of(t: float, depth: float, reach: float, size: float) -> float:
    """How far a computed t may be from the true one.

    Rounding to float32 and the clamp to a box are worth a few 2^-24 of t. Weights are known to 2^-22, or else the point
    is where the ray crosses an edge, known to 6 * 2^-53 reach of the projected size; each moves t by as much of the
    triangle's depth along the ray. What a ray crosses first is never further than where it meets the inside.
    """
    crossing = 2.0**-48 * reach / size if size > 0 else 1.0
    return 2.0**-21 * abs(t) + depth * min(1.0, 2.0**-19 + crossing)


def first_sure_meeting(triangles: Array, origin: Array, direction: Array) -> tuple[int, Meeting] | None:
    """The triangle that the ray surely meets first, by t plus slack; None if there is none."""
    found = [(row, sure_meeting(triangle, origin, direction)) for row, triangle in enumerate(triangles)]
    sure = [(row, meeting) for row, meeting in found if meeting is not None]
    return min(sure, key=lambda entry: entry[1].t + entry[1].slack, default=None)


def off_the_ray(triangle: Array, origin: Array, direction: Array, t: float, u: float, v: float) -> float:
    """How far the point of a triangle with weights (u, v) is from the ray's point at t; exact, then rounded."""
    a, b, c = ([Fraction(float(x)) for x in corner] for corner in triangle)
    weight_b, weight_c, place = Fraction(float(u)), Fraction(float(v)), Fraction(float(t))
    gaps = [
        a[axis]
        + weight_b * (b[axis] - a[axis])
        + weight_c * (c[axis] - a[axis])
        - (Fraction(float(origin[axis])) + place * Fraction(float(direction[axis])))
        for axis in range(3)
    ]
    return float(np.sqrt(float(sum(gap * gap for gap in gaps))))
