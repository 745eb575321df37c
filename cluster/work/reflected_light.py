"""What white surfaces reflect of a photon map, at places that are worked out ahead for gather rays to read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.world import IrradiancePlan, MapPlan
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.gather import gather_kernel
from wdpm.kernels.photons.in_sight import gather_in_sight
from wdpm.kernels.photons.surface_points import least_radius, reflect_gathered
from wdpm.kernels.photons.walls import FEELERS

GATHER_RUN = 32
"""Gathers that one Warp thread makes one after another: enough to profit from its last radius, and to share out."""

GATHER_GRAIN = 32
"""Runs of gathers that are worth a launch of their own."""

WALL_GRAIN = 256
"""Photons beside walls that are."""


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


@dataclass(frozen=True, eq=False)
class Walled:
    """Photons of the global map that carry irradiance, some of them beside walls (kernels.photons.in_sight).

    Attributes:
        feel: the kernel of kernels.photons.walls.
        trees, surfaces: of the cell's triangles.
        photons, points: trees of the map's photons and of its surface points.
        rank: of those that carry it, among all, array [N] on a device.
    """

    feel: Any
    trees: Any
    surfaces: Any
    photons: Any
    points: Any
    rank: Any
    plan: MapPlan
    irradiance: IrradiancePlan

    def gather(self, places: Places, radius: Any, radiance: NDArray[np.float32], launcher: Launcher) -> Arrays:
        """Feel for walls, and estimate anew where one hides something.

        Args:
            places: of those that carry it.
            radius: of their gathers, array [N] on the device.
            radiance: that they told, shape [N, 3].

        Returns:
            "radiance" and "radius", as they are then, and "room": how far off each may be read [scene units].
        """
        count, device = len(places.position), launcher.device
        room = wp.empty(count, dtype=wp.float32, device=device)
        walls = wp.empty(count * FEELERS, dtype=wp.vec3, device=device)
        where = {"position": places.position, "normal": places.normal}
        launcher(
            self.feel,
            count,
            grain=WALL_GRAIN,
            trees=self.trees,
            surfaces=self.surfaces,
            **where,
            radius=radius,
            reach=self.irradiance.reach,
            room_out=room,
            walls_out=walls,
        )
        told = {"radiance": radiance.copy(), "radius": radius.numpy().copy(), "room": room.numpy().copy()}
        walled = np.flatnonzero(told["room"] < told["radius"]).astype(np.int32)
        if len(walled):
            made = [wp.empty(len(walled), dtype=kind, device=device) for kind in (wp.vec3, wp.float32, wp.bool)]
            launcher(
                gather_in_sight,
                len(walled),
                grain=WALL_GRAIN,
                walls=walls,
                **where,
                photons=self.photons,
                points=self.points,
                site=wp.array(walled, dtype=wp.int32, device=device),
                rank=self.rank,
                front_normal=places.front,
                room=room,
                radius=radius,
                k=self.irradiance.k,
                r_max=self.plan.radius,
                r_least=least_radius(self.plan.point_area, self.plan.radius),
                point_area=self.plan.point_area,
                share=self.irradiance.share,
                reach=self.irradiance.reach,
                scale=1.0 / self.plan.paths,
                radiance_out=made[0],
                radius_out=made[1],
                hidden_out=made[2],
            )
            seen, within, hidden = (array.numpy() for array in made)
            # Where no surface goes on behind the wall nobody reads from there.
            told["room"][walled[~hidden]] = told["radius"][walled[~hidden]]
            told["radiance"][walled[hidden]], told["radius"][walled[hidden]] = seen[hidden], within[hidden]
        return told
