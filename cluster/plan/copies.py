"""How many slaves share one copy of the scene: those with room for all of it hold all of it.

A ray that leaves a slave costs far more than one that stays, so a scene is cut only where nobody has room for it whole.
Then as many slaves as need be make a team that holds it (master.teams), and every further team is a further copy.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from wdpm.scenes.errors import SettingsError


class Copies(Enum):
    """Whether slaves hold copies of what others hold."""

    NONE = "none"
    """All slaves are one team: the scene is cut into as many parts as there are slaves."""
    AUTO = "auto"
    """As many copies of the whole scene as memory has room for."""


SHARE_OF_MEMORY = 0.5
"""Of a machine's memory that its slaves may fill with the scene, its photons and copies of them."""

PROCESS_BYTES = 600 << 20
"""What a slave has in memory before it holds anything: the interpreter, Warp, compiled kernels, batches in flight."""

TRIANGLE_BYTES = 450
"""Corners, normals, texture coordinates, the tree over them, and what comes over the wire while it is built."""

PHOTON_BYTES = 550
"""A stored photon while maps are built of it: as it was stored, sorted, and in the tree."""


@dataclass(frozen=True)
class SlaveMemory:
    """What a slave says of its machine.

    Attributes:
        host: name of the machine, which several slaves may share.
        bytes: memory of the machine ...
        own: ... or what the slave may use of it, if somebody said so; 0 otherwise.
    """

    host: str
    bytes: int
    own: int = 0


def scene_bytes(triangles: int, photons: float) -> float:
    """Memory that the whole scene takes in one process [bytes]: an estimate from above."""
    return triangles * TRIANGLE_BYTES + photons * PHOTON_BYTES


def room_of(slaves: Sequence[SlaveMemory]) -> float:
    """What each slave has room for, besides its process: that of the slave that has least [bytes]."""
    neighbours = Counter(slave.host for slave in slaves)
    return min(
        (slave.own or SHARE_OF_MEMORY * slave.bytes / neighbours[slave.host]) - PROCESS_BYTES for slave in slaves
    )


def slaves_a_team(copies: Copies, slaves: Sequence[SlaveMemory], needed: float) -> int:
    """How many slaves it takes to hold the whole scene.

    Args:
        needed: memory of the whole scene in one process [bytes].

    Raises:
        SettingsError: all slaves together have not room for it.
    """
    if not slaves:
        return 1
    room = room_of(slaves)
    if needed > max(room, 0.0) * len(slaves):
        each = max(room, 0.0) / 2**30
        raise SettingsError(
            f"the scene and its photons take about {needed / 2**30:.1f} GiB; {len(slaves)} slaves have room for "
            f"{each:.1f} GiB each ({SHARE_OF_MEMORY:.0%} of their memory, less that of the process): use more slaves, "
            "fewer photons, or give them more --memory"
        )
    if copies is Copies.NONE:
        return len(slaves)
    return next(count for count in range(1, len(slaves) + 1) if needed <= room * count)


def largest_team(slaves: int, least: int) -> int:
    """Slaves of the largest team, where so many slaves make as many teams of at least so many as can be."""
    teams = max(1, slaves // least)
    return -(-max(slaves, 1) // teams)
