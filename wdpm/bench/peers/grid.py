"""The settings that `wdpm bench peers` tries: the same for every scene, so that none is tuned to one.

A family is a way to find indirect light; its members differ in how much work they put in. More work of the same kind
takes longer, so a member that only adds work to one that was too slow already is not tried.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings


@dataclass(frozen=True)
class Family:
    """Settings that differ in work alone.

    Attributes:
        name: for people.
        photons: to be stored in each map, of each pass; 0 where that is not said.
        spp: samples a pixel.
        passes, indirect, integrator: what all members have, see RenderSettings.
        is_plain: whether all but the samples is left to wdpm.
    """

    name: str
    photons: tuple[int, ...]
    spp: tuple[int, ...]
    passes: int = 1
    indirect: Indirect = Indirect.MAP
    integrator: Integrator = Integrator.PHOTONS
    is_plain: bool = False

    def members(self) -> Iterator[Member]:
        """All of them, each after those with less work."""
        for spp in self.spp:
            for photons in self.photons:
                yield Member(self, photons, spp)


@dataclass(frozen=True)
class Member:
    """One choice of settings."""

    family: Family
    photons: int
    spp: int

    @property
    def name(self) -> str:
        """For people."""
        photons = f", {self.photons // 1000}k photons" if self.photons else ""
        return f"{self.family.name}, {self.spp} samples{photons}"

    def settings(self, seed: int, max_depth: int | None) -> RenderSettings:
        """For a render; the maps of caustics and media get as many photons as the global one."""
        if self.family.is_plain:
            return RenderSettings(spp=self.spp, seed=seed, max_depth=max_depth)
        return RenderSettings(
            photons=self.photons,
            caustic_photons=self.photons,
            volume_photons=self.photons,
            spp=self.spp,
            passes=self.family.passes,
            indirect=self.family.indirect,
            integrator=self.family.integrator,
            seed=seed,
            max_depth=max_depth,
        )

    def adds_to(self, other: Member) -> bool:
        """Whether this is the other, with more work or as much."""
        return self.family == other.family and self.photons >= other.photons and self.spp >= other.spp


PATH = Family("path", (0,), (8, 32, 128), integrator=Integrator.PATH)

FEW_PATHS = Family(PATH.name, (0,), (4, 16), integrator=Integrator.PATH)
"""Beyond these samples a path tracer's error follows a law (law.py), which spares the minutes that they would take."""

DEFAULTS = Family(
    "defaults",
    (0,),
    tuple(1 << power for power in range(11)),
    indirect=Indirect.AUTO,
    integrator=Integrator.AUTO,
    is_plain=True,
)
"""What a person gets who says no more than how many samples."""

MAPS = (
    Family("map", (20_000, 100_000, 500_000), (2, 8, 32)),
    Family("map in 8 passes", (20_000, 100_000), (8, 32, 128), passes=8),
)
GATHER = Family("gather", (20_000, 100_000), (2, 8, 32, 128), indirect=Indirect.GATHER)
CACHE = Family("cache", (20_000, 100_000), (2, 8, 32, 128), indirect=Indirect.CACHE)
FAMILIES = (*MAPS, GATHER, CACHE, PATH)


@dataclass(frozen=True)
class Way:
    """How wdpm may get to an error: by the fastest member of some families.

    Attributes:
        name: on the command line, and in the table.
    """

    name: str
    families: tuple[Family, ...]


WAYS = (
    Way("grid", FAMILIES),
    Way("defaults", (DEFAULTS,)),
    Way("path", (FEW_PATHS,)),
    Way("map", MAPS),
    Way("gather", (GATHER,)),
    Way("cache", (CACHE,)),
)
DEFAULT_WAYS = WAYS[:3]
