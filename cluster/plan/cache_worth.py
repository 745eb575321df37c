"""Whether gather rays find photons where they arrive, which a trial of integrators asks.

A gather ray reads the irradiance at the nearest photon that has it, within a reach that goes by the density of photons
where most of them are. Where one bright patch holds nearly all, as where a lamp lights a room by way of its ceiling or
the sun shines through a window, the reach is short and nearly all of the room beyond it: rays go on and on. That costs
time (trial/prices.py), and is no reason for the map, which has nothing there to show but these few photons.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.plan.map_plans import MapPlans, irradiance_plan
from wdpm.cluster.plan.photon_pilot import PhotonPilot
from wdpm.cluster.plan.pilot_gathers import PILOT_K
from wdpm.cluster.render_settings import RenderSettings
from wdpm.kernels.photons.deposits import GLOBAL_MAP


def unread_at(
    pilot: PhotonPilot,
    settings: RenderSettings,
    planned: MapPlans,
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
) -> float:
    """The share of gather rays which arrive at some places that are expected to find no irradiance within reach.

    Args:
        pilot: that was flown for these settings, which have final gathering.
        position, normal: of the places, shape [P, 3].
    """
    plan, maps, flown = irradiance_plan(pilot, settings, planned), planned.maps, pilot.world.global_map.paths
    if not maps[GLOBAL_MAP].paths or not len(pilot.photons[GLOBAL_MAP]["id"]):
        return 1.0
    if not len(position):
        return 0.0
    _, radius = pilot.among(GLOBAL_MAP).gather(position, normal, pilot.world.extent)
    # Photons are strewn at random: where some number is expected, there is none with a probability of exp(-number).
    share = plan.share * maps[GLOBAL_MAP].paths / flown
    expected = PILOT_K * share * (plan.reach / radius.astype(np.float64)) ** 2
    return float(np.exp(-expected).mean())
