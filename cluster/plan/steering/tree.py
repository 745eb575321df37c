"""A tree that learns where in the cube of a path's first numbers the paths lie that are of use.

With paths of density p, the second moment of their use f is the integral of f² / p, which is least for p in proportion
to sqrt(f²). A tree knows the mean of f² in each of its leaves; it is halved along the axis where that helps most, as
long as several paths of use tell, and what few paths tell is drawn towards what more of them tell above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.world import NO_STEERING, START_NUMBERS, STEERING_LEVELS, Steering

Array = NDArray[np.float64]

SLABS = 8
"""Of a node along each axis: it is cut between two of them."""

LEAST_PATHS = 8.0
"""Paths of use, by their effective number, that a node is halved for."""

PRIOR = 4.0
"""Paths of use that an even share of both halves is worth."""

LEAST_GAIN = 0.02
"""Of the root of a node's second moment, what halving it must save."""

UNSTEERED = 0.2
"""Part of the photons that is spread evenly: none carries more than five times the flux that it would unsteered."""


@dataclass(frozen=True, eq=False)
class Sample:
    """What the paths of use, among some, tell.

    Attributes:
        numbers: that they set out by, shape [paths, START_NUMBERS].
        square: of the use of each, had it set out unsteered, over the density of such paths, shape [paths].
    """

    numbers: Array
    square: Array

    def half(self, chosen: NDArray[np.bool_]) -> Sample:
        """Those among half of the paths, which stand for all."""
        return Sample(self.numbers[chosen], 2.0 * self.square[chosen])

    def moment(self, steering: Steering) -> float:
        """Second moment of their use, were they steered so."""
        return float((self.square * weights(steering, self.numbers)).sum())


@dataclass(frozen=True, eq=False)
class _Round:
    """Paths that a tree has steered: how many, and of those that are of use number in the round, numbers and square."""

    tree: Steering
    paths: int
    which: NDArray[np.intp]
    numbers: Array
    square: Array


class Known:
    """What rounds of paths have taught, the later ones steered by the earlier.

    Attributes:
        tree: that they have taught.
        left: second moment that it leaves, of that unsteered.
    """

    def __init__(self) -> None:
        self.tree, self.left = NO_STEERING, 1.0
        self._rounds: list[_Round] = []

    @property
    def of_use(self) -> int:
        """How many paths were."""
        return sum(len(each.which) for each in self._rounds)

    def add(self, tree: Steering, numbers: Array, use: Array) -> None:
        """Know a round of paths that a tree has steered, and of what use each was."""
        which = np.flatnonzero(use > 0)
        square = (use[which] / weights(tree, numbers[which])) ** 2
        self._rounds.append(_Round(tree, len(use), which, numbers[which], square))

    def share_of_use(self) -> float:
        """Part of the paths, all of the same use, that would do as well."""
        square, paths = self._sample().square, sum(each.paths for each in self._rounds)
        whole = float(square.sum()) / paths
        return (float(np.sqrt(square).sum()) / paths) ** 2 / whole if whole > 0 else 1.0

    def learn(self, least: float) -> bool:
        """Learn a tree from all that is known, if what it leaves is no more than a part of what the present one does.

        Half of the paths teach a tree, which the others judge.
        """
        sample = self._sample()
        tree = learn(sample)
        even = np.concatenate([each.which for each in self._rounds]) % 2 == 0
        judges, taught = sample.half(~even), learn(sample.half(even))
        before, left, plain = (judges.moment(tree) for tree in (self.tree, taught, NO_STEERING))
        if not len(taught) or not len(tree) or not plain or left > least * before:  # no judge may be of use
            return False
        self.tree, self.left = tree, left / plain
        return True

    def _sample(self) -> Sample:
        """All paths of use, of the density that all rounds have together (the balance heuristic)."""
        numbers = np.concatenate([each.numbers for each in self._rounds])
        density = np.zeros(len(numbers))
        for each in self._rounds:
            density += each.paths / weights(each.tree, numbers)
        return Sample(numbers, np.concatenate([each.square for each in self._rounds]) / density)


def learn(sample: Sample) -> Steering:
    """The tree of a sample; NO_STEERING where it tells nothing."""
    grown = _grow(sample)
    if len(grown.axis) < 2:
        return NO_STEERING
    axis, lower, split = np.array(grown.axis, np.int32), np.array(grown.lower, np.int32), np.array(grown.split)
    volume, square = np.array(grown.volume), np.array(grown.square)
    mass = np.where(lower == 0, np.sqrt(volume * square), 0.0)
    mass = (1.0 - UNSTEERED) * mass / mass.sum() + UNSTEERED * np.where(lower == 0, volume, 0.0)
    for node in np.flatnonzero(lower)[::-1]:  # children come after their parents
        mass[node] = mass[lower[node]] + mass[lower[node] + 1]
    chance = np.full(len(axis), 0.5)
    inner = np.flatnonzero(lower)
    chance[inner] = mass[lower[inner]] / mass[inner]
    return Steering(axis, lower, split, chance)


def weights(steering: Steering, numbers: Array) -> Array:
    """Volume over chance of the leaf that each path lies in, shape [paths]."""
    weight, node, inside = np.ones(len(numbers)), np.zeros(len(numbers), np.int64), numbers.copy()
    going = np.arange(len(numbers) if len(steering) else 0)
    while len(going):
        here = node[going]
        axis, split, chance = steering.axis[here], steering.split[here], steering.chance[here]
        own = inside[going, axis]
        upper = own >= split
        inside[going, axis] = _within(own, split, upper)
        weight[going] *= np.where(upper, (1.0 - split) / (1.0 - chance), split / chance)
        node[going] = steering.lower[here] + upper
        going = going[steering.lower[node[going]] > 0]
    return weight


def _within(inside: Array, split: Array, upper: NDArray[np.bool_]) -> Array:
    """Where in its part of a node a number lies, by where it lies in the node."""
    return np.where(upper, (inside - split) / (1.0 - split), inside / split)


@dataclass
class _Grown:
    """Nodes as they are found: `square` is the sum of the squares in each, drawn towards its parent's."""

    axis: list[int]
    lower: list[int]
    split: list[float]
    volume: list[float]
    square: list[float]


def _grow(sample: Sample) -> _Grown:
    """Nodes, level by level; those of one level at once, as most have few paths."""
    grown = _Grown([0], [0], [0.5], [1.0], [float(sample.square.sum())])
    useful = np.flatnonzero(sample.square > 0)
    inside, square = sample.numbers[useful].copy(), sample.square[useful]
    place = np.zeros(len(useful), np.int64)  # among the nodes of the level
    first, count = 0, 1
    for _ in range(STEERING_LEVELS):
        effective = _effective(place, square, count)
        axis, cut, above = _best_cuts(inside, place, square, effective)
        halved = cut > 0
        if not halved.any():
            break
        child = np.cumsum(halved) - 1
        for number in np.flatnonzero(halved):
            node, low, share = first + int(number), float(cut[number]), float(above[number])
            grown.axis[node], grown.lower[node], grown.split[node] = int(axis[number]), len(grown.axis), low
            grown.axis += [0, 0]
            grown.lower += [0, 0]
            grown.split += [0.5, 0.5]
            grown.volume += [grown.volume[node] * low, grown.volume[node] * (1.0 - low)]
            grown.square += [grown.square[node] * (1.0 - share), grown.square[node] * share]
        kept = halved[place]
        inside, square, place = inside[kept], square[kept], place[kept]
        along, rows = axis[place], np.arange(len(place))
        own = inside[rows, along]
        upper = own >= cut[place]
        inside[rows, along] = _within(own, cut[place], upper)
        place = 2 * child[place] + upper
        first, count = first + len(halved), 2 * int(halved.sum())
    return grown


def _best_cuts(
    inside: Array, place: NDArray[np.int64], square: Array, effective: Array
) -> tuple[NDArray[np.int64], Array, Array]:
    """Of each node: the axis and the place of the cut that helps most, 0 where none is worth it, and the share of the
    squares above it, drawn towards that of the volume.

    Args:
        inside: where in its node each path lies, shape [paths, START_NUMBERS].
        place: the node of each.
        effective: paths that each node has, shape [nodes].
    """
    count, cuts = len(effective), np.arange(1, SLABS) / SLABS
    above = np.empty((START_NUMBERS, count, SLABS - 1))
    for axis in range(START_NUMBERS):
        slab = np.minimum((inside[:, axis] * SLABS).astype(np.int64), SLABS - 1)
        table = np.bincount(place * SLABS + slab, square, count * SLABS).reshape(count, SLABS)
        summed = table.cumsum(axis=1)
        whole = summed[:, -1:]
        beyond = np.divide(whole - summed[:, :-1], whole, out=np.repeat(1.0 - cuts[None], count, 0), where=whole > 0)
        known = effective[:, None]
        above[axis] = np.clip((beyond * known + (1.0 - cuts) * PRIOR) / (known + PRIOR), 0.0, 1.0)
    root = np.sqrt(above * (1.0 - cuts)) + np.sqrt((1.0 - above) * cuts)  # of both parts, over that of the whole
    flat = root.transpose(1, 0, 2).reshape(count, -1)
    best, nodes = flat.argmin(axis=1), np.arange(count)
    worth = (effective >= LEAST_PATHS) & (flat[nodes, best] <= 1.0 - LEAST_GAIN)
    axis, slab = np.divmod(best, SLABS - 1)
    return axis, np.where(worth, cuts[slab], 0.0), above[axis, nodes, slab]


def _effective(place: NDArray[np.int64], square: Array, count: int) -> Array:
    """How many paths of use there are in each of some nodes, were all of the same."""
    whole, used = np.bincount(place, square, count), np.bincount(place, np.sqrt(square), count)
    return np.divide(used**2, whole, out=np.zeros(count), where=whole > 0)
