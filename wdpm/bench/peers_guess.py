"""From a coarse grid of settings to the ones that should reach an error in the least time.

A chain is what differs in samples alone. Between a member that misses the error and the next that reaches it, error and
time are taken for powers of the number of samples.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from wdpm.bench.peers_figures import Try
from wdpm.bench.peers_grid import Family, Member

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


def guesses(tries: Sequence[Try], bound: float) -> Iterator[Guess]:
    """One of each chain that reaches the bound."""
    chains: defaultdict[tuple[Family, int], list[Try]] = defaultdict(list)
    for each in sorted(tries, key=lambda each: each.member.spp):
        chains[each.member.family, each.member.photons].append(each)
    for chain in chains.values():
        reached = next((i for i, each in enumerate(chain) if each.error <= bound), None)
        if reached is not None:
            yield _guess(chain[reached - 1] if reached else None, chain[reached], bound)


def _guess(misses: Try | None, reaches: Try, bound: float) -> Guess:
    enough = reaches.member.spp
    if misses is None:
        return Guess(reaches.member, reaches.cost.cpu_s, enough)
    share = math.log(misses.error / bound) / math.log(misses.error / max(reaches.error, 1e-300))
    spp = math.ceil(MARGIN * _between(misses.member.spp, enough, share))
    if spp >= enough:
        return Guess(reaches.member, reaches.cost.cpu_s, enough)
    cpu_s = _between(misses.cost.cpu_s, reaches.cost.cpu_s, share)
    return Guess(replace(reaches.member, spp=spp), cpu_s, enough)


def _between(low: float, high: float, share: float) -> float:
    """Geometrically."""
    return low * (high / low) ** share
