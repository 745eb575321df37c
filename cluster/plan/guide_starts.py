"""What rays to lights teach: of each region of space, by which factor what a light promises counts there.

The light tree (kernels.lights.tree) knows what a light would send to a place if nothing stood in between. With a share
m of cosine² arriving of a choice, a factor of sqrt(m) has the least variance, as for tiles of the environment
(guide_tiles).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.guide import NO_GUIDE, LightGuide
from wdpm.cluster.plan.guide_pilot import Array, GuidePilot, LightLooks
from wdpm.cluster.plan.guide_tiles import PLACES_A_REGION, UNGUIDED, WORTH, ratio_of
from wdpm.cluster.plan.regions import Regions, divide

PRIOR = 8.0
"""Places that what arrives in the neighbourhood is worth beside those of a region."""

TRIED_FIRST = 4
"""Every so many-th place tells first whether guiding may pay."""


def sky_share(looks: LightLooks) -> float:
    """Share of the environment, the last choice, in the second moment of all light; 1 where nothing arrives.

    Places count by the share of theirs: a patch of sun says nothing of what is about it, which the sky alone lights.
    """
    moments = looks.chance * looks.square
    return 1.0 - ratio_of(moments[:, :-1].sum(axis=1), moments.sum(axis=1)) if moments.any() else 1.0


def learn_starts(pilot: GuidePilot, first: LightLooks, distant: Array, tiles: LightGuide) -> tuple[LightGuide, float]:
    """A guide with tiles, if any, and lights; and the second moment that the lights leave of that without.

    Args:
        first: rays from every TRIED_FIRST-th place.
        distant: share of each light infinitely far away among these, without a guide.
        tiles: a guide with tiles alone, or NO_GUIDE. It is given back where lights are not worth guiding to.
    """
    moment = _tried(pilot.position[::TRIED_FIRST], first)
    if not moment <= WORTH:
        return tiles, moment
    looks = pilot.look_at_lights()
    moment = _tried(pilot.position, looks)
    if not moment <= WORTH:
        return tiles, moment
    regions = divide(pilot.position, PLACES_A_REGION)
    factor = _factors(regions, looks.square)
    starts, shares = factor[:, : looks.heads], np.zeros((len(factor), 0))
    if len(distant):
        promised = distant * factor[:, looks.heads :]
        whole = promised.sum(axis=1, keepdims=True)
        starts, shares = np.hstack([starts, whole]), promised / whole
    known = tiles
    if not len(tiles):
        none = np.zeros((len(factor), 0, 0), np.float32)
        known = replace(NO_GUIDE, axis=regions.axis, split=regions.split, chance=none)
    return replace(known, starts=starts.astype(np.float32), distant=shares.astype(np.float32)), moment


def _tried(places: NDArray[np.float32], looks: LightLooks) -> float:
    """Second moment that what every other place teaches leaves at the rest of that without a guide."""
    teaches = np.arange(len(places)) % 2 == 0
    regions = divide(places[teaches], PLACES_A_REGION)
    region = regions.of(places[~teaches])
    return _moment(_factors(regions, looks.square[teaches])[region], looks, ~teaches)


def _factors(regions: Regions, square: Array) -> Array:
    """Factor of each choice in each region, shape [regions, choices]: at most 1, at least UNGUIDED."""
    mean = square.mean(axis=0)[None]
    for level, node in enumerate(regions.nodes):
        nodes = 1 << level
        count = np.bincount(node, minlength=nodes)[:, None]
        total = np.stack([np.bincount(node, choice, nodes) for choice in square.T], axis=1)
        above = np.repeat(mean, 2, axis=0) if level else mean
        mean = (total + PRIOR * above) / (count + PRIOR)
    root = np.sqrt(mean)
    most = root.max(axis=1, keepdims=True)
    share = np.divide(root, most, out=np.ones_like(root), where=most > 0)
    return (1.0 - UNGUIDED) * share + UNGUIDED


def _moment(factor: Array, looks: LightLooks, tries: NDArray[np.bool_]) -> float:
    """Second moment of light with factors at some places over that without; 1 where nothing arrives."""
    chance, square = looks.chance[tries], looks.square[tries]
    learnt = chance * factor
    whole = learnt.sum(axis=1, keepdims=True)
    guided_chance = np.divide(learnt, whole, out=np.zeros_like(learnt), where=whole > 0)
    terms = np.divide(chance**2 * square, guided_chance, out=np.zeros_like(learnt), where=guided_chance > 0)
    return ratio_of(terms.sum(axis=1), (chance * square).sum(axis=1))
