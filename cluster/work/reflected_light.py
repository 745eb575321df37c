"""What white surfaces reflect of a photon map, at places that are worked out ahead for gather rays to read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.world import MapPlan
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.gather import gather_kernel
from wdpm.kernels.photons.surface_points import least_radius, reflect_gathered

GATHER_RUN = 32
"""Gathers that one Warp thread makes one after another: enough to profit from its last radius, and to share out."""

GATHER_GRAIN = 32
"""Runs of gathers that are worth a launch of their own."""


@dataclass(frozen=True, eq=False)
class Places:
    """Places on surfaces, arrays of vec3 [N] on a device.

    Attributes:
        position: [scene units].
        normal: unit, of the side that light arrives at.
        front: unit, of the surface's front.
    """

    position: Any
    normal: Any
    front: Any


def of_white(
    photons: Any, points: Any, plan: MapPlan, k: int, places: Places, launcher: Launcher
) -> NDArray[np.float32]:
    """Radiance that white Lambertian surfaces reflect of the photons about them, shape [N, 3].

    Args:
        photons, points: trees of a map's photons and of its surface points.
        plan: of the map.
        k: photons to look for.
    """
    count, device = len(places.position), launcher.device
    irradiance = wp.empty(count, dtype=wp.vec3, device=device)
    radius = wp.empty(count, dtype=wp.float32, device=device)
    launcher(
        gather_kernel,
        -(-count // GATHER_RUN),
        grain=GATHER_GRAIN,
        photons=photons,
        position=places.position,
        normal=places.normal,
        shading_normal=places.normal,
        k=k,
        r_max=plan.radius,
        r_least=least_radius(plan.point_area, plan.radius),
        run=GATHER_RUN,
        irradiance_out=irradiance,
        count_out=wp.empty(count, dtype=wp.int32, device=device),
        radius_out=radius,
        truncated_out=wp.empty(count, dtype=wp.bool, device=device),
    )
    return by_white(irradiance, radius, points, plan, places, launcher)


def by_white(
    irradiance: Any, radius: Any, points: Any, plan: MapPlan, places: Places, launcher: Launcher
) -> NDArray[np.float32]:
    """Radiance that white Lambertian surfaces reflect of what was gathered there, shape [N, 3].

    Args:
        irradiance, radius: of the gathers, arrays [N] on the device.
        points: tree of the map's surface points.
    """
    count, device = len(places.position), launcher.device
    radiance = wp.empty(count, dtype=wp.vec3, device=device)
    launcher(
        reflect_gathered,
        count,
        points=points,
        position=places.position,
        front_normal=places.front,
        clearance=wp.zeros(count, dtype=wp.float32, device=device),
        albedo=wp.full(count, wp.vec3(1.0), dtype=wp.vec3, device=device),
        irradiance=irradiance,
        radius=radius,
        point_area=plan.point_area,
        r_max=plan.radius,
        scale=1.0 / plan.paths,
        radiance_out=radiance,
    )
    reflected: NDArray[np.float32] = radiance.numpy()
    return reflected
