"""What rays to the environment teach: of each region of space, with which probability a tile is worth looking at.

With a share m of cosine² arriving from a tile that is chosen with probability p without a guide, p sqrt(m) has the
least variance (Rath et al. 2020, "Variance-Aware Path Guiding"). A part UNGUIDED goes on as without a guide: so
everything is still found, and bounds what one wrong guess may cost ("defensive" sampling, Hesterberg 1995).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.guide import NO_GUIDE, LightGuide
from wdpm.cluster.plan.guide_pilot import Array, GuidePilot, Looks, factors
from wdpm.cluster.plan.regions import Regions, divide

ROUNDS = 3
"""Rays of the first go as without a guide, later ones as those before have taught: through a small window a few of the
first find the sky, and most of the last. Where the first promise nothing no others follow."""

PLACES_A_REGION = 64
"""Least places of a region: with fewer, its rays teach less than the neighbourhood's."""

PRIOR = 8.0
"""Rays that the counts of the neighbourhood are worth beside those of a region's own. (Of 1 to 32.)"""

UNGUIDED = 0.25
"""Part of the choices that are made as without a guide."""

WORTH = 0.75
"""Second moment of direct light with a guide over that without, above which it is not worth its table."""


def learn_tiles(pilot: GuidePilot, share: float) -> tuple[LightGuide, float]:
    """A guide with tiles alone, NO_GUIDE if it does not pay, and the second moment with it over that without.

    The guide is tried on the rays of the first round, which taught it, and if it may pay then what all rounds teach at
    every other place is tried at the rest.

    Args:
        share: of the environment in the second moment of all direct light: what other lights send stays.
    """
    if not 1.0 - share <= WORTH:
        return NO_GUIDE, 1.0
    looks = pilot.look(0, NO_GUIDE)
    all_places = np.ones(len(pilot.position), np.bool_)
    moment = 1.0 - share * (1.0 - _moment(pilot, looks, all_places, all_places))
    if not moment <= WORTH:
        return NO_GUIDE, moment
    regions = divide(pilot.position, PLACES_A_REGION)
    known = _guide_of(regions, looks, pilot.mass)
    for number in range(1, ROUNDS):
        looks = looks.and_also(pilot.look(number, known))
        known = _guide_of(regions, looks, pilot.mass)
    teaches = np.arange(len(pilot.position)) % 2 == 0
    moment = 1.0 - share * (1.0 - _moment(pilot, looks, teaches, ~teaches))
    return known if moment <= WORTH else NO_GUIDE, moment


def _moment(pilot: GuidePilot, looks: Looks, teaches: NDArray[np.bool_], tries: NDArray[np.bool_]) -> float:
    """Second moment of light with what some places teach over that without, at others; 1 where nothing arrives.

    Regions count by the ratio of theirs, as relative errors do, but dark ones, which a few rays tell of, for less.
    """
    regions = divide(pilot.position[teaches], PLACES_A_REGION)
    factor = factors(_chances(regions, looks.of(teaches), pilot.mass), pilot.mass)
    rest = looks.of(tries)
    region = regions.of(pilot.position[tries])
    square = rest.square * rest.weight
    guided = np.bincount(region, (square / factor[region[:, None], rest.tile]).sum(axis=1), len(factor))
    without = np.bincount(region, square.sum(axis=1), len(factor))
    return ratio_of(guided, without)


def ratio_of(guided: NDArray[Any], without: NDArray[Any]) -> float:
    """Mean ratio of second moments of regions or places, dark ones for less; 1 where nothing arrives."""
    if not without.any():
        return 1.0
    weight = 1.0 / (without + without.mean())
    return float((weight @ guided) / (weight @ without))


def _guide_of(regions: Regions, looks: Looks, mass: Array) -> LightGuide:
    chance = _chances(regions, looks, mass).reshape(-1, *mass.shape).astype(np.float32)
    none = np.zeros((len(chance), 0), np.float32)
    return replace(NO_GUIDE, axis=regions.axis, split=regions.split, chance=chance, starts=none, distant=none)


def _chances(regions: Regions, looks: Looks, mass: Array) -> Array:
    """Probability of each tile in each region, shape [regions, tiles].

    From the root of the tree down, each node's mean is that of its own rays and of some of its parent's, and of those
    of the tiles about them: what a place sees of the sky hangs together, in directions and in space.
    """
    tiles = mass.size
    mean = np.zeros((1, tiles))
    for level, node in enumerate(regions.nodes):
        nodes = 1 << level
        key = (node[:, None] * tiles + looks.tile).reshape(-1)
        count = np.bincount(key, minlength=nodes * tiles)
        total = np.bincount(key, looks.square.reshape(-1), nodes * tiles)
        if level:
            above = np.repeat(_smoothed(mean, mass.shape), 2, axis=0)
        else:
            above = np.full((1, tiles), (looks.square * looks.weight).mean())
        mean = (total.reshape(nodes, tiles) + PRIOR * above) / (count.reshape(nodes, tiles) + PRIOR)
    learnt = mass.reshape(-1) * np.sqrt(mean)
    whole = learnt.sum(axis=1, keepdims=True)
    share = np.divide(learnt, whole, out=np.broadcast_to(mass.reshape(-1), learnt.shape).copy(), where=whole > 0)
    return (1.0 - UNGUIDED) * share + UNGUIDED * mass.reshape(-1)


def _smoothed(mean: Array, shape: tuple[int, ...]) -> Array:
    """Means of tiles, [nodes, tiles], each mixed with those of the tiles about it, by 1 : 2 : 1 along both axes."""
    grid = mean.reshape(-1, *shape)
    wide = np.pad(grid, ((0, 0), (1, 1), (0, 0)), mode="edge")
    rows = (wide[:, :-2] + 2.0 * wide[:, 1:-1] + wide[:, 2:]) / 4.0
    smooth: Array = (np.roll(rows, 1, axis=2) + 2.0 * rows + np.roll(rows, -1, axis=2)) / 4.0
    return smooth.reshape(mean.shape)
