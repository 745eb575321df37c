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

from wdpm.cluster.batch import Arrays
from wdpm.cluster.cell import Cell
from wdpm.cluster.partition import deal, rows_of_cells
from wdpm.cluster.task import PhotonTask
from wdpm.cluster.top_tree import build_top_tree
from wdpm.cluster.worker import Worker
from wdpm.cluster.world import Lights, Materials, TopTree, View, World
from wdpm.kernels import photon_map
from wdpm.kernels.gather import check_settings, gather_kernel
from wdpm.kernels.launch import Launcher
from wdpm.kernels.lights import triangle_areas
from wdpm.kernels.settings import RenderSettings
from wdpm.scenes.geometry import FlatScene, Triangles

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
    pilot: Worker | None
    pilot_photons: NDArray[np.float32]


def light_elements(flat: FlatScene) -> Lights:
    """All that emits in a scene, one element a row."""
    emitting = np.flatnonzero(flat.triangles.emitter >= 0)
    corners = _facing_front(flat.triangles, emitting)
    emitter = flat.triangles.emitter[emitting]
    radiance = flat.emitter_radiance[emitter].reshape(-1, 3)
    triangle_power = math.pi * triangle_areas(corners) * radiance.mean(axis=1, dtype=np.float64)
    point_power = 4.0 * math.pi * flat.point_intensity.mean(axis=1, dtype=np.float64)
    return Lights(
        corners=corners,
        triangle_radiance=radiance,
        triangle_light=emitter.astype(np.int32),
        point_position=flat.point_position,
        point_intensity=flat.point_intensity,
        point_light=(len(flat.emitter_radiance) + np.arange(len(flat.point_position))).astype(np.int32),
        power=np.concatenate([triangle_power, point_power]),
        names=flat.light_names,
    )


def _facing_front(triangles: Triangles, rows: NDArray[np.intp]) -> NDArray[np.float32]:
    """Corners of triangles, wound so that their geometric normals agree with their vertex normals, as surfaces do."""
    corners = triangles.positions[rows].copy()
    p = corners.astype(np.float64)
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    against = np.einsum("ij,ij->i", normal, triangles.normals[rows].sum(axis=1, dtype=np.float64)) < 0
    corners[against] = corners[against][:, [0, 2, 1]]
    return corners


def make_plan(
    flat: FlatScene, settings: RenderSettings, workers: int, launcher: Launcher, cells: int | None = None
) -> Plan:
    """Decide what an image depends on, and who will compute what.

    Args:
        workers: how many will share the work; 0 and 1 are alike.
        cells: a power of two; None for the least that gives every worker the like.
    """
    alone = World(
        materials=Materials(flat.reflectance, flat.texture, flat.twosided.astype(np.int32)),
        textures=flat.textures,
        lights=light_elements(flat),
        emitter_radiance=flat.emitter_radiance,
        top_tree=TopTree(np.zeros(0, np.int32), np.zeros(0, np.float32)),
        extent=flat.extent,
        seed=settings.seed,
        max_depth=settings.max_depth,
        paths=0,
        radius=1.0,
        point_area=1.0,
        band=1.0,
    )
    pilot = Worker(0, alone, {0: flat.triangles}, [0], launcher)
    cell = pilot.cells[0]
    stored = _fly_pilot(pilot, settings)
    paths = math.ceil(settings.photons * PILOT_PATHS / stored) if stored else 0
    photons = _in_order(cell.photons_so_far())
    radius = settings.radius or _gather_radius(cell, photons, settings, flat.extent)
    check_settings(settings.k, radius)
    band = settings.band * radius
    wanted = max(workers, 1) if cells is None else cells
    levels = (wanted - 1).bit_length()
    tree = build_top_tree(flat.triangles.positions, photons["position"], band, levels, wanted)
    area = _point_area(flat.triangles.positions, radius, settings)
    world = replace(alone, top_tree=tree, paths=paths, radius=radius, point_area=area, band=band)
    rows = rows_of_cells(flat.triangles.positions, tree, flat.extent, launcher)
    burdens = np.array([len(r) for r in rows], np.float64) / len(flat.triangles)
    if stored:
        burdens += photons_in_cells(photons["position"], tree) / stored
    holders = deal(burdens, max(workers, 1))
    pilot.forget_photons()
    return Plan(world, rows, holders, pilot if tree.cells == 1 else None, photons["position"])


def view_of(flat: FlatScene, settings: RenderSettings) -> View:
    """What the camera adds."""
    return View(
        camera=flat.camera,
        seed=settings.seed,
        spp=settings.spp,
        light_samples=settings.light_samples,
        max_depth=settings.max_depth,
        k=settings.k,
        bucket=settings.bucket,
        routing=settings.routing,
    )


def _fly_pilot(pilot: Worker, settings: RenderSettings) -> int:
    """Trace the pilot's paths; the photons that they store."""
    lights = pilot.replica.world.lights
    if settings.photons == 0 or not len(lights.power) or lights.power.sum() <= 0:
        return 0
    pilot.start(PhotonTask(number=0, start=0, stop=PILOT_PATHS))
    return pilot.cells[0].photon_count


def _in_order(photons: Arrays) -> Arrays:
    """Photons by number: those that had to wait for room are stored later, and who waits depends on the threads."""
    order = np.argsort(photons["id"])
    return {name: column[order] for name, column in photons.items()}


def _gather_radius(cell: Cell, photons: Arrays, settings: RenderSettings, extent: float) -> float:
    """A gather radius from the density of the pilot's photons, scaled to the number asked for."""
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
    outputs = [wp.empty(count, dtype=t, device=device) for t in (wp.vec3, wp.int32, wp.float32, wp.bool)]
    launcher(gather_kernel, count, [pilot_map, at, facing, facing, PILOT_K, extent], [1, *outputs])
    radius = float(np.quantile(outputs[2].numpy(), RADIUS_QUANTILE))
    # Photons on a surface: as many times denser, as many times less area for the same number.
    denser = settings.photons / len(position)
    return RADIUS_MARGIN * radius * math.sqrt(settings.k / PILOT_K / denser)


def _point_area(corners: NDArray[np.float32], radius: float, settings: RenderSettings) -> float:
    """The area that a surface point stands for."""
    area = float(triangle_areas(corners).sum())
    wanted = max(POINTS_A_PHOTON * settings.photons, POINTS_A_DISC * area / (math.pi * radius**2), POINTS_LEAST)
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
