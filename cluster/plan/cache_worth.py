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
    if not planned.maps[GLOBAL_MAP].paths or not len(pilot.photons[GLOBAL_MAP]["id"]):
        return 1.0
    if not len(position):
        return 0.0
    _, radius = pilot.among(GLOBAL_MAP).gather(position, normal, pilot.world.extent)
    # Photons are strewn at random: where some number is expected, there is none with a probability of exp(-number).
    expected = sites_about(pilot, settings, planned) / radius.astype(np.float64) ** 2
    return float(np.exp(-expected).mean())


def sites_about(pilot: PhotonPilot, settings: RenderSettings, planned: MapPlans) -> float:
    """Photons with irradiance that a gather ray is expected to find within reach, where PILOT_K photons of the pilot
    lie within a radius of one [(scene units)²]; within another one as many as by its square.
    """
    plan, flown = irradiance_plan(pilot, settings, planned), max(pilot.world.global_map.paths, 1)
    return PILOT_K * plan.share * planned.maps[GLOBAL_MAP].paths / flown * plan.reach**2
