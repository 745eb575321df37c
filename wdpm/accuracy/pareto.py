"""The Pareto front: of all points, those that no other beats in both time and error."""

from __future__ import annotations

from collections.abc import Sequence


def pareto_front(costs: Sequence[tuple[float, float]]) -> tuple[int, ...]:
    """Indices of the points that are not dominated, in order of time.

    A point is dominated by one that is no worse in both and better in one. Of points that are alike in both, the first
    is kept.

    Args:
        costs: (time, error) of each point, without NaN.
    """
    front: list[int] = []
    for index in sorted(range(len(costs)), key=lambda each: (costs[each], each)):
        if not front or costs[index][1] < costs[front[-1]][1]:
            front.append(index)
    return tuple(front)
