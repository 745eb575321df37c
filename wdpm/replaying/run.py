"""One sample of one pixel, traced again as a render traces it, with all that happens at each vertex of its path.

    sample = wdpm.replay("scene.xml", 10, 7, 3, photons=250_000, spp=16)
    sample.value, sample.vertices[0].hit.material, sample.vertices[0].direct

The photons are those of the render, and so is every kernel that computes light: `Replay.layers` are, bit for bit, what
the sample adds to its pixel. It takes the time of the render's photons; the samples of other pixels are not traced.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from numbers import Integral
from typing import Any

import numpy as np

from wdpm.cluster.allotment import MOST_BY_NOISE, OUTLINE_TIMES
from wdpm.cluster.batch import TO_HOME, Batch
from wdpm.cluster.render_settings import RenderSettings, Routing
from wdpm.cluster.task import BucketTask, PhotonTask
from wdpm.cluster.work.bucket_home import BucketHome
from wdpm.cluster.work.guards import Guards, added
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import View, World
from wdpm.progress import Progress, SilentProgress
from wdpm.rendering.adaptive import FIRST
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.pass_plan import PassPlan, plans_for, session_of
from wdpm.rendering.prepare import Prepared, Source, sound_scene_of
from wdpm.rendering.scene_settings import settings_given
from wdpm.replaying.recorder import Names, Recorder
from wdpm.replaying.vertices import LAYERS, Replay
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.model.scene import Camera, Scene

PATHS_AT_ONCE = 1 << 16
"""Photon paths that are traced at once: bounds memory, changes no bit."""


def replay_sample(
    source: Source,
    backend: InProcess,
    x: int,
    y: int,
    sample: int,
    settings: RenderSettings | None = None,
    *,
    progress: Progress | None = None,
    **chosen: Any,
) -> Replay:
    """Trace one sample of one pixel as a render with these settings does.

    Args:
        source: a scene, a file, the name of a built-in scene, or a function that gives a scene.
        backend: with one worker that has one cell: what it does is looked at from nearby.
        x, y: the pixel, from the upper left of the image.
        sample: its number, from 0.
        settings: all settings; or give single ones by name, see RenderSettings. `strict` is not looked at.

    Raises:
        SceneError, SettingsError: see their messages; also where there is no such pixel or sample.
    """
    scene = sound_scene_of(source)
    settings = settings_given(scene, settings, chosen)
    # Which pixels take more than others is known when the scene is prepared.
    most = settings.spp * OUTLINE_TIMES * MOST_BY_NOISE
    check_place(scene.camera, most if sample < most else settings.spp, x, y, sample)

    def plan(view: View) -> PassPlan:
        _, stop = _samples(view, x, y)
        check_place(view.camera, stop, x, y, sample)
        return pass_of(settings, sample, -(-stop // settings.spp))

    return Replayer(scene, backend, settings, plan, progress=progress).sample(x, y, sample)


class Replayer:
    """Replays any number of samples of a scene, or of one pass of a progressive render; photons are traced once.

    Args:
        plan: the pass, or what tells it from the view; None for the first.
        Others are as for `replay_sample`.
    """

    def __init__(
        self,
        scene: Scene,
        backend: InProcess,
        settings: RenderSettings,
        plan: PassPlan | Callable[[View], PassPlan] | None = None,
        *,
        progress: Progress | None = None,
    ) -> None:
        progress = progress or SilentProgress()
        if settings.adaptive and settings.passes > FIRST:
            raise SettingsError(
                "the image was sampled adaptively: which pass took a sample depends on all passes before it; replay "
                "one that was rendered without --adaptive"
            )
        settings = replace(settings, strict=False, routing=Routing.FORWARD)
        prepared = backend.prepare(scene, settings, progress)
        self._names = Names(scene, prepared.triangles)
        if callable(plan):
            plan = plan(prepared.session.view)
        session = session_of(prepared.session, plan or pass_of(settings, 0), prepared.session.view.allotment)
        self._view = session.view
        self._worker = _with_photons(prepared, session.world, progress)

    def sample(self, x: int, y: int, sample: int) -> Replay:
        """One sample of a pixel; SettingsError if there is none such."""
        worker, view = self._worker, self._view
        first, stop = _samples(view, x, y)
        check_place(view.camera, stop, x, y, sample, first)
        worker.set_view(view)
        cell, guards = worker.cells[0], Guards(worker.replica)
        before = cell.guards
        recorder = Recorder(worker.replica, view)
        worker.replica.observer = recorder
        only = (range(sample, sample + 1),)
        home = BucketHome(BucketTask(0, x, y, x + 1, y + 1), 0, worker.replica, view, guards, only)
        waiting: deque[Batch] = deque(home.begin())
        while waiting:
            batch = waiting.popleft()
            recorder.saw(batch)
            waiting.extend(home.receive(batch) if batch.kind in TO_HOME else cell.advance(batch))
        worker.replica.observer = None
        if home.result() is None:
            raise AssertionError(f"sample {sample} of pixel {x},{y} is still under way")
        sums = home.sums()
        acted = added([cell.guards, guards.counts])
        return Replay(
            x,
            y,
            sample,
            recorder.vertices(self._names),
            {name: sums[name][0] for name in LAYERS},
            {cause: count - before.get(cause, 0) for cause, count in acted.items() if count > before.get(cause, 0)},
        )


def pass_of(settings: RenderSettings, sample: int, times: int = 1) -> PassPlan:
    """The pass of a render that takes a sample.

    Args:
        times: as many times the samples of others its pixel takes.
    """
    return next(plan for plan in plans_for(settings) if sample < times * (plan.first_sample + plan.spp))


def _samples(view: View, x: int, y: int) -> tuple[int, int]:
    """Number of the first sample that a pixel takes, and of the first that it does not; of any outside the image."""
    camera, first, count = view.camera, view.first_sample, view.spp
    if len(view.allotment) and 0 <= x < camera.width and 0 <= y < camera.height:
        first, count = (int(each[0, 0]) for each in view.allotment.of_pixels(x, y, x + 1, y + 1))
    times = int(view.outlines.times_of(np.array([y * camera.width + x]))[0])
    return times * first, times * (first + count)


def check_place(camera: Camera, spp: int, x: int, y: int, sample: int, first: int = 0) -> None:
    """Raise SettingsError if an image has no such pixel, or the pixel no such sample."""
    for name, value in (("x", x), ("y", y), ("sample", sample)):
        if not isinstance(value, Integral):  # as somebody gave it in Python
            raise SettingsError(f"{name} is {value!r}; expected a whole number")
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        raise SettingsError(
            f"there is no pixel {x},{y} in an image of {camera.width}x{camera.height}: "
            f"expected 0,0 to {camera.width - 1},{camera.height - 1}"
        )
    if not first <= sample < spp:
        raise SettingsError(f"there is no sample {sample} of a pixel with {spp}: expected {first} to {spp - 1}")


def _with_photons(prepared: Prepared, world: World, progress: Progress) -> CellWorker:
    """The worker of the only cell, with its maps built."""
    worker = prepared.pilot
    if worker is None:
        raise AssertionError("a sample is replayed by one worker that has one cell")
    worker.adopt(world)
    progress.start("photons", world.paths)
    for number, start in enumerate(range(0, world.paths, PATHS_AT_ONCE)):
        stop = min(start + PATHS_AT_ONCE, world.paths)
        worker.start(PhotonTask(number, start, stop))
        progress.advance(stop - start)
    progress.start("map")
    worker.exchange_ghosts()
    worker.build_maps()
    worker.finish_maps()
    return worker
