"""From a scene and settings to a World: the pilot, the number of paths, the gather radius, the top tree.

Everything that an image depends on is decided here from the whole scene by a computation that is the same whatever the
cluster: a fixed pilot of photon paths in one cell. The top tree and who holds which cell come from the cluster's size,
and the image does not depend on them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays, take
from wdpm.cluster.plan.effects import calls_for_caustics, calls_for_media, features_of
from wdpm.cluster.plan.light_samples import light_samples_of
from wdpm.cluster.plan.light_shares import pilot_emission, shared_out
from wdpm.cluster.plan.partition import deal, rows_of_cells
from wdpm.cluster.plan.top_tree import build_top_tree
from wdpm.cluster.records import NO_CACHE, CachePlan
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.task import PhotonTask
from wdpm.cluster.work.cell import Cell
from wdpm.cluster.work.photon_home import set_out
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import IrradiancePlan, MapPlan, TopTree, View, World
from wdpm.kernels.features import Features
from wdpm.kernels.launch import Launcher
from wdpm.kernels.limits import MAPS
from wdpm.kernels.photons import photon_map
from wdpm.kernels.photons.beam import sum_unit
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP, VOLUME_MAP
from wdpm.kernels.photons.flight import BOUNCE_BITS
from wdpm.kernels.photons.gather import check_settings, gather_kernel
from wdpm.scenes.flat.areas import triangle_areas
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.model.scene import Camera

PILOT_PATHS = 1 << 15
"""Paths of the pilot: its stored photons tell paths per photon to about half a percent, in some 50 ms."""

PILOT_GATHERS = 4096
"""Pilot photons at which the pilot asks for its own density."""

PILOT_K = 16
"""Neighbours that tell the density at a pilot photon: few enough to stay local, enough to be within a quarter."""

RADIUS_QUANTILE = 0.5
RADIUS_MARGIN = 2.5
"""The gather radius is 2.5 times the one in which the median photon finds k others: gathers in light that is a sixth as
dense still find their k; dimmer places are averaged over the fixed radius, and counted in the report. Wider, the
overlap bands would take more photons than they are worth; narrower, dim places would be noisier."""

PATHS_A_PHOTON = 10
"""Most paths for each photon that is asked for: where hardly any path stores one, as under the open sky or far from
the only mirror, indirect light is faint, and fewer photons tell it. The report says how many were stored."""

BEAM_K = 40
"""Volume photons in a ball of the beams' radius about the median one: a beam through it then finds some hundred."""

BEAM_PILOT = 4096
"""Volume photons of the pilot that the density is told by."""

BEAM_HEADROOM = 64.0
"""A volume photon may be so many times stronger than the pilot's strongest; what is beyond is cut, and counted."""

IRRADIANCE_SHARE = 0.25
"""Every fourth photon has its irradiance computed ahead (Christensen 1999): a gather ray then finds one within a third
of the radius that the estimate averages over anyway."""

IRRADIANCE_REACH = 0.4
"""How far gather rays look for it, in gather radii: where as few as ten photons lie within one, half of the places
still find one. Where none is found the ray goes on instead."""

CACHE_PLAN = CachePlan(
    rounds=6, spacing=32, rows=11, columns=35, error=0.5, clearance=0.6, least=5.0, most=5.0, wanted=0.1
)
"""Strata about as long as wide; candidates from every 32nd pixel to all: what no record reaches then traces a gather
ray a sample, and shows as single pixels along edges. What follows from the image: _cache_plan."""

RECORD_REACH = 0.08
"""Most that a record reaches, as a share of the image: some dozen records across a wall that is all alike."""

RECORD_LEAST = 0.012
"""Least that a record reaches, as a share of the image, but one pixel at least: small images have corners too. At most
CACHE_PLAN.least pixels, or large images would blur them."""

BUCKET_LEAST, BUCKET_MOST = 32, 128
"""Bounds of the side of a bucket that is derived [pixels]."""

BUCKET_SHADOW_RAYS = 1 << 18
"""Most shadow rays of a bucket larger than the least: what is on its way at once."""

BUCKETS_A_WORKER = 8
"""Buckets that each worker gets, at least, before they are made larger: the last ones are shared out evenly."""

POINTS_A_PHOTON = 2
"""Surface points a photon: their count then adds little to the noise of the photons' own."""

POINTS_A_DISC = 64
"""Surface points in the largest gather, at least, however few the photons."""

POINTS_LEAST = 1 << 16
POINTS_MOST = 1 << 24
"""Bounds to the number of surface points: 52 bytes each."""


@dataclass(frozen=True, eq=False)
class Plan:
    """What is decided before any work is handed out.

    Attributes:
        rows: the triangles of each cell, rows of the flat scene.
        holders: the worker that holds each cell.
        pilot: the pilot's one-cell worker, to be used again, where there is but one cell; otherwise None, since it
            holds the whole scene.
        pilot_photons: places of the pilot's photons, float32, shape [P, 3].
    """

    world: World
    rows: list[NDArray[np.intp]]
    holders: list[int]
    pilot: CellWorker | None
    pilot_photons: NDArray[np.float32]


def make_plan(
    flat: FlatScene, settings: RenderSettings, workers: int, launcher: Launcher, cells: int | None = None
) -> Plan:
    """Decide what an image depends on, and who will compute what.

    Args:
        workers: how many will share the work; 0 and 1 are alike.
        cells: a power of two; None for the least that gives every worker the like.
    """
    features = features_of(flat, settings)
    pilot = CellWorker(0, _pilot_world(flat, features, settings), {0: flat.triangles}, [0], launcher)
    cell = pilot.cells[0]
    _fly_pilot(pilot)
    photons = _by_map(cell.store.so_far())
    plans = map_plans(pilot, photons, settings, flat)
    for plan in plans:
        check_settings(settings.k, plan.radius)
    irradiance = _irradiance_plan(settings, plans)
    # What lies within reach of a cell is estimated there too, from the photons about it.
    plans = (replace(plans[GLOBAL_MAP], band=plans[GLOBAL_MAP].band + irradiance.reach), *plans[1:])
    wanted = max(workers, 1) if cells is None else cells
    levels = (wanted - 1).bit_length()
    places = np.concatenate([part["position"] for part in photons])
    band = max((plan.band for plan in plans if plan.paths), default=plans[0].band)
    tree = build_top_tree(flat.triangles.positions, places, band, levels, wanted)
    world = replace(
        pilot.replica.world,
        top_tree=tree,
        global_map=plans[0],
        caustic_map=plans[1],
        volume_map=plans[2],
        emission=shared_out(pilot.replica.world, _flux_by_light(pilot, photons)),
        volume_unit=_volume_unit(photons[VOLUME_MAP], plans[VOLUME_MAP], flat),
        irradiance=irradiance,
    )
    rows = rows_of_cells(flat.triangles.positions, tree, flat.extent, launcher)
    burdens = np.array([len(r) for r in rows], np.float64) / len(flat.triangles)
    if len(places):
        burdens += photons_in_cells(places, tree) / len(places)
    holders = deal(burdens, max(workers, 1))
    pilot.forget_photons()
    return Plan(world, rows, holders, pilot if tree.cells == 1 else None, places)


def _flux_by_light(pilot: CellWorker, photons: Sequence[Arrays]) -> NDArray[np.float64]:
    """Flux that the pilot's photons of each light brought into each map, shape [MAPS, lights].

    Added in the order of the photons' numbers: the sums that a cell counts depend on its threads in their last bits.
    """
    world = pilot.replica.world
    flux = np.zeros((MAPS, len(world.lights.names)))
    if world.paths:
        light_of_path = set_out(pilot.replica, 0, world.paths).light.numpy()
        for number, part in enumerate(photons):
            light = light_of_path[part["id"] >> BOUNCE_BITS]
            flux[number] = np.bincount(light, part["flux"].mean(axis=1, dtype=np.float64), flux.shape[1])
    return flux


def _pilot_world(flat: FlatScene, features: Features, settings: RenderSettings) -> World:
    """One cell, and as many paths of each pass as the pilot has."""
    shines = bool(len(flat.lights.power)) and flat.lights.power.sum() > 0
    algorithm, media = settings.algorithm, calls_for_media(flat)
    wanted = algorithm.maps(settings)
    paths = PILOT_PATHS if shines and (wanted.indirect or (media and algorithm.shoots_photons)) else 0
    caustic = PILOT_PATHS if shines and calls_for_caustics(flat, features, settings) else 0
    return World(
        features=features,
        materials=flat.materials,
        textures=flat.textures,
        lights=flat.lights,
        media=flat.media,
        top_tree=TopTree(np.zeros(0, np.int32), np.zeros(0, np.float32)),
        extent=flat.extent,
        seed=settings.seed,
        max_depth=settings.max_depth,
        emission=pilot_emission(flat, aimed=caustic > 0),
        global_map=MapPlan(paths, read=wanted.indirect),
        caustic_map=MapPlan(caustic),
        volume_map=MapPlan(paths if media and wanted.volume else 0),
        volume_unit=1.0,
        unit=flat.unit,
        irradiance=IrradiancePlan(IRRADIANCE_SHARE if settings.final_gathers else 0.0),
    )


def view_of(flat: FlatScene, settings: RenderSettings, workers: int) -> View:
    """What the camera adds.

    Args:
        workers: how many will share the work; 0 and 1 are alike.
    """
    return View(
        camera=flat.camera,
        seed=settings.seed,
        spp=settings.spp,
        light_samples=light_samples_of(flat, settings),
        max_depth=settings.max_depth,
        k=settings.k,
        caustic_k=settings.caustic_k,
        volume_samples=settings.volume_samples,
        bucket=settings.bucket or _bucket(flat, settings, max(workers, 1)),
        diffuse_light=settings.algorithm.diffuse_light(settings),
        cache=_cache_plan(settings, flat.camera),
        routing=settings.routing,
    )


def _bucket(flat: FlatScene, settings: RenderSettings, workers: int) -> int:
    """Side of a bucket [pixels]: the paper's 32, or doubled while that leaves enough of them for all workers.

    What the interpreter does for a bucket it does once, however many samples there are; kernels take what they take.
    """
    shadow_rays = -(-settings.spp // settings.passes) * light_samples_of(flat, settings)
    pixels = flat.camera.width * flat.camera.height
    side = BUCKET_LEAST
    while side < BUCKET_MOST:
        larger = 2 * side
        if larger * larger * shadow_rays > BUCKET_SHADOW_RAYS:
            break
        if pixels < BUCKETS_A_WORKER * workers * larger * larger:
            break
        side = larger
    return side


def _cache_plan(settings: RenderSettings, camera: Camera) -> CachePlan:
    if not settings.algorithm.has_irradiance_cache(settings):
        return NO_CACHE
    side = max(camera.width, camera.height)
    least = min(CACHE_PLAN.least, max(1.0, RECORD_LEAST * side))
    return replace(CACHE_PLAN, least=least, most=max(least, RECORD_REACH * side))


def _irradiance_plan(settings: RenderSettings, plans: Sequence[MapPlan]) -> IrradiancePlan:
    if not settings.final_gathers or not plans[GLOBAL_MAP].paths:
        return IrradiancePlan()
    return IrradiancePlan(IRRADIANCE_SHARE, settings.k, IRRADIANCE_REACH * plans[GLOBAL_MAP].radius)


def _fly_pilot(pilot: CellWorker) -> None:
    """Trace the pilot's paths."""
    paths = pilot.replica.world.paths
    if paths:
        pilot.start(PhotonTask(number=0, start=0, stop=paths))


def _by_map(photons: Arrays) -> list[Arrays]:
    """The pilot's photons of each map, in order."""
    return [_in_order(take(photons, np.flatnonzero(photons["map"] == number))) for number in range(MAPS)]


def map_plans(
    pilot: CellWorker, photons: Sequence[Arrays], settings: RenderSettings, flat: FlatScene
) -> tuple[MapPlan, MapPlan, MapPlan]:
    """Paths and radius of the global, the caustic and the volume map."""
    world, cell, extent, unit = pilot.replica.world, pilot.cells[0], flat.extent, flat.unit
    area = float(triangle_areas(flat.triangles.positions).sum())
    stored = [len(part["id"]) for part in photons]
    asked = [settings.photons, settings.caustic_photons, settings.volume_photons if world.volume_map.paths else 0]
    wanted = [
        min(math.ceil(a * PILOT_PATHS / s), PATHS_A_PHOTON * a) if s else PATHS_A_PHOTON * a
        for a, s in zip(asked, stored, strict=True)
    ]
    paths = max(wanted[GLOBAL_MAP] if stored[GLOBAL_MAP] else 0, wanted[VOLUME_MAP] if stored[VOLUME_MAP] else 0)
    caustic_paths = wanted[CAUSTIC_MAP]
    every = [paths, caustic_paths if world.caustic_map.paths else 0, paths if world.volume_map.paths else 0]
    expected = [s * p / PILOT_PATHS for s, p in zip(stored, every, strict=True)]
    radii = [
        _given(settings.radius, unit)
        or _gather_radius(cell, photons[GLOBAL_MAP], settings.k, expected[GLOBAL_MAP], extent),
        _given(settings.caustic_radius, unit)
        or _gather_radius(cell, photons[CAUSTIC_MAP], settings.caustic_k, expected[CAUSTIC_MAP], extent),
        _given(settings.volume_radius, unit) or _beam_radius(photons[VOLUME_MAP], expected[VOLUME_MAP], extent),
    ]
    plans = [
        MapPlan(p, r, settings.band * r, old.read, _point_area(area, r, e))
        for p, r, e, old in zip(every, radii, expected, world.maps, strict=True)
    ]
    return plans[0], plans[1], plans[2]


def _given(length: float | None, unit: float) -> float | None:
    """A length that a person gave in the scene's unit, in the renderer's."""
    return None if length is None else length / unit


def _beam_radius(photons: Arrays, expected: float, extent: float) -> float:
    """The radius of beams: that of a ball about the median volume photon that holds BEAM_K photons."""
    position = photons["position"]
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


def _volume_unit(photons: Arrays, plan: MapPlan, flat: FlatScene) -> float:
    """The unit of exact sums along beams, from the strongest photon of the pilot with room above."""
    largest = float(photons["flux"].max(initial=0.0)) * BEAM_HEADROOM
    if largest == 0:
        return 1.0
    return sum_unit(largest, plan.radius, float(np.abs(flat.media.g).max(initial=0.0)))


def _in_order(photons: Arrays) -> Arrays:
    """Photons by number: those that had to wait for room are stored later, and who waits depends on the threads."""
    order = np.argsort(photons["id"])
    return {name: column[order] for name, column in photons.items()}


def _gather_radius(cell: Cell, photons: Arrays, k: int, expected: float, extent: float) -> float:
    """A gather radius from the density of the pilot's photons, scaled to the number expected."""
    position, normal = photons["position"], photons["normal"]
    if len(position) <= PILOT_K:
        return extent / 16.0  # next to nothing lands: any radius of the scene's order serves
    launcher = cell.replica.launcher
    device = launcher.device
    queries = np.linspace(0, len(position) - 1, min(PILOT_GATHERS, len(position))).astype(np.intp)
    pilot_map = photon_map.build(
        position, np.ones_like(position), normal, normal, np.arange(len(position), dtype=np.int64), device=device
    )
    at = wp.array(position[queries], dtype=wp.vec3, device=device)
    facing = wp.array(normal[queries], dtype=wp.vec3, device=device)
    count = len(queries)
    found = wp.empty(count, dtype=wp.float32, device=device)
    launcher(
        gather_kernel,
        count,
        photons=pilot_map,
        position=at,
        normal=facing,
        shading_normal=facing,
        k=PILOT_K,
        r_max=extent,
        run=1,
        irradiance_out=wp.empty(count, dtype=wp.vec3, device=device),
        count_out=wp.empty(count, dtype=wp.int32, device=device),
        radius_out=found,
        truncated_out=wp.empty(count, dtype=wp.bool, device=device),
    )
    radius = float(np.quantile(found.numpy(), RADIUS_QUANTILE))
    # Photons on a surface: as many times denser, as many times less area for the same number.
    denser = expected / len(position)
    return RADIUS_MARGIN * radius * math.sqrt(k / PILOT_K / denser)


def _point_area(area: float, radius: float, photons: float) -> float:
    """The area that a surface point stands for, of a map of so many photons on a scene of that area."""
    wanted = max(POINTS_A_PHOTON * photons, POINTS_A_DISC * area / (math.pi * radius**2), POINTS_LEAST)
    return area / min(wanted, POINTS_MOST)


def photons_in_cells(position: NDArray[np.float32], tree: TopTree) -> NDArray[np.int64]:
    """How many points lie in each cell, shape [cells]."""
    node = np.zeros(len(position), np.intp)
    inner = len(tree.axis)
    while inner and (node < inner).any():
        at = np.minimum(node, inner - 1)
        left = position[np.arange(len(position)), tree.axis[at]] < tree.split[at]
        node = np.where(node < inner, np.where(left, 2 * node + 1, 2 * node + 2), node)
    return np.bincount(node - inner, minlength=tree.cells)


def cells_of(holders: Sequence[int], worker: int) -> list[int]:
    """The cells that a worker holds."""
    return [cell for cell, holder in enumerate(holders) if holder == worker]
