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
from wdpm.kernels.photons.gather_at_photons import gather_at_photons
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


@dataclass(frozen=True, eq=False)
class Reflected:
    """What white Lambertian surfaces reflect at N places.

    Attributes:
        radiance: [W/(m² sr)], float32, shape [N, 3].
        grazing: how much that light grazes the surface (kernels.maths.schlick), float32, shape [N]; none where nobody
            asks.
    """

    radiance: NDArray[np.float32]
    grazing: NDArray[np.float32]

    def with_more(self, other: Reflected) -> Reflected:
        """The light of both."""
        radiance = self.radiance + other.radiance
        if not len(self.grazing):
            return Reflected(radiance, self.grazing)
        own, more = (light.radiance.sum(axis=1, dtype=np.float64) for light in (self, other))
        whole, weighed = own + more, own * self.grazing + more * other.grazing
        grazing = np.divide(weighed, whole, out=np.zeros_like(whole), where=whole > 0)
        return Reflected(radiance, grazing.astype(np.float32))


def of_white(
    photons: Any, points: Any, plan: MapPlan, k: int, places: Places, grazes: bool, launcher: Launcher
) -> Reflected:
    """What white Lambertian surfaces reflect of the photons about them.

    Args:
        photons, points: trees of a map's photons and of its surface points.
        plan: of the map.
        k: photons to look for.
        grazes: whether anybody asks how much light grazes the surface.
    """
    count, device = len(places.position), launcher.device
    irradiance = wp.empty(count, dtype=wp.vec3, device=device)
    radius = wp.empty(count, dtype=wp.float32, device=device)
    grazing = wp.empty(count if grazes else 0, dtype=wp.float32, device=device)
    launcher(
        gather_at_photons,
        -(-count // GATHER_RUN),
        grain=GATHER_GRAIN,
        photons=photons,
        rank=wp.full(count, -1, dtype=wp.int32, device=device),
        position=places.position,
        normal=places.normal,
        k=k,
        r_max=plan.radius,
        r_least=least_radius(plan.point_area, plan.radius),
        share=0.0,  # of photons that are places: these are none of the map's
        reach=0.0,
        run=GATHER_RUN,
        irradiance_out=irradiance,
        radius_out=radius,
        grazing_out=grazing,
    )
    return Reflected(by_white(irradiance, radius, points, plan, places, launcher), grazing.numpy())


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

    def gather(self, places: Places, radius: Any, light: Reflected, launcher: Launcher) -> Arrays:
        """Feel for walls, and estimate anew where one hides something.

        Args:
            places: of those that carry it.
            radius: of their gathers, array [N] on the device.
            light: that they told.

        Returns:
            "radiance", "grazing" and "radius", as they are then, and "room": how far off each may be read [scene
            units].
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
        told = {name: column.copy() for name, column in vars(light).items()}
        told |= {"radius": radius.numpy().copy(), "room": room.numpy().copy()}
        walled = np.flatnonzero(told["room"] < told["radius"]).astype(np.int32)
        if len(walled):
            made = [wp.empty(len(walled), dtype=kind, device=device) for kind in (wp.vec3, wp.float32, wp.bool)]
            grazing = wp.empty(len(walled) if len(light.grazing) else 0, dtype=wp.float32, device=device)
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
                grazing_out=grazing,
            )
            seen, within, hidden = (array.numpy() for array in made)
            # Where no surface goes on behind the wall nobody reads from there.
            told["room"][walled[~hidden]] = told["radius"][walled[~hidden]]
            told["radiance"][walled[hidden]], told["radius"][walled[hidden]] = seen[hidden], within[hidden]
            if len(light.grazing):
                told["grazing"][walled[hidden]] = grazing.numpy()[hidden]
        return told
