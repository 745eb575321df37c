"""How photons are shared out among lights.

In proportion to power, all photons of a map carry much the same flux. But power is not use: a lamp in the next room
stores nothing here, a weak one behind a lens may make the only caustic, and one in a closed room all the light there.
So the pilot shoots part of its paths in equal shares for each light, and measures what each brings into each map; the
final shares are mostly in proportion to that, with a rest that keeps every light that shines in the game (and the
estimate unbiased).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.world import Emission, World
from wdpm.kernels.lights.target_clusters import cluster_targets
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.light_table import LightTable
from wdpm.scenes.flat.material_facts import facts
from wdpm.scenes.flat.whole import positions_of

MEASURED = 0.9
"""Part of the photons that is shared out by measured use."""

EVEN = 0.5
"""Part of the pilot's paths that is shared out evenly among the lights."""


def pilot_emission(flat: FlatScene, *, aimed: bool, known: Emission | None = None) -> Emission:
    """The pilot's shares: half evenly, half by power.

    Args:
        aimed: whether photons of the caustic pass are.
        known: another emission of the scene. If that is aimed, it knows at what: finding that takes some hundredths of
            a second.
    """
    lights = flat.lights
    power = _normalised(lights.power)
    even = _by_light(lights, (np.bincount(lights.light, lights.power, len(lights.names)) > 0).astype(np.float64))
    center, radius = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
    if aimed and known is not None and len(known.target_radius):
        center, radius = known.target_center, known.target_radius
    elif aimed:
        shiny = np.array([fact.glossy for fact in facts(flat.materials, flat.textures)], np.bool_)
        center, radius = cluster_targets(positions_of(flat.triangles, shiny))
    share = _normalised(EVEN * even + (1.0 - EVEN) * power)
    return Emission(share, share, center, radius)


def measured_emission(world: World, flux: NDArray[np.float64]) -> Emission:
    """The final shares.

    Args:
        flux: what the pilot's photons of each light brought into each map, shape [maps, lights].
    """
    pilot = world.emission
    return Emission(
        _measured(world.lights, pilot.share, flux[GLOBAL_MAP]),
        _measured(world.lights, pilot.caustic_share, flux[CAUSTIC_MAP]),
        pilot.target_center,
        pilot.target_radius,
    )


def _measured(lights: LightTable, pilot: NDArray[np.float64], flux: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mostly by the flux that each light stored; as in the pilot for a single light, or where nothing was stored."""
    if len(flux) < 2 or flux.sum() <= 0:
        return pilot
    return _normalised(MEASURED * _by_light(lights, flux) + (1.0 - MEASURED) * pilot)


def _by_light(lights: LightTable, weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shares of the elements from weights of the lights: within a light, by power."""
    power = np.bincount(lights.light, lights.power, len(lights.names))
    within = np.divide(lights.power, power[lights.light], out=np.zeros_like(lights.power), where=lights.power > 0)
    return _normalised(within * weight[lights.light])


def _normalised(weight: NDArray[np.float64]) -> NDArray[np.float64]:
    total = weight.sum()
    return weight / total if total > 0 else weight
