"""The photon pilot: a fixed number of photon paths, flown in one cell, whatever the cluster.

What it stores tells how many paths bring the photons that are asked for, and where they lie.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays, take
from wdpm.cluster.plan.effects import calls_for_caustics
from wdpm.cluster.plan.light_shares import pilot_emission
from wdpm.cluster.plan.pilot_gathers import AmongPhotons
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.cluster.task import PhotonTask
from wdpm.cluster.work.cell import Cell
from wdpm.cluster.work.photon_home import emitted_photons
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import MapPlan, TopTree, World
from wdpm.kernels.features import Features
from wdpm.kernels.launch import Launcher
from wdpm.kernels.limits import MAPS
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP, VOLUME_MAP
from wdpm.kernels.photons.flight import BOUNCE_BITS
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.material_table import MaterialTable
from wdpm.scenes.flat.used_media import calls_for_media

PILOT_PATHS = 1 << 15
"""Paths of the pilot, at most: its stored photons tell paths per photon to about half a percent, in some 50 ms."""

LEAST_PATHS = 1 << 13
SAMPLES_A_PATH = 32
"""Camera samples of a pass for each path of its pilot, which has so many paths at least: with all that is flown like it
they take a twentieth of what the samples do, and few samples call for no more exact a plan than that."""

ENOUGH = 256
"""Photons of a map that are told apart from none: their number is known to a sixteenth. Where a shorter pilot stores
fewer, as many paths are flown as should do."""

ENOUGH_OF_FAINT = 16
"""The same of the global map, where indirect light is faint beside what samples leave. Of a bunny, gold and glass under
the sky (256x256, one and two samples, four seeds) images took 0.94 of the CPU time for it, with the same error."""

PATHS_OF_PAGES = 1 << 9
"""Paths that are traced together where triangles lie in files: all of them look at nearly every page of ten million."""

TRIAL_PATHS = 16
"""Paths that tell first how long paths are in a scene with media."""

PILOT_PHOTONS_MOST = 1 << 21
"""Photons that a pilot in media may store, about: where they scatter without end its paths are fewer. A path in white
fog that fills all space stores 65,535, and all of the pilot's would take many minutes and more memory than there is.
Two million take seconds, and tell more of where photons lie than the half million of a room's pilot."""

DIRECT_PATHS = 1 << 13
"""Paths that tell where light straight from the lights falls, where the pilot's photons do not."""


@dataclass(frozen=True, eq=False)
class PhotonPilot:
    """What the pilot's paths stored.

    Attributes:
        settings: of the render that it was flown for.
        paths: of each pass, if any were.
        worker: of one cell that is the whole scene.
        photons: of each map, by the numbers of kernels.photons.deposits, in the order of the photons' own.
        left: second moment of its paths' use, of that unsteered (plan.steering); 1 where photons are not to be steered,
            None where that is not known yet.
        caustics_left: the same of what paths of the caustic pass store.
    """

    settings: RenderSettings
    paths: int
    worker: CellWorker
    photons: list[Arrays]
    left: float | None = None
    caustics_left: float = 1.0
    _trees: dict[int, AmongPhotons] = field(default_factory=dict, init=False, repr=False)
    _flux: list[NDArray[np.float64]] = field(default_factory=list, init=False, repr=False)
    _direct: list[tuple[Arrays, int]] = field(default_factory=list, init=False, repr=False)

    def among(self, number: int) -> AmongPhotons:
        """The photons of a map of surfaces, to be gathered from: several look for their neighbours, in one tree."""
        if number not in self._trees:
            self._trees[number] = AmongPhotons(self.cell, self.photons[number])
        return self._trees[number]

    @property
    def world(self) -> World:
        """That its paths were traced in."""
        return self.worker.replica.world

    @property
    def cell(self) -> Cell:
        """The whole scene."""
        return self.worker.cells[0]

    def as_it_is(self) -> PhotonPilot:
        """The same, once it is known that its photons are not to be steered."""
        known = replace(self, left=1.0)
        known._trees.update(self._trees)
        known._flux.extend(self._flux)
        known._direct.extend(self._direct)
        return known

    def light_of_path(self) -> NDArray[np.int32]:
        """Which light each path comes from, shape [paths of all passes]."""
        return _light_of_path(self.worker)

    def flux_by_light(self) -> NDArray[np.float64]:
        """Flux that the pilot's photons of each light brought into each map, shape [MAPS, lights].

        Added in the order of the photons' numbers: what a cell sums up depends on its threads in the last bits.
        """
        if not self._flux:
            self._flux.append(self._measured_flux())
        return self._flux[0]

    def _measured_flux(self) -> NDArray[np.float64]:
        world = self.world
        flux = np.zeros((MAPS, len(world.lights.names)))
        if world.paths:
            light_of_path = self.light_of_path()
            for number, part in enumerate(self.photons):
                light = light_of_path[part["id"] >> BOUNCE_BITS]
                flux[number] = np.bincount(light, part["flux"].mean(axis=1, dtype=np.float64), flux.shape[1])
        return flux


def worker_without_photons(
    flat: FlatScene, features: Features, settings: RenderSettings, launcher: Launcher
) -> CellWorker:
    """A worker of one cell that is the whole scene, in a world without photons."""
    world = _pilot_world(flat, features, replace(settings, integrator=Integrator.PATH), 0)
    return CellWorker(0, world, {0: flat.triangles}, [0], launcher)


def fly_pilot(
    flat: FlatScene,
    features: Features,
    settings: RenderSettings,
    launcher: Launcher,
    worker: CellWorker | None = None,
    *,
    is_faint: bool = False,
) -> PhotonPilot:
    """Trace the pilot's paths, if light comes by photons.

    Args:
        worker: that has the whole scene in one cell already; None to make one.
        is_faint: whether what the global map gets wrong is not seen beside the samples.
    """
    of_each = first_paths(flat, settings)
    world = _pilot_world(flat, features, settings, of_each)
    if worker is None:
        worker = CellWorker(0, world, {0: flat.triangles}, [0], launcher)
    else:
        worker.adopt(world)
    if calls_for_media(flat):
        if world.global_map.paths:
            of_each = _affordable_paths(worker, world)
            worker.adopt(with_paths(world, of_each))
        photons = flown_photons(worker)
    else:
        photons, of_each = _flown_until_enough(worker, world, of_each, ENOUGH_OF_FAINT if is_faint else ENOUGH)
    flat.triangles.let_go()
    return PhotonPilot(settings, of_each, worker, photons)


def first_paths(flat: FlatScene, settings: RenderSettings) -> int:
    """Paths that are flown first, a power of two: by the samples of a pass, of whose price they are to be a part."""
    if calls_for_media(flat):  # how long paths are is seen first
        return PILOT_PATHS
    samples = flat.camera.width * flat.camera.height * settings.samples_of_pass
    wanted = 1 << max(samples // SAMPLES_A_PATH, 1).bit_length() - 1
    return min(PILOT_PATHS, max(LEAST_PATHS, wanted))


def with_paths(world: World, of_each: int) -> World:
    """The world with so many paths for each map that there is."""
    maps = [replace(each, paths=of_each) if each.paths else each for each in world.maps]
    return replace(world, global_map=maps[GLOBAL_MAP], caustic_map=maps[CAUSTIC_MAP], volume_map=maps[VOLUME_MAP])


def _flown_until_enough(
    worker: CellWorker, world: World, paths: int, enough_of_global: int
) -> tuple[list[Arrays], int]:
    """As flown_photons, and by how many paths of each pass: if those of the worker's world store too few, by more."""
    while paths < PILOT_PATHS:
        stored, enough = _fewest_stored(worker, enough_of_global)
        if stored >= enough:
            return _by_map(worker.cells[0].store.so_far()), paths
        times = -(-enough // max(stored, 1))
        paths = min(PILOT_PATHS, paths << (times - 1).bit_length())
        worker.adopt(with_paths(world, paths))
    return flown_photons(worker), paths


def _fewest_stored(worker: CellWorker, enough_of_global: int) -> tuple[int, int]:
    """Trace the worker's paths, and count the photons of the first map that has too few; and how many would do.

    Photons of one pass come to one map. Those of the global pass are traced first, and if they are too few no others.
    """
    maps, store, flown = worker.replica.world.maps, worker.cells[0].store, 0
    for number, enough in ((GLOBAL_MAP, enough_of_global), (CAUSTIC_MAP, ENOUGH)):
        if not maps[number].paths:
            continue
        _fly(worker, flown + maps[number].paths, flown)
        flown += maps[number].paths
        stored = int(np.count_nonzero(store.so_far()["map"] == number))
        if stored < enough:
            return stored, enough
    return ENOUGH, ENOUGH


def flown_again(flat: FlatScene, world: World, pilot: PhotonPilot, left: float, caustics_left: float) -> PhotonPilot:
    """The pilot in a world in which photons are shared out and steered as they are to be, which leaves so much."""
    pilot.worker.adopt(world)
    photons = flown_photons(pilot.worker)
    flat.triangles.let_go()
    return PhotonPilot(pilot.settings, pilot.paths, pilot.worker, photons, left, caustics_left)


def _affordable_paths(worker: CellWorker, world: World) -> int:
    """Paths of the pilot, all of them unless a few have stored too many photons; the few are flown, and forgotten."""
    trial = min(TRIAL_PATHS, world.global_map.paths)
    stored = len(_photons_of(worker, trial)["id"])
    most = PILOT_PHOTONS_MOST * trial // max(stored, 1)
    return min(PILOT_PATHS, max(most, trial))


def _photons_of(worker: CellWorker, paths: int) -> Arrays:
    """What the first paths store."""
    _fly(worker, paths)
    return worker.cells[0].store.so_far()


def _fly(worker: CellWorker, paths: int, first: int = 0) -> None:
    """Trace the first paths; some at a time where the cell lets go of the pages that each batch has looked at.

    Args:
        first: of those that are yet to be traced.
    """
    at_once = PATHS_OF_PAGES if worker.cells[0].lets_go else max(paths, 1)
    for start in range(first, paths, at_once):
        worker.start(PhotonTask(number=0, start=start, stop=min(start + at_once, paths)))


def pilot_for(
    flat: FlatScene, features: Features, settings: RenderSettings, launcher: Launcher, before: PhotonPilot | None
) -> PhotonPilot:
    """The pilot of a render: the one that was flown before if photons fly alike in both, or else another.

    Args:
        before: a pilot of the same scene, whose worker goes on as that of this render; None if there was none.
    """
    if before is None:
        return fly_pilot(flat, features, settings, launcher)
    if _flies_by(before.settings) != _flies_by(settings):
        return fly_pilot(flat, features, settings, launcher, before.worker)
    if before.world.features != features:  # that camera rays alone know of
        before.worker.adopt(replace(before.world, features=features))
    return before


def _flies_by(settings: RenderSettings) -> tuple[object, ...]:
    """What photons of a pilot depend on besides the scene."""
    algorithm = settings.algorithm
    return settings.seed, settings.max_depth, settings.unsteered, algorithm.maps(settings), algorithm.shoots_photons


def direct_photons(pilot: PhotonPilot) -> tuple[Arrays, int]:
    """Photons straight from the lights, of which no map has any, and how many paths they are of; flown once."""
    if not pilot._direct:
        paths = min(DIRECT_PATHS, pilot.world.global_map.paths or pilot.paths)
        pilot._direct.append((photons_with_direct(pilot.world, pilot, paths, 1), paths))
    return pilot._direct[0]


def photons_with_direct(world: World, pilot: PhotonPilot, paths: int, bounces: int) -> Arrays:
    """Photons of some paths of the global pass in a world, those straight from the lights too.

    Args:
        bounces: places that a path comes to, at most.
    """
    straight = replace(
        world,
        max_depth=1 + bounces,
        global_map=MapPlan(paths),
        caustic_map=MapPlan(0),
        volume_map=MapPlan(0),
        stores_direct=True,
    )
    with in_world(straight, pilot) as worker:
        return flown_photons(worker)[GLOBAL_MAP]


def caustic_photons_among(
    materials: MaterialTable, pilot: PhotonPilot, paths: int, seed: int | None = None
) -> tuple[Arrays, NDArray[np.int32]]:
    """Caustic photons of some paths, were the materials others, and which light each of them comes from.

    Args:
        seed: of their random numbers; None for that of the pilot.
    """
    alone = replace(pilot.world, global_map=MapPlan(0), caustic_map=MapPlan(paths), volume_map=MapPlan(0))
    other = replace(alone, materials=materials, seed=pilot.world.seed if seed is None else seed)
    with in_world(other, pilot) as worker:
        photons = flown_photons(worker)[CAUSTIC_MAP]
        return photons, _light_of_path(worker)[photons["id"] >> BOUNCE_BITS]


@contextmanager
def in_world(world: World, pilot: PhotonPilot) -> Iterator[CellWorker]:
    """The pilot's worker in another world, for as long as the context lasts."""
    worker, before = pilot.worker, pilot.world
    worker.adopt(world)
    try:
        yield worker
    finally:
        worker.adopt(before)


def flown_photons(worker: CellWorker) -> list[Arrays]:
    """Photons of each map that all paths of the worker's world store."""
    return _by_map(_photons_of(worker, worker.replica.world.paths))


def _light_of_path(worker: CellWorker) -> NDArray[np.int32]:
    """Which light each path of the worker's world comes from. They are emitted once more: no photon tells."""
    world = worker.replica.world
    if len(world.lights.names) == 1:
        return np.zeros(world.paths, np.int32)
    light: NDArray[np.int32] = emitted_photons(worker.replica, 0, world.paths).light.numpy()
    return light


def _pilot_world(flat: FlatScene, features: Features, settings: RenderSettings, of_each: int) -> World:
    """One cell, and `of_each` paths of each pass that there is."""
    shines = bool(len(flat.lights.power)) and flat.lights.power.sum() > 0
    algorithm, media = settings.algorithm, calls_for_media(flat)
    wanted = algorithm.maps(settings)
    paths = of_each if shines and (wanted.indirect or (media and algorithm.shoots_photons)) else 0
    caustic = of_each if shines and calls_for_caustics(flat, features, settings) else 0
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
    )


def _by_map(photons: Arrays) -> list[Arrays]:
    """The pilot's photons of each map, in order."""
    return [_in_order(take(photons, np.flatnonzero(photons["map"] == number))) for number in range(MAPS)]


def _in_order(photons: Arrays) -> Arrays:
    """Photons by number: those that had to wait for room are stored later, and who waits depends on the threads."""
    order = np.argsort(photons["id"])
    return {name: column[order] for name, column in photons.items()}
