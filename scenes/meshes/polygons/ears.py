"""One polygon cut into ears: triangles of three corners in a row that hold no other corner (Meisters 1975)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

_MOST_CORNERS: Final = 20_000
"""Corners beyond which a polygon stays a fan: time goes with their square."""


def cut_ears(places: NDArray[np.float64]) -> NDArray[np.int64] | None:
    """Triangles that cover a polygon, simple or with holes that bridges lead to.

    Args:
        places: its corners in order, nearly in a plane, shape [N, 3].

    Returns:
        Numbers of corners, shape [N - 2, 3], each triangle as the polygon goes round; None where there is no such cut,
        as where edges cross, or too many corners to look for one.
    """
    if len(places) > _MOST_CORNERS:
        return None
    flat = _flattened(places)
    left = list(range(len(places)))
    found: list[tuple[int, int, int]] = []
    at = 0
    while len(left) > 3:
        ear = _next_ear(flat, left, at)
        if ear is None:
            return None
        found.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
        # the next is looked for beyond, so that no corner has all the triangles
        at = ear % len(left)
    found.append((left[0], left[1], left[2]))
    return np.array(found, np.int64)


def _flattened(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """The corners as seen from the polygon's front, counter-clockwise on the whole, shape [N, 2]."""
    moved = places - places[0]
    normal = np.cross(moved[1:-1], moved[2:]).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat = moved[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return flat if normal[axis] > 0.0 else flat[:, ::-1]


def _next_ear(flat: NDArray[np.float64], left: list[int], start: int) -> int | None:
    """Where in `left` the first ear from `start` on is.

    Corners on its outline make it none: only where there is no other may one touch, as where a bridge to a hole ends.
    """
    numbers = np.array(left)
    here, before, behind = flat[numbers], flat[np.roll(numbers, 1)], flat[np.roll(numbers, -1)]
    turn = _turn(before, here, behind)
    convex = np.flatnonzero(np.roll(turn > 0.0, -start))
    others = here[turn <= 0.0]  # a corner within an ear that turns left has one that does not, too
    order = ((convex + start) % len(left)).tolist()
    for touching in (False, True):
        for number in order:
            a, b, c = before[number], here[number], behind[number]
            sides = np.stack([_turn(a, b, others), _turn(b, c, others), _turn(c, a, others)])
            own = (others == a).all(axis=1) | (others == b).all(axis=1) | (others == c).all(axis=1)
            within = (sides > 0.0).all(axis=0) if touching else (sides >= 0.0).all(axis=0)
            if not (within & ~own).any():
                return int(number)
    return None


def _turn(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> NDArray[np.float64]:
    """Twice the area of triangles, above zero where they go counter-clockwise; of points of shape [..., 2]."""
    first, second = b - a, c - a
    turn: NDArray[np.float64] = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    return turn
