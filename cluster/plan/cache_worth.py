"""Whether an irradiance cache is worth its gather rays: whether these find photons where they arrive.

A gather ray reads the irradiance at the nearest photon that has it, within a reach that goes by the density of photons
where most of them are. Where one bright patch holds nearly all, as where a lamp lights a room by way of its ceiling or
the sun shines through a window, the reach is short and nearly all of the room beyond it: rays go on and on, records are
made of few long paths, and both cost more than the photon map and err more.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.plan.map_plans import MapPlans, irradiance_plan, map_plans
from wdpm.cluster.plan.photon_pilot import PhotonPilot
from wdpm.cluster.plan.pilot_gathers import PILOT_K
from wdpm.cluster.plan.small_view import SeenPlaces, small_camera, without_photons
from wdpm.cluster.plan.view import view_of
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.task import BucketTask
from wdpm.kernels.photons.deposits import GLOBAL_MAP
from wdpm.scenes.flat.flatten import FlatScene

SEEN_PIXELS = 1024
"""Places that the camera sees, which stand for those where gather rays arrive."""

MOST_UNREAD = 0.5
"""Of gather rays, that may find no photon with irradiance within reach. On ten scenes the cache had the smaller error
in the same time where 4 to 37 % found none, and the map where 66 and 74 % did."""


def unread_share(flat: FlatScene, pilot: PhotonPilot, settings: RenderSettings) -> float:
    """The share of gather rays that are expected to find no irradiance within reach.

    Args:
        pilot: that was flown for these settings, which have final gathering.
    """
    planned = map_plans(pilot, settings, flat)
    if not planned.maps[GLOBAL_MAP].paths or not len(pilot.photons[GLOBAL_MAP]["id"]):
        return 1.0
    places = _seen(flat, pilot, settings)
    return unread_at(pilot, settings, planned, places.all("position"), places.all("normal"))


def unread_at(
    pilot: PhotonPilot,
    settings: RenderSettings,
    planned: MapPlans,
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
) -> float:
    """The same of gather rays that arrive at some places.

    Args:
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


def _seen(flat: FlatScene, pilot: PhotonPilot, settings: RenderSettings) -> SeenPlaces:
    """Places that a few camera paths ask for photons at."""
    looking = replace(flat, camera=small_camera(flat.camera, SEEN_PIXELS))
    plain = replace(settings, indirect=Indirect.MAP, spp=1, passes=1, light_samples=1)
    places = SeenPlaces()
    with without_photons(pilot) as worker:
        view = view_of(looking, plain, 1)
        worker.set_view(view)
        worker.replica.observer = places
        worker.start(BucketTask(0, 0, 0, view.camera.width, view.camera.height))
        worker.replica.observer = None
    return places
