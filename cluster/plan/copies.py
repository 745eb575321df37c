"""How many slaves share one copy of the scene: those with room for all of it hold all of it.

A ray that leaves a slave costs far more than one that stays, so a scene is cut only where nobody has room for it whole.
Then as many slaves as need be make a team that holds it (master.teams), and every further team is a further copy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from wdpm.cluster.host_memory import PROCESS_BYTES, SHARE_OF_MEMORY, SlaveMemory, rooms_of
from wdpm.kernels.limits import POINTS_A_PHOTON, POINTS_LEAST, POINTS_MOST
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.model.textures import Bitmap, Texture


class Copies(Enum):
    """Whether slaves hold copies of what others hold."""

    NONE = "none"
    """All slaves are one team: the scene is cut into as many parts as there are slaves."""
    AUTO = "auto"
    """As many copies of the whole scene as memory has room for."""


def copies_named(value: Copies | str) -> Copies:
    """A choice by its name, as on the command line; SettingsError for anything else."""
    try:
        return Copies(value)
    except ValueError:
        names = ", ".join(f'"{each.value}"' for each in Copies)
        raise SettingsError(f"copies is {value!r}; expected one of {names}") from None


AT_WORK_BYTES = 300 << 20
"""What that takes of it where kernels are compiled: 255 to 330 MiB, by the effects and textures of the scene."""

TRIANGLE_BYTES = 450
"""Corners, normals, texture coordinates, the tree over them, and what comes over the wire while it is built."""

BARE_PHOTON_BYTES = 75
"""A stored photon at its dearest: 61 as it is stored, 60 in its tree, this in between (kernels.photons.photon_map)."""

PHOTON_BYTES = 100
"""With irradiance at some of them, or with the batches that bring copies of photons from other teams."""

POINT_BYTES = 44
"""A surface point at its dearest, while its tree is built; 24 before, 28 after."""


INSTANCE_BYTES = 1000
"""A place where a shape stands: matrices there and back, a box, and its part of the tree of boxes."""

TEXEL_BYTES = 24
"""Three float32, as they came over the wire and on the device."""

VOXEL_BYTES = 9
"""One float32 likewise, and its share of a block's least and largest."""


@dataclass(frozen=True)
class SceneMemory:
    """Memory that a scene takes [bytes]: an estimate from above.

    Attributes:
        divided: triangles, instances and photons, which the slaves of a team divide among them.
        everywhere: textures and grids of media, which every slave has all of.
    """

    divided: float
    everywhere: float = 0.0


def points_of(photons: float) -> float:
    """Surface points that are spread for so many photons."""
    return min(max(POINTS_A_PHOTON * photons, POINTS_LEAST), POINTS_MOST) if photons else 0.0


def scene_memory(
    triangles: int,
    photons: float,
    textures: Sequence[Texture] = (),
    voxels: int = 0,
    instances: int = 0,
    points: float | None = None,
    photon_bytes: int = PHOTON_BYTES,
) -> SceneMemory:
    """What a scene with so many triangles and stored photons takes.

    Args:
        triangles: that are held: those of shapes once.
        instances: places where shapes stand.
        points: surface points; None for those of so many photons.
    """
    points = points_of(photons) if points is None else points
    texels = sum(each.pixels.size // 3 for each in textures if isinstance(each, Bitmap))
    divided = triangles * TRIANGLE_BYTES + instances * INSTANCE_BYTES + photons * photon_bytes + points * POINT_BYTES
    return SceneMemory(divided, texels * TEXEL_BYTES + voxels * VOXEL_BYTES)


TRAVEL = 0.3
"""What rays that travel within a team cost of a slave's time, for each time that the team has twice as many slaves: two
teams of two take 1.3 (cbox) and 1.25 (sponza) times as much as four alone, one of four 1.9, 1.6 (docs/measured.md)."""


@dataclass(frozen=True)
class Sharing:
    """Who holds a scene together.

    Attributes:
        slaves: that take part: those that have room for their share; 1 if nobody is there yet.
        team_size: of them, slaves that have room for the whole scene among them.
        room: what a slave must have room for to take part, besides its process [bytes].
    """

    slaves: int
    team_size: int
    room: float = -math.inf


def sharing(copies: Copies, slaves: Sequence[SlaveMemory], needed: SceneMemory) -> Sharing:
    """How many slaves it takes to hold the whole scene, and which have room for their part of it.

    Where some have less room than others, larger teams have a use for more of them, but send more: what gets most done
    counts.

    Raises:
        SettingsError: all slaves together have not room for it.
    """
    if not slaves:
        return Sharing(1, 1)
    rooms = sorted((max(room - needed.everywhere, 0.0) for room in rooms_of(slaves)), reverse=True)
    sizes = [size for size in range(1, len(rooms) + 1) if needed.divided <= rooms[size - 1] * size]
    if not sizes:
        textures = f", textures and grids of {_gib(needed.everywhere)} in each" if needed.everywhere else ""
        most = "" if rooms[0] == rooms[-1] else f" to {_gib(rooms[0])}"
        raise SettingsError(
            f"the scene and its photons take about {_gib(needed.divided)}{textures}; {len(slaves)} slaves have room "
            f"for {_gib(rooms[-1])}{most} each (their --memory, or {SHARE_OF_MEMORY:.0%} of what their machine has, "
            f"less {_gib(PROCESS_BYTES)} of the process{', textures and grids' if textures else ''}): use more slaves, "
            "fewer photons, or give them more --memory"
        )
    if copies is Copies.NONE:
        size = able = sizes[-1]
    else:
        ables = {size: sum(room * size >= needed.divided for room in rooms) for size in sizes}
        size = max(sizes, key=lambda size: (ables[size] / (1.0 + TRAVEL * math.log2(size)), -size))
        able = ables[size]
    return Sharing(able, size, needed.divided / size + needed.everywhere)


def _gib(size: float) -> str:
    return f"{size / 2**30:.1f} GiB"


def largest_team(slaves: int, team_size: int) -> int:
    """Slaves of the largest team, where so many slaves make as many teams of at least so many as can be."""
    teams = max(1, slaves // team_size)
    return -(-max(slaves, 1) // teams)
