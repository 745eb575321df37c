"""How many paths each photon map gets, and how far it is gathered from: by the pilot's photons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from wdpm.cluster.batch import Arrays
from wdpm.cluster.plan.map_worth import (
    MapWorth,
    caustics_in_words,
    fewer_neighbours,
    worth_of_caustics,
    worth_of_volume,
)
from wdpm.cluster.plan.photon_pilot import PhotonPilot
from wdpm.cluster.plan.pilot_gathers import PILOT_K
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.world import IrradiancePlan, MapPlan
from wdpm.kernels.limits import POINTS_A_PHOTON, POINTS_LEAST, POINTS_MOST
from wdpm.kernels.photons.beam import sum_unit
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP, VOLUME_MAP
from wdpm.kernels.photons.walls import farthest_wall
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.whole import total_area

PILOT_GATHERS = 8
"""Of a pilot's paths, for each photon at which it asks for its own density: of a thousand the median radius is known to
3 %."""

RADIUS_QUANTILE = 0.5
NEAR = 0.125
"""Of the scene's extent: how far is looked first for the neighbours of a median photon."""

RADIUS_MARGIN = 2.5
"""The gather radius is 2.5 times the one in which the median photon finds k others: gathers in light that is a sixth as
dense still find their k; dimmer places are averaged over the fixed radius, and counted in the report. Wider, the
overlap bands would take more photons than they are worth; narrower, dim places would be noisier."""

CAUSTIC_MARGIN = 1.25
"""The same of caustics, which most of a room has next to none of: what gathers take there of far photons is too much,
since k photons that lie on one side of a disc tell of no density. Where chairs' legs of chrome threw 2,000 photons on a
floor, the parts of it about them were 10 % too bright with a margin of 2.5."""

PHOTONS_A_NEIGHBOUR = 32
LEAST_NEIGHBOURS = 4
"""The density about a photon of the pilot is told by one neighbour for so many photons of its map, and at least by so
many: a large part of few photons reaches from one patch of light to the next."""

BEAM_K = 40
"""Volume photons in a ball of the beams' radius about the median one: a beam through it then finds some hundred."""

BEAM_NEAR = 2.0
"""Of the scene's extent: how far from its middle volume photons tell of the density of those that are seen."""

BEAM_PILOT = 4096
"""Volume photons of the pilot that the density is told by."""

BEAM_HEADROOM = 64.0
"""A volume photon may be so many times stronger than the pilot's strongest; what is beyond is cut, and counted."""

IRRADIANCE_SHARE = 0.25
"""Every fourth photon has its irradiance computed ahead (Christensen 1999): a gather ray then finds one within a third
of the radius that the estimate averages over anyway."""

FEW_SAMPLES, FEWEST_SAMPLES = 4, 2
"""In passes of so many samples a pixel every eighth, and every sixteenth, is enough: squared errors of nine scenes
(256x256, 1 to 4 samples) were the same to 2 %, and renders took up to 9 % less. As each is a mean of 50 photons, none
is left out. But the nearest photon that a ray finds more often lies where there are many, and dim rooms are 0.1 %
brighter for either step, which more samples would show."""

IRRADIANCE_REACH = 0.4
"""How far gather rays look for it, in gather radii: where as few as ten photons lie within one, half of the places
still find one. Where none is found the ray goes on instead. Where half as many have it, as much further."""

LONG_SHARE = 1e-3
"""Of the flux that photons bring: what the longest paths may bring together to count as nothing, where paths may only
be so long. The files of many rooms say 65 edges, which no light that matters has."""

POINTS_A_DISC = 64
"""Surface points in the largest gather, at least, however few the photons."""

POINTS_FOR_DISCS = 1 << 22
"""Surface points for the sake of discs, at most: where all light of a map is in a few bright spots, gathers are so
small that 64 points in each would take sixteen million, and half a gigabyte. They count but near edges; with a fifth as
many a disc's area is told to a tenth there."""

POINTS_IN_DISC = 1 << 11
"""Surface points in the largest gather that are enough, of few photons: more would cost more than the gather itself."""

CAUSTIC_POINTS_IN_DISC = 1 << 9
"""The same of the caustic map, which every camera sample asks: they are counted anew each time, and 512 tell a disc's
area to a hundredth."""

_POINTS_IN_DISC = (POINTS_IN_DISC, CAUSTIC_POINTS_IN_DISC, POINTS_IN_DISC)

VOLUME_PHOTONS_MOST = 1 << 22
"""Photons that media may scatter for the sake of the global map, if fewer are asked for. In white fog without end
hardly a path comes to a surface: its map has few photons."""


@dataclass(frozen=True)
class MapPlans:
    """All maps of a render.

    Attributes:
        maps: the global, the caustic and the volume map.
        caustic_k: photons that gathers of the caustic map look for.
        chose: in words, what was decided by what the maps are worth, and why.
        expected: photons of the global, the caustic and the volume map.
    """

    maps: tuple[MapPlan, MapPlan, MapPlan]
    caustic_k: int
    chose: tuple[str, ...]
    expected: tuple[float, float, float]


NO_MAPS = MapPlans((MapPlan(), MapPlan(), MapPlan()), 0, (), (0.0, 0.0, 0.0))
"""Of a render without photons."""


def map_plans(pilot: PhotonPilot, settings: RenderSettings, flat: FlatScene) -> MapPlans:
    """Paths and radius of each map."""
    world, photons, extent, unit = pilot.world, pilot.photons, flat.extent, flat.unit
    stored = [len(part["id"]) for part in photons]
    measured = _measured(pilot, flat)
    caustics, volume = measured.caustics, worth_of_volume(pilot)
    of_global = MapWorth(stored[GLOBAL_MAP], 1.0).paths(settings.photons, pilot.paths)
    of_volume = volume.paths(settings.volume_photons, pilot.paths) if world.volume_map.paths else 0
    paths = min(max(of_global, of_volume), _most_paths(stored[VOLUME_MAP], pilot, settings))
    samples = flat.camera.width * flat.camera.height * settings.samples_of_pass
    caustic_paths = caustics.paths(settings.caustic_photons, pilot.paths, samples) if world.caustic_map.paths else 0
    every = [paths, caustic_paths, paths if of_volume or _may_scatter(pilot, settings) else 0]
    expected = [s * p / pilot.paths for s, p in zip(stored, every, strict=True)]
    caustic_k = settings.caustic_k
    if 0 < expected[CAUSTIC_MAP] < settings.caustic_photons:  # of as many as were asked for, k is as it was asked for
        caustic_k = fewer_neighbours(caustic_k, expected[CAUSTIC_MAP])
    radii = [
        _given(settings, "radius", unit)
        or _gather_radius(measured, GLOBAL_MAP, stored[GLOBAL_MAP], settings.k, expected[GLOBAL_MAP], extent),
        _given(settings, "caustic_radius", unit)
        or _gather_radius(measured, CAUSTIC_MAP, stored[CAUSTIC_MAP], caustic_k, expected[CAUSTIC_MAP], extent),
        _given(settings, "volume_radius", unit) or _beam_radius(photons[VOLUME_MAP], expected[VOLUME_MAP], extent),
    ]
    plans = [
        MapPlan(p, r, settings.band * r, old.read, point_area(measured.area, r, e, most))
        for p, r, e, old, most in zip(every, radii, expected, world.maps, _POINTS_IN_DISC, strict=True)
    ]
    words = caustics_in_words(caustics, pilot, settings.caustic_photons, caustic_paths)
    chose = () if words is None else (words,)
    return MapPlans((plans[0], plans[1], plans[2]), caustic_k, chose, (expected[0], expected[1], expected[2]))


def with_fewer_paths(plans: MapPlans, shares: Sequence[int]) -> MapPlans:
    """The same with a part of the paths of the global and the caustic map, for what that would cost."""
    fewer = [replace(plan, paths=plan.paths // share) for plan, share in zip(plans.maps, shares, strict=False)]
    expected = [photons / share for photons, share in zip(plans.expected, shares, strict=False)]
    return replace(
        plans,
        maps=(fewer[0], fewer[1], plans.maps[VOLUME_MAP]),
        expected=(expected[0], expected[1], plans.expected[VOLUME_MAP]),
    )


@dataclass(frozen=True)
class _Measured:
    """What a pilot's photons tell, whatever the settings.

    Attributes:
        caustics: what the caustic map is worth.
        area: of the scene.
        radii: in which the median photon of the global and of the caustic map has others, as many as `_others` says;
            0 of too few.
    """

    caustics: MapWorth
    area: float
    radii: tuple[float, float]


_MEASURED: WeakKeyDictionary[PhotonPilot, _Measured] = WeakKeyDictionary()
"""Plans are made several times of one pilot: for the irradiance cache, for the integrator, and for good."""


def _measured(pilot: PhotonPilot, flat: FlatScene) -> _Measured:
    """Measured once."""
    if pilot not in _MEASURED:
        _MEASURED[pilot] = _Measured(
            worth_of_caustics(pilot),
            total_area(flat.triangles, pilot.cell.store.instance_areas.of) if pilot.world.paths else 1.0,
            (_median_radius(pilot, GLOBAL_MAP, flat), _median_radius(pilot, CAUSTIC_MAP, flat)),
        )
    return _MEASURED[pilot]


def _most_paths(of_volume: int, pilot: PhotonPilot, settings: RenderSettings) -> int:
    """Paths whose photons in media can be held, and traced before anyone tires of it, however few reach a surface.

    Args:
        of_volume: volume photons that the pilot stored.
    """
    most = max(VOLUME_PHOTONS_MOST, settings.volume_photons)
    return max(1, most * pilot.paths // max(of_volume, 1))


def _may_scatter(pilot: PhotonPilot, settings: RenderSettings) -> bool:
    """Whether photons of the global map's paths may scatter in media, though none of the pilot's did.

    They cost nothing more then, and without them light would be lost, however seldom it scatters.
    """
    media = pilot.world.media
    scatters = bool(((media.sigma_t > 0) & (media.albedo > 0)).any())
    return scatters and pilot.world.volume_map.paths > 0 and settings.volume_photons > 0


MOST_RADIUS = 1e18
"""Of what a person may ask for, in the renderer's unit, in which a scene is of the order of 1; the least is one over
it. Squares of all between are normal numbers in single precision."""


def _given(settings: RenderSettings, name: str, unit: float) -> float | None:
    """A length that a person gave in the scene's unit, in the renderer's; SettingsError beyond all proportion."""
    length: float | None = getattr(settings, name)
    if length is None:
        return None
    if not 1.0 / MOST_RADIUS <= length / unit <= MOST_RADIUS:
        raise SettingsError(
            f"{name} is {length:g}; expected between {unit / MOST_RADIUS:.0e} and {unit * MOST_RADIUS:.0e} in a scene "
            "of this size"
        )
    return length / unit


def _beam_radius(photons: Arrays, expected: float, extent: float) -> float:
    """The radius of beams: that of a ball about the median volume photon that holds BEAM_K photons.

    In fog without bounds most photons of a lamp scatter far from all that there is, and lie far apart there. So those
    near the scene tell, if they are enough to.
    """
    position = photons["position"]
    near = position[(np.abs(position) <= BEAM_NEAR * extent).all(axis=1)]
    if len(near) > PILOT_K:
        position, expected = near, expected * len(near) / len(position)
    if len(position) <= PILOT_K or not expected:
        return extent / 16.0
    chosen = np.linspace(0, len(position) - 1, min(BEAM_PILOT, len(position))).astype(np.intp)
    sample = position[chosen].astype(np.float64)
    distance2 = ((sample[::8, None, :] - sample[None, :, :]) ** 2).sum(axis=2)
    nearest = math.sqrt(float(np.median(np.partition(distance2, PILOT_K, axis=1)[:, PILOT_K])))
    if nearest == 0:
        return extent / 16.0
    # Photons in space: as many times denser, as many times less volume for the same number.
    return nearest * (BEAM_K / PILOT_K * len(sample) / expected) ** (1.0 / 3.0)


def irradiance_plan(pilot: PhotonPilot, settings: RenderSettings, planned: MapPlans) -> IrradiancePlan:
    """What gather rays read at photons of the global map."""
    plan = planned.maps[GLOBAL_MAP]
    if not settings.final_gathers or not plan.paths:
        return IrradiancePlan()
    limited = settings.max_depth is not None
    longest = max(_longest(pilot.photons[number]) for number in (GLOBAL_MAP, CAUSTIC_MAP)) if limited else 0
    share = irradiance_share(settings)
    reach = IRRADIANCE_REACH * math.sqrt(IRRADIANCE_SHARE / share) * plan.radius
    return IrradiancePlan(share, settings.k, planned.caustic_k, reach=reach, longest=longest)


def irradiance_share(settings: RenderSettings) -> float:
    """The share of photons that carry irradiance."""
    samples = settings.samples_of_pass
    return IRRADIANCE_SHARE * 0.5 ** ((samples <= FEW_SAMPLES) + (samples <= FEWEST_SAMPLES))


def band_of_walls(irradiance: IrradiancePlan, plan: MapPlan) -> float:
    """How far from a cell walls may be that are felt for from photons whose irradiance is read there [scene units].

    Args:
        plan: of the global map.
    """
    return irradiance.reach + farthest_wall(max(plan.radius, irradiance.reach))


def _longest(photons: Arrays) -> int:
    """Edges of the longest paths, but for those that bring less than LONG_SHARE of the flux; 0 of no photons."""
    by_edges = np.bincount(photons["edges"], photons["flux"].mean(axis=1, dtype=np.float64), 1)
    beyond = by_edges[::-1].cumsum()[::-1]  # so many edges or more
    return int(np.flatnonzero(beyond >= LONG_SHARE * beyond[0])[-1])


def volume_unit(photons: Sequence[Arrays], volume_map: MapPlan, flat: FlatScene) -> float:
    """The unit of exact sums along beams, from the strongest photon of the pilot with room above.

    Args:
        photons: of each map; those on surfaces tell how strong a photon is where none of the pilot's scattered.
    """
    of_media, *others = (float(part["flux"].max(initial=0.0)) for part in (photons[VOLUME_MAP], *photons))
    largest = (of_media or max(others)) * BEAM_HEADROOM
    if largest == 0:
        return 1.0
    return sum_unit(largest, volume_map.radius, float(np.abs(flat.media.g).max(initial=0.0)))


def _median_radius(pilot: PhotonPilot, number: int, flat: FlatScene) -> float:
    """The radius in which the median of the pilot's photons of a map has `_others`; 0 where there is but one."""
    photons = pilot.photons[number]
    position, normal = photons["position"], photons["normal"]
    others = _others(len(position))
    if not others:
        return 0.0
    queries = np.linspace(0, len(position) - 1, min(max(pilot.paths // PILOT_GATHERS, 1), len(position))).astype(
        np.intp
    )
    # A photon with no others that face alike would look through the whole scene: the median need not know how far.
    for furthest in (NEAR * flat.extent, flat.extent):
        _, found = pilot.among(number).gather(position[queries], normal[queries], furthest, others)
        median, next_to_it = (
            float(np.quantile(found, RADIUS_QUANTILE, method=which)) for which in ("linear", "higher")
        )
        if next_to_it < furthest:
            break
    return median


def _others(stored: int) -> int:
    """How many others the density about a photon is told by, among so many."""
    return min(max(stored // PHOTONS_A_NEIGHBOUR, LEAST_NEIGHBOURS), PILOT_K, max(stored - 1, 0))


def _gather_radius(measured: _Measured, number: int, stored: int, k: int, expected: float, extent: float) -> float:
    """A gather radius from the density of the pilot's photons, scaled to the number expected.

    Where next to nothing lands it is of the scene's order. With a narrow one each photon is a bright disc by itself:
    of the light that a glossy floor sends up through a room, a few round spots on its walls.

    Args:
        number: of the map, of which the pilot stored `stored` photons.
    """
    if not expected:
        return extent / 16.0
    others, margin = _others(stored), CAUSTIC_MARGIN if number == CAUSTIC_MAP else RADIUS_MARGIN
    if not others:
        return min(margin / RADIUS_MARGIN * math.sqrt(k * measured.area / (math.pi * expected)), extent)
    # Photons on a surface: as many times denser, as many times less area for the same number.
    denser = expected / stored
    radius = margin * measured.radii[number] * math.sqrt(k / others / denser)
    return radius if others == PILOT_K else min(radius, extent)


def point_area(area: float, radius: float, photons: float, in_disc: int = POINTS_IN_DISC) -> float:
    """The area that a surface point stands for, of a map of so many photons on a scene of that area [m²].

    Args:
        area: of all surfaces [m²].
        radius: of the widest gather [m].
        in_disc: points in that gather that are enough, of few photons.
    """
    discs = max(1.0, area / (math.pi * radius**2))  # one that is larger than the scene holds all that there is
    least = min(POINTS_LEAST, in_disc * discs)
    wanted = max(POINTS_A_PHOTON * photons, min(POINTS_A_DISC * discs, POINTS_FOR_DISCS), least)
    return area / min(wanted, POINTS_MOST)
