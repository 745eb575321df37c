"""From a scene to a session for a cluster; `results` makes an image of what comes of it."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from os import PathLike
from typing import Any, TypeAlias

import numpy as np

from wdpm.cluster.allotment import NO_ALLOTMENT, Allotment, allotment_by_noise
from wdpm.cluster.host_cache import HostCache, Share
from wdpm.cluster.host_memory import return_free_memory
from wdpm.cluster.layers import layers_of
from wdpm.cluster.plan.copies import SceneMemory, Sharing, largest_team, scene_memory
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.effects_in_words import effects_of, missing_effects
from wdpm.cluster.plan.photon_pilot import PILOT_PATHS
from wdpm.cluster.plan.render_plan import RenderPlan, make_render_plan
from wdpm.cluster.plan.view import view_of
from wdpm.cluster.progress import ProgressObserver
from wdpm.cluster.render_settings import CHANGE_NO_BIT, RenderSettings
from wdpm.cluster.session import Session
from wdpm.cluster.work import guards
from wdpm.cluster.work.replica import with_camera
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import MapPlan, PhotonPlan, View, World
from wdpm.devices import available_cores, check_device
from wdpm.images.limits import check_pixels
from wdpm.kernels.cached import cached_modules
from wdpm.kernels.compile import SECONDS_A_MODULE, ready_kernels
from wdpm.kernels.features import Features
from wdpm.kernels.launch import Launcher
from wdpm.progress import Progress
from wdpm.rendering.approximations import approximations, settings_without_effect, without_plain_geometry
from wdpm.rendering.automatic_settings import ChosenSettings, choose_settings
from wdpm.rendering.header import SceneHeader, header_of
from wdpm.rendering.spool import spooled
from wdpm.report.report import KernelReport
from wdpm.scenes.errors import GuardError, SceneError
from wdpm.scenes.flat.arrays import Triangles
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.flat.room import in_file, let_go
from wdpm.scenes.load import load
from wdpm.scenes.meshes.in_memory import Meshes
from wdpm.scenes.model.checks import check_scene
from wdpm.scenes.model.left_out import leave_out
from wdpm.scenes.model.scene import Scene
from wdpm.startup import let_collector_go

Source: TypeAlias = "Scene | str | PathLike[str] | Meshes | Callable[[], Scene]"
"""A scene, or how to get it: a file, a built-in scene's name, meshes of trimesh, or a function that is called once.

Whoever gives a function need not hold the scene while it is rendered, so the master can let go of what it has sent.
"""


@dataclass(eq=False)
class Prepared:
    """A scene that is ready to be rendered by a number of workers.

    Attributes:
        pilot: the worker that flew the pilot, to go on with where there is but one cell.
        identity: names what the bits of an image depend on, by part: scene, camera, settings. The same for any cluster.
        triangles: of the whole scene.
        kernels: what they were compiled for.
        dropped: triangles of the scene that cannot be rendered.
        chose: what was chosen where nobody said, and why.
        left_out: effects that the scene calls for, and that are left out knowingly.
        approximated: what is only approximated.
        seconds: by phase.
        lit_scene: names what irradiance records depend on: the scene without its camera, and its photons.
        header: what headers of its images say of the scene.
        uncompiled: features whose kernels others stand in for; first what the image is rendered with.
        lent: what slaves of this machine map of what the pilot was flown in; it is there as long as this.
        noise: of one sample of each pixel, as relMSE, as the trial that chose the integrator saw it; None without one.
    """

    pilot: CellWorker | None
    session: Session
    settings: RenderSettings
    triangles: int
    dropped: int
    kernels: KernelReport
    chose: tuple[str, ...]
    left_out: tuple[str, ...]
    approximated: tuple[str, ...]
    warnings: tuple[str, ...]
    seconds: dict[str, float]
    identity: dict[str, str]
    lit_scene: str
    header: SceneHeader
    uncompiled: tuple[Features, ...] = ()
    lent: Sequence[Any] = ()
    noise: float | None = None


OF_RECORDS = ("seed", "photons", "k", "radius", "caustic_photons", "caustic_k", "caustic_radius", "max_depth")
"""Settings that irradiance records depend on, which know of caustics that their rays have met."""

NO_PHOTONS = PhotonPlan(0, MapPlan(), MapPlan(), MapPlan(), 1.0)
"""Stands for any plan of photons: cells can be used again under another."""


def scene_of(source: Source) -> Scene:
    """The scene that a source stands for. Raises SceneError if it gives something else."""
    if isinstance(source, Scene):
        return source
    if not callable(source):
        return load(source)
    scene = source()
    if not isinstance(scene, Scene):
        raise SceneError(f"the function that was to give a scene gave {type(scene).__name__}; expected wdpm.Scene")
    return scene


def sound_scene_of(source: Source) -> Scene:
    """The same, once it is seen that it can be rendered: what a program has built nobody has looked at before.

    Raises:
        SceneError: see check_scene.
    """
    scene = scene_of(source)
    return check_scene(scene, drops=True) if isinstance(source, Scene) or callable(source) else scene


def prepare(
    source: Source,
    settings: RenderSettings,
    workers: int,
    launcher: Launcher,
    progress: Progress,
    cells: int | None = None,
    processes: int = 1,
    team: Callable[[SceneMemory], Sharing] | None = None,
    neighbours: Share | None = None,
) -> Prepared:
    """Compile what is needed, fly the pilot, and divide the scene.

    Args:
        source: of a scene that a function gives nothing is held here but what is sent and told of it.
        workers: how many will share the work; 0 or 1 for one.
        cells: a power of two, or None for the least that serves a team of the workers.
        processes: that share the tasks of the only worker.
        team: memory that the scene takes -> which workers hold it together; None for all.
        neighbours: what workers of this machine share; None if they share nothing, or are elsewhere.

    Raises:
        SettingsError: the device is not there, the image has too many pixels, or settings contradict the scene.
        GuardError: a strict render of a scene with triangles that cannot be rendered.
    """
    check_device(launcher.device)
    scene = scene_of(source)
    check_pixels(scene.camera)
    began, workers = time.perf_counter(), max(workers, 1)
    flat = flatten(leave_out(scene, settings.without), settings.instances, in_file if workers > 1 else np.empty)
    if settings.strict:
        _demand_all(flat)
    if not settings.without:  # or it is looked at again, with what was left out
        scene = without_plain_geometry(scene)
    unused = settings_without_effect(settings)

    progress.start("compile")
    compiling = _Stopwatch(partial(_compile, settings=settings, launcher=launcher, progress=progress))
    automatic = choose_settings(flat, settings, launcher, compiling)
    settings = automatic.settings
    features = with_camera(features_of(flat, settings), flat.camera)
    kernels = compiling(features)
    let_collector_go()

    progress.start("plan")
    shared = Sharing(workers, workers) if team is None else team(_memory_of(flat, settings))
    plan = _planned(flat, automatic, largest_team(shared.slaves, shared.team_size), launcher, cells)
    lit_scene = _lit_scene(plan.world, flat.triangles)
    alone = shared.slaves == 1 and plan.pilot is not None
    session = _session(flat, automatic, plan, shared, processes, lit_scene, alone)
    return Prepared(
        pilot=plan.pilot if alone else None,
        session=session,
        settings=settings,
        triangles=flat.triangles.total,
        dropped=sum(flat.dropped.values()),
        kernels=kernels,
        chose=(*automatic.chose, *plan.chose, *plan.learnt.words, *_allotment_in_words(session.view.allotment)),
        left_out=_left_out(scene, flat, plan.world, features, settings),
        approximated=approximations(scene, plan.world, settings),
        warnings=(*scene.warnings, *_lost(flat, plan.world, settings), *unused),
        # All but compiling is planning, from when the scene was read.
        seconds={"compile": compiling.seconds, "partition": time.perf_counter() - began - compiling.seconds},
        identity=_identity(digest(lit_scene, plan.world.extent), session.view, settings),
        lit_scene=digest(lit_scene, *(getattr(settings, name) for name in OF_RECORDS), "caustics" in settings.without),
        header=header_of(scene),
        uncompiled=tuple(reversed(compiling.uncompiled)),
        lent=() if alone or neighbours is None else _lent(plan, session, flat, launcher, neighbours),
        noise=None if automatic.noise is None else float(automatic.noise.mean()),
    )


def _session(
    flat: FlatScene,
    automatic: ChosenSettings,
    plan: RenderPlan,
    shared: Sharing,
    processes: int,
    lit_scene: str,
    alone: bool,
) -> Session:
    """What a cluster is asked for.

    Args:
        shared: how many slaves there are, and how many of them hold the scene together.
        processes: that share the tasks of the only worker.
        lit_scene: names what light depends on.
        alone: whether the pilot's own worker goes on, so that triangles are sent to nobody.
    """
    world = plan.world
    view = view_of(flat, automatic.settings, max(shared.slaves, processes), alone=shared.team_size == 1)
    view = replace(plan.learnt_view(view), caustic_share=automatic.caustic_share)
    return Session(
        world=world,
        view=replace(view, allotment=_allotment(automatic, view)),
        partition=_partition(flat.triangles if alone else spooled(flat.triangles), plan),
        burdens=plan.burdens,
        digest=digest(replace(world.with_photons(NO_PHOTONS), textures=()), lit_scene, shared.team_size),
        team_size=shared.team_size,
        room=shared.room,
        layers=layers_of(world, view),
        places=plan.some_places(),
        sight=plan.sight,
    )


def _planned(
    flat: FlatScene, automatic: ChosenSettings, team: int, launcher: Launcher, cells: int | None
) -> RenderPlan:
    """The plan of a team, by what was found out to choose its settings."""
    return make_render_plan(flat, automatic.settings, team, launcher, cells, *automatic.found)


def _allotment(automatic: ChosenSettings, view: View) -> Allotment:
    """The samples of each part of an image in one pass; in several, or where
    those of each are given, they are as many everywhere.

    Pixels on outlines of lamps take as many as they need anyway: what is noisy there tells nothing of those about them.
    """
    if automatic.noise is None or automatic.settings.passes > 1 or automatic.settings.pass_samples:
        return NO_ALLOTMENT
    camera, (rows, columns) = view.camera, automatic.noise.shape
    row = (np.arange(rows) * 2 + 1) * camera.height // (2 * rows)
    column = (np.arange(columns) * 2 + 1) * camera.width // (2 * columns)
    times = view.outlines.times_of((row[:, None] * camera.width + column).reshape(-1)).reshape(rows, columns)
    if (times > 1).all():
        return NO_ALLOTMENT
    noise = np.where(times > 1, automatic.noise[times == 1].mean(), automatic.noise)
    return allotment_by_noise(noise, automatic.settings.spp, camera.width, camera.height, view.caustic_share)


def _allotment_in_words(allotment: Allotment) -> tuple[str, ...]:
    if not len(allotment):
        return ()
    least, most = int(allotment.count.min()), int(allotment.count.max())
    return (f"{least:,} to {most:,} samples a pixel, by the noise that the trial saw in parts of the image",)


def forget_pilot(prepared: Prepared) -> None:
    """Give back to the system what a pilot took that nobody goes on with: a tree and tables of the whole scene."""
    if prepared.pilot is None and prepared.triangles >= WORTH_FORGETTING:
        return_free_memory()


def _lent(plan: RenderPlan, session: Session, flat: FlatScene, launcher: Launcher, neighbours: Share) -> Sequence[Any]:
    """What the pilot was flown in, a tree and tables of the whole scene, for slaves of this machine that hold it all.

    They would make the same. Of a large scene they do: what is copied for them would lie here twice for a moment.
    """
    if plan.pilot is None or session.team_size > 1 or flat.triangles.total >= WORTH_FORGETTING:
        return ()
    cache = HostCache(neighbours, session.digest, in_main_memory=launcher.device == "cpu")
    of_cells = [cell.lend(cache) for cell in plan.pilot.cells.values()]
    return [plan.pilot.replica.lend_textures(cache), *of_cells]


WORTH_FORGETTING = 1 << 18
"""Triangles, of which a pilot takes some 70 bytes each: memory of fewer may stay with the allocator."""


def _lost(flat: FlatScene, world: World, settings: RenderSettings) -> tuple[str, ...]:
    """What of the scene does not come to the image, in words."""
    lost = tuple(
        f"{count:,} triangle{'s were' if count > 1 else ' was'} left out: {cause}"
        for cause, count in flat.dropped.items()
    )
    if settings.algorithm.shoots_photons and settings.photons > 0 and not world.global_map.paths:
        lost += (f"none of {PILOT_PATHS:,} photon paths stored a photon: there is no indirect light",)
    return lost


def _memory_of(flat: FlatScene, settings: RenderSettings) -> SceneMemory:
    """What a scene takes in one process, with all photons stored."""
    photons = settings.photons + settings.caustic_photons + settings.volume_photons
    standing = len(flat.triangles.instances)
    return scene_memory(flat.triangles.held, photons, flat.textures, flat.media.grids.voxels, standing)


class _Stopwatch:
    """Compiles kernels, adds up how long that takes [s], and notes for which features others stand in."""

    def __init__(self, compile_for: Callable[[Features], KernelReport]) -> None:
        self._compile_for = compile_for
        self.seconds = 0.0
        self.uncompiled: list[Features] = []

    def __call__(self, features: Features) -> KernelReport:
        began = time.perf_counter()
        report = self._compile_for(features)
        self.seconds += time.perf_counter() - began
        if report.standing_in:
            self.uncompiled.append(features)
        return report


def _demand_all(flat: FlatScene) -> None:
    """Raise GuardError if triangles were left out."""
    for cause, count in flat.dropped.items():
        what = guards.CAUSES[guards.DROPPED]
        raise GuardError(f"strict: {what}: {count} left out ({cause}); to see which: wdpm check SCENE")


def _compile(
    features: Features, settings: RenderSettings, launcher: Launcher, progress: ProgressObserver
) -> KernelReport:
    """Compile what is needed, and tell what that was."""
    before = cached_modules()
    wait, on_compile = launcher.wait_for_kernels, partial(_say, progress)
    chosen = ready_kernels(launcher.device, features, wait=wait, on_compile=on_compile)
    return KernelReport(
        features=features.names(),
        all_effects=settings.all_effects,
        kernels=len(chosen.variants.kernels()),
        modules=len(chosen.variants.modules()),
        compiled=len(cached_modules() - before),
        standing_in=len(chosen.standing_in),
    )


def _say(progress: ProgressObserver, modules: int) -> Callable[[], None]:
    """Tell a person that there is a wait, why, and how long; gives what tells of progress."""
    seconds = math.ceil(modules * SECONDS_A_MODULE / available_cores())
    progress.start("compile", modules)
    progress.note(
        f"{modules} modules of kernels are compiled, for some {seconds} s, and kept; "
        "`wdpm doctor --prepare` compiles what any scene needs"
    )
    return progress.advance


def _left_out(
    scene: Scene, flat: FlatScene, world: World, features: Features, settings: RenderSettings
) -> tuple[str, ...]:
    """What the scene calls for and a person did not want; the scene as it is is looked at only if something may be."""
    if not settings.without and settings.photons and settings.caustic_photons and settings.volume_photons:
        return ()
    as_it_is = flatten(scene, settings.instances) if settings.without else flat
    media = [medium.name for medium in scene.media]
    return missing_effects(effects_of(as_it_is, flat, media, world, features, settings), settings)


def _partition(triangles: Triangles, plan: RenderPlan) -> Callable[[int], Triangles]:
    """Hands out each cell's triangles, as often as slaves need them."""
    rows, instances = plan.rows, plan.instances

    def of_cell(cell: int) -> Triangles:
        taken = triangles.take(rows[cell]).with_instances(triangles.instances.take(instances[cell]))
        triangles.let_go()
        return taken

    return of_cell


def digest(*parts: Any) -> str:
    """Names a value of dataclasses, arrays and scalars by its contents."""
    sha = hashlib.sha256()
    for part in parts:
        _feed(sha, part)
    return sha.hexdigest()


def _lit_scene(world: World, triangles: Triangles) -> str:
    """Names what light depends on, whoever sees it: hashed once for all that names a scene."""
    return digest(world.materials, world.textures, world.lights, world.media, world.unit, triangles)


def _identity(scene: str, view: View, settings: RenderSettings) -> dict[str, str]:
    """Digests of what the bits of an image depend on; of no setting that changes no bit, nor of spp and passes."""
    plain = {name: getattr(RenderSettings(), name) for name in CHANGE_NO_BIT}
    chosen = replace(settings, **plain, spp=1, passes=1, pass_samples=())
    return {"scene": scene, "camera": digest(view.camera), "settings": digest(chosen)}


def _feed(sha: Any, value: Any) -> None:
    if isinstance(value, np.ndarray):
        sha.update(f"{value.dtype}{value.shape}".encode())
        sha.update(np.ascontiguousarray(value).data)
        let_go(value)
    elif is_dataclass(value):
        for attribute in fields(value):
            sha.update(attribute.name.encode())
            _feed(sha, getattr(value, attribute.name))
    elif isinstance(value, list | tuple):
        sha.update(f"[{len(value)}]".encode())
        for item in value:
            _feed(sha, item)
    else:
        sha.update(f"{type(value).__name__}:{value!r};".encode())
