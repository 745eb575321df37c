"""What shadow rays know of the lights before they set out: which light, and which part of the sky, reaches where.

In a room that the sky lights through its windows nearly all shadow rays to the sky end at a wall, and in one of several
rooms most of those to the lamps of the others. So places are looked for that camera paths come to, and from each some
rays to the lights (guide_pilot). Regions of space, the leaves of a kd-tree over the places, learn from their own rays,
and where those are few from those about them (guide_tiles, guide_starts).

Guiding is off where it does not pay. Its tables travel as part of the View.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wdpm.cluster.guide import NO_GUIDE, LightGuide
from wdpm.cluster.plan.guide_pilot import GuidePilot
from wdpm.cluster.plan.guide_starts import TRIED_FIRST, learn_starts, sky_share
from wdpm.cluster.plan.guide_tiles import PLACES_A_REGION, learn_tiles
from wdpm.cluster.work.cell import Cell
from wdpm.cluster.world import View
from wdpm.scenes.flat.flatten import FlatScene


@dataclass(frozen=True, eq=False)
class Learnt:
    """A guide, and what it is expected to bring.

    Attributes:
        guide: NO_GUIDE where it would not pay, or nothing was to be learnt.
        sky: second moment of direct light with tiles of the environment over that without; 1 where none were tried.
        lamps: the same of the choice among lights.
    """

    guide: LightGuide
    sky: float = 1.0
    lamps: float = 1.0

    @property
    def words(self) -> tuple[str, ...]:
        """What was chosen, for people; nothing where there was no choice."""
        regions = f"in {len(self.guide)} regions"
        found = (
            ("parts of the sky", self.sky, self.guide.chance.size),
            ("lights", self.lamps, self.guide.starts.size),
        )
        return tuple(
            f"shadow rays guided among {what} {regions}, which leaves {left:.2f} of their second moment"
            if on
            else f"shadow rays not guided among {what}, which would leave {left:.2f} of their second moment"
            for what, left, on in found
            if on or left < 1.0
        )


NOTHING_LEARNT = Learnt(NO_GUIDE)


def learn_guide(flat: FlatScene, cell: Cell, view: View, spp: int) -> Learnt:
    """Fly the pilot, and learn from it.

    Args:
        cell: the whole scene.
        view: as the replica of the cell has it; its guide is not looked at.
        spp: samples a pixel of a pass.
    """
    lights = cell.replica.lights
    sky = flat.lights.environment_pixels.size > 0 and bool(flat.lights.power[-1] > 0)
    several = lights.tree.head_count + lights.count - lights.first_distant > 1
    if not (sky or several) or not flat.triangles.total or (view.max_depth is not None and view.max_depth < 2):
        return NOTHING_LEARNT
    pilot = GuidePilot(flat, cell, view, spp)
    if len(pilot.position) < 2 * PLACES_A_REGION:
        return NOTHING_LEARNT
    if not several:
        return Learnt(*learn_tiles(pilot, 1.0))
    first = pilot.look_at_lights(TRIED_FIRST)
    tiles, by_tiles = learn_tiles(pilot, sky_share(first)) if sky else (NO_GUIDE, 1.0)
    power = flat.lights.power[lights.first_distant :]
    distant = power / power.sum() if power.sum() > 0 else np.zeros(len(power))
    known, by_lights = learn_starts(pilot, first, distant, tiles)
    return Learnt(known, by_tiles, by_lights)


def with_guide(view: View, learnt: Learnt) -> View:
    """The view, guided."""
    return replace(view, guide=learnt.guide)
