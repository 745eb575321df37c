"""Caustic photons steered: towards what makes caustics, where hardly one of those that are aimed does.

A path of the caustic pass is of use if it stores a photon. Where glossy surfaces are all around, aiming at them is no
help: of sunlight that comes by a window's blinds one path in a thousand meets a chair's leg of chrome. A tree over the
numbers that paths set out by learns which do (cluster.plan.steering.tree).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wdpm.cluster.plan.photon_pilot import PhotonPilot, flown_photons, in_world
from wdpm.cluster.plan.steering.numbers import start_numbers
from wdpm.cluster.plan.steering.tree import Array, Known
from wdpm.cluster.world import MapPlan, World
from wdpm.kernels.maths.random import PURPOSE_CAUSTIC
from wdpm.kernels.photons.deposits import CAUSTIC_MAP
from wdpm.kernels.photons.flight import BOUNCE_BITS

LEAST_STORED = 8
"""Photons of the pilot, fewer of which tell nothing."""

FEW = 0.1
"""Part of the paths that store a photon, from which on nearly all are of use."""

ROUNDS = 6
"""At most, of as many paths as the pilot has."""

SAMPLES_A_PATH = 2
"""Camera samples of a pass for each path that the rounds take. With fewer the caustic pass itself has hardly more paths
than they: of a room with 0.1 % of such paths, one to eight samples a pixel had the same error for 0.86 to 0.92 of the
time without."""

WORTH = 0.5
"""Second moment of what paths store that a tree must leave, of that unsteered. What comes in vain is no noise in a map
of nearest photons, but for every photon that does not, a thousand paths come in vain."""

ENOUGH = 1 << 11
"""Paths of use that tell a tree well enough."""

TELLING = 64
"""Paths of use after which a tree leaves less than PROMISES of the second moment, or is given up."""

PROMISES = 0.8


def steered_caustics(world: World, pilot: PhotonPilot, samples: int) -> Known:
    """What rounds of paths teach, each steered by what those before have taught; nothing where that does not pay.

    Args:
        world: in which photons are shared out among lights as they are to be.
        samples: that a pass takes of the camera.
    """
    stored = len(pilot.photons[CAUSTIC_MAP]["id"])
    known = Known()
    if samples < SAMPLES_A_PATH * ROUNDS * pilot.paths or not LEAST_STORED <= stored <= FEW * pilot.paths:
        return known
    for number in range(ROUNDS):
        # By other random numbers than those of the render, whose photons are not to know what they have taught.
        seed = (world.seed + 1 + number) % (1 << 32)
        emission = replace(world.emission, caustic_steering=known.tree)
        numbers, use = _flown(replace(world, emission=emission, seed=seed), pilot, pilot.paths)
        known.add(known.tree, numbers, use)
        known.learn(1.0)
        if known.of_use >= ENOUGH or (known.of_use >= TELLING and known.left > PROMISES):
            break
    return known if known.left <= WORTH else Known()


def _flown(world: World, pilot: PhotonPilot, count: int) -> tuple[Array, Array]:
    """Some paths of the caustic pass in a world: by which numbers they set out, and what flux each stores."""
    alone = replace(world, global_map=MapPlan(0), caustic_map=MapPlan(count), volume_map=MapPlan(0))
    with in_world(alone, pilot) as worker:
        photons = flown_photons(worker)[CAUSTIC_MAP]
    path = photons["id"] >> BOUNCE_BITS
    flux = np.bincount(path, photons["flux"].mean(axis=1, dtype=np.float64), count).astype(np.float64)
    return start_numbers(pilot, world.emission.caustic_steering, world.seed, PURPOSE_CAUSTIC, count), flux
