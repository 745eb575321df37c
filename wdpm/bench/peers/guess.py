"""From a coarse grid of settings to the ones that should reach an error in the least time.

A chain is what differs in samples alone. Between a member that misses the error and the next that reaches it, error and
time are taken for powers of the number of samples.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from wdpm.bench.peers.figures import Try
from wdpm.bench.peers.grid import Family, Member
from wdpm.bench.peers.target import Target

MARGIN = 1.05
"""More samples than the guess, for its own error."""


@dataclass(frozen=True)
class Guess:
    """What should reach an error.

    Attributes:
        cpu_s: that it should take [s].
        enough_spp: samples a pixel with which it was reached.
    """

    member: Member
    cpu_s: float
    enough_spp: int


def guesses(tries: Sequence[Try], target: Target) -> Iterator[Guess]:
    """One of each chain that reaches the error."""
    chains: defaultdict[tuple[Family, int], list[Try]] = defaultdict(list)
    for each in sorted(tries, key=lambda each: each.member.spp):
        chains[each.member.family, each.member.photons].append(each)
    for chain in chains.values():
        reached = next((i for i, each in enumerate(chain) if target.reached_by(each.errors)), None)
        if reached is not None:
            yield _guess(chain[reached - 1] if reached else None, chain[reached], target)


def _guess(misses: Try | None, reaches: Try, target: Target) -> Guess:
    enough = reaches.member.spp
    if misses is None:
        return Guess(reaches.member, reaches.cost.cpu_s, enough)
    missed, least = target.error_in(misses.errors), max(target.error_in(reaches.errors), 1e-300)
    share = math.log(missed / max(target.error, 1e-300)) / math.log(missed / least)
    spp = math.ceil(MARGIN * _between(misses.member.spp, enough, share))
    if spp >= enough:
        return Guess(reaches.member, reaches.cost.cpu_s, enough)
    cpu_s = _between(misses.cost.cpu_s, reaches.cost.cpu_s, share)
    return Guess(replace(reaches.member, spp=spp), cpu_s, enough)


def _between(low: float, high: float, share: float) -> float:
    """Geometrically."""
    return low * (high / low) ** share
