"""From a scene and settings to a World: the pilot, the number of paths, the gather radius, the top tree.

Everything that an image depends on is decided here from the whole scene by a computation that is the same whatever the
cluster: a fixed pilot of photon paths in one cell. The top tree and who holds which cell come from the cluster's size,
and the image does not depend on them.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.allotment import NO_LAMP_OUTLINES, LampOutlines, lamp_outlines_of
from wdpm.cluster.lit_places import LitPlaces
from wdpm.cluster.plan.caustics.guide import CausticsLearnt, learn_caustics
from wdpm.cluster.plan.copies import TRIANGLE_BYTES
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.forecast.sight import NO_SIGHT, Sight, sight_of
from wdpm.cluster.plan.forecast.work import work_of
from wdpm.cluster.plan.light_guide import Learnt, learn_guide, with_guide
from wdpm.cluster.plan.lit_places import lit_places
from wdpm.cluster.plan.map_plans import MapPlans, band_of_walls, irradiance_plan, map_plans, volume_unit
from wdpm.cluster.plan.partition import instances_of_cells, outlines_of, places_to_cut, rows_of_cells
from wdpm.cluster.plan.photon_pilot import PhotonPilot, pilot_for
from wdpm.cluster.plan.record_worth import RecordWorth, SampleNoise, records_in_words, worth_of_records
from wdpm.cluster.plan.steering.pilot import emission_of, steered_pilot, steering_in_words
from wdpm.cluster.plan.top_tree import build_top_tree, cells_seen, photons_in_cells
from wdpm.cluster.plan.view import view_of
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.work.cell import Cell
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import TopTree, View, World
from wdpm.kernels.camera.outlines import outlined_pixels
from wdpm.kernels.camera.pixel_filter import placed_by
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP, VOLUME_MAP
from wdpm.kernels.photons.gather_settings import check_settings
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.flatten import FlatScene

SOME_PLACES = 4096
"""Places of photons at most, where a few thousand tell enough."""


@dataclass(frozen=True, eq=False)
class WorldPlan:
    """What photons depend on, and who holds what.

    Attributes:
        rows: the triangles of each cell, rows of the flat scene.
        instances: the instances of each cell.
        burdens: what each cell weighs: its shares of all triangles and of all photons.
        pilot_photons: places of the pilot's photons, float32, shape [P, 3].
    """

    world: World
    rows: list[NDArray[np.intp]]
    instances: list[NDArray[np.intp]]
    burdens: tuple[float, ...]
    pilot_photons: NDArray[np.float32]

    def some_places(self) -> NDArray[np.float32]:
        """Of photons, which tell how they lie in space, shape [P, 3]."""
        return self.pilot_photons[:: len(self.pilot_photons) // SOME_PLACES + 1]

    def share_of(self, cell: int, triangles: Triangles) -> float:
        """What a cell holds of the scene's triangles and instances."""
        return (len(self.rows[cell]) + len(self.instances[cell])) / (len(triangles) + len(triangles.instances))


@dataclass(frozen=True, eq=False, kw_only=True)
class RenderPlan(WorldPlan):
    """What is decided before any work is handed out.

    Attributes:
        pilot: the pilot's one-cell worker, to be used again, where there is but one cell; otherwise None, since it
            holds the whole scene.
        learnt: how the view's shadow rays choose among lights.
        caustics: where its paths go on to find caustics.
        caustic_k: photons that gathers of the caustic map look for.
        records: how good irradiance records are to be.
        lit_places: that light comes to straight from the lights.
        outlines: pixels that outlines of lamps cross.
        sight: the cell that pixels of a grid see, as Session has it.
        chose: what was decided by what photon maps and irradiance records are worth, and why.
    """

    pilot: CellWorker | None
    learnt: Learnt
    caustics: CausticsLearnt
    caustic_k: int
    records: RecordWorth
    lit_places: LitPlaces
    outlines: LampOutlines
    sight: NDArray[np.int32]
    chose: tuple[str, ...]

    def learnt_view(self, view: View) -> View:
        """The view, with what the pilot has taught."""
        cache = self.records.plan(view.cache)
        known = replace(view, caustic_k=self.caustic_k, cache=cache, lit_places=self.lit_places, outlines=self.outlines)
        return with_guide(replace(known, caustic_guide=self.caustics.guide), self.learnt)


def make_render_plan(
    flat: FlatScene,
    settings: RenderSettings,
    workers: int,
    launcher: Launcher,
    cells: int | None = None,
    pilot: PhotonPilot | None = None,
    learnt: Learnt | None = None,
    caustics: CausticsLearnt | None = None,
    seen: SampleNoise | None = None,
) -> RenderPlan:
    """Decide what an image depends on, and who will compute what.

    Args:
        workers: how many will share the work; 0 and 1 are alike.
        cells: a power of two; None for the least that gives every worker the like.
        pilot: that was flown to decide on settings.
        learnt: how shadow rays choose among lights, if that was learnt to decide on settings.
        caustics: where paths go on to find caustics, likewise.
        seen: the noise of samples, likewise.
    """
    view = view_of(flat, settings, workers)
    pilot = steered_pilot(flat, pilot_for(flat, features_of(flat, settings), settings, launcher, pilot), view)
    planned = map_plans(pilot, settings, flat)
    for each in planned.maps:
        check_settings(settings.k, each.radius)
    wanted = max(workers, 1) if cells is None else cells
    sight = sight_of(flat, pilot.cell, view) if wanted > 1 else NO_SIGHT
    decided = _world_plan(flat, settings, pilot, planned, sight, view, launcher, wanted)
    tree = decided.world.top_tree
    pilot.worker.forget_photons()
    if learnt is None:
        learnt = learn_guide(flat, pilot.cell, view, settings.samples_of_pass)
    if caustics is None:
        caustics = learn_caustics(flat, settings, view, pilot)
    lit = lit_places(pilot, view.cache, settings.samples_of_pass)
    outlines = lamp_outlines(flat, pilot.cell)
    records = worth_of_records(flat, pilot, settings, learnt, view.cache, seen)
    words = (
        steering_in_words(pilot),
        records_in_words(records.tolerance, view.cache),
        _outlines_in_words(outlines),
        caustics.words,
    )
    flat.triangles.let_go()
    return RenderPlan(
        **vars(decided),
        pilot=pilot.worker if tree.cells == 1 else None,
        learnt=learnt,
        caustics=caustics,
        caustic_k=planned.caustic_k,
        records=records,
        lit_places=lit,
        outlines=outlines,
        sight=cells_seen(sight.position, sight.seen, tree),
        chose=(*planned.chose, *itertools.chain(*words)),
    )


def _world_plan(
    flat: FlatScene,
    settings: RenderSettings,
    pilot: PhotonPilot,
    planned: MapPlans,
    sight: Sight,
    view: View,
    launcher: Launcher,
    wanted: int,
) -> WorldPlan:
    """What photons depend on, and who holds what.

    Args:
        sight: what the camera sees, where the scene is cut.
        wanted: cells, at least.
    """
    irradiance = irradiance_plan(pilot, settings, planned)
    # What lies within reach of a cell is estimated there too, from the photons about it.
    of_surfaces = [replace(each, band=each.band + irradiance.reach) for each in planned.maps[:VOLUME_MAP]]
    maps = (of_surfaces[GLOBAL_MAP], of_surfaces[CAUSTIC_MAP], planned.maps[VOLUME_MAP])
    places = np.concatenate([part["position"] for part in pilot.photons])
    band = max((each.band for each in maps if each.paths), default=maps[0].band)
    tree = _top_tree(flat, settings, pilot, sight, view, band, (wanted - 1).bit_length(), wanted)
    rows, instances = _held(flat, tree, 0.0, launcher)
    tree = replace(tree, outlines=outlines_of(flat.triangles, tree, rows, instances, flat.extent))
    if irradiance.share and tree.cells > 1:
        rows, instances = _held(flat, tree, band_of_walls(irradiance, maps[GLOBAL_MAP]), launcher)
    world = replace(
        pilot.world,
        top_tree=tree,
        global_map=maps[0],
        caustic_map=maps[1],
        volume_map=maps[2],
        emission=emission_of(pilot),
        volume_unit=volume_unit(pilot.photons, maps[VOLUME_MAP], flat),
        irradiance=irradiance,
        strict=settings.strict,
    )
    held = [len(r) + len(i) for r, i in zip(rows, instances, strict=True)]
    burdens = np.array(held, np.float64) / (len(flat.triangles) + len(flat.triangles.instances))
    if len(places):
        burdens += photons_in_cells(places, tree) / len(places)
    return WorldPlan(world, rows, instances, tuple(float(burden) for burden in burdens), places)


def _held(
    flat: FlatScene, tree: TopTree, band: float, launcher: Launcher
) -> tuple[list[NDArray[np.intp]], list[NDArray[np.intp]]]:
    """The triangles and the instances of each cell and of a band about it."""
    rows = rows_of_cells(flat.triangles.positions, tree, flat.extent, launcher, band)
    return rows, instances_of_cells(flat.triangles.instances, tree, flat.extent, band)


def _top_tree(
    flat: FlatScene,
    settings: RenderSettings,
    pilot: PhotonPilot,
    sight: Sight,
    view: View,
    band: float,
    levels: int,
    workers: int,
) -> TopTree:
    """Cells of 2^levels, cut by what is expected of the view where there are several."""
    if not levels:
        return pilot.world.top_tree
    weighed, places = places_to_cut(flat.triangles), np.concatenate([part["position"] for part in pilot.photons])
    stored = settings.photons + settings.caustic_photons + settings.volume_photons if len(places) else 0
    every = len(flat.triangles) + len(flat.triangles.instances)
    work = work_of(sight, places, pilot.world, view, stored, TRIANGLE_BYTES * every / max(len(weighed), 1))
    return build_top_tree(weighed, places, band, levels, workers, work)


def lamp_outlines(flat: FlatScene, cell: Cell) -> LampOutlines:
    """Pixels that outlines of lamps cross.

    Args:
        cell: the whole scene, whose replica has the view.
    """
    camera, lit = flat.camera, flat.lights.power[: len(flat.lights.prim)] > 0
    if not lit.any():
        return NO_LAMP_OUTLINES
    corners, radius = flat.lights.corners[lit], placed_by(camera.filter).radius
    pixels = outlined_pixels(corners, cell.replica.camera, radius, cell.geometry, len(flat.materials))
    width, height = camera.full_size or (camera.width, camera.height)
    return lamp_outlines_of(pixels, width, height, camera.crop or (0, 0, width, height))


def _outlines_in_words(outlines: LampOutlines) -> tuple[str, ...]:
    if not len(outlines):
        return ()
    return (f"{len(outlines):,} pixels on outlines of lamps take {outlines.times} times the samples of others",)
