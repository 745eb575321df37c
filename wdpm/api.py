"""The Python interface: render, inspect, replay.

import wdpm
scene = wdpm.load("scene.xml")
image = wdpm.render(scene, photons=250_000, spp=16)
image.save("image.exr")
"""

from __future__ import annotations

import time
from os import PathLike
from typing import Any

from wdpm.cluster.display import Display
from wdpm.cluster.render_settings import RenderSettings
from wdpm.given import check_follows
from wdpm.goal.checks import goal_in_python
from wdpm.goal.render import render_until
from wdpm.images.image import Image
from wdpm.inspection.plan import Plan, plan_of
from wdpm.local_backend import backend_here
from wdpm.notebook import shown_live
from wdpm.progress import Progress
from wdpm.rendering.cache_file import CacheFiles, path_named
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.prepare import Source
from wdpm.replaying.run import replay_sample
from wdpm.replaying.vertices import Replay


def render(
    source: Source,
    settings: RenderSettings | None = None,
    *,
    slaves: int = 0,
    threads: int | None = None,
    device: str = "cpu",
    progress: Progress | None = None,
    display: Display | None = None,
    live: bool = False,
    journal: str | PathLike[str] | None = None,
    resume: bool = False,
    keep: bool = False,
    save_cache: str | PathLike[str] | None = None,
    load_cache: str | PathLike[str] | None = None,
    until_error: float | None = None,
    metric: str | None = None,
    time_budget: float | None = None,
    **chosen: Any,
) -> Image:
    """Render a scene on this machine.

    Args:
        source: a scene, a file, the name of a built-in scene, meshes or a scene of trimesh (from_trimesh), or a
            function that gives a scene.
        settings: all settings; or give single ones by name (`photons=250_000, spp=16`), see RenderSettings.
        slaves: processes of a local cluster; 0 renders in this process. The image is the same, bit for bit.
        threads: cores to use in all; None for all there are.
        device: "cpu" or a CUDA device, "cuda:0".
        progress: is told how far the render is.
        display: is shown the image while it is rendered.
        live: show it in the notebook that this runs in, in place, with a bar for the phase; elsewhere one line says
            that there is none.
        journal: file that keeps the passes of a render in several (`passes=8`), so that it can go on after it was
            interrupted; removed at the end. Beside it, under the name with `.pass`, is what is finished of a pass that
            takes more than ten seconds.
        resume: go on from the journal, on any number of slaves, and up to any number of passes.
        keep: keep the journal, to add passes later.
        save_cache: file to write the view's irradiance records to, for other views of the same scene.
        load_cache: file to read them from; the view makes none of its own then.
        until_error: render until the error is so small, by an estimate whose upper end holds in 9 of 10 cases; picks
            all settings that are not given by name. What came of it is `image.metadata["asked"]`.
        metric: of that error: "relmse" or "rmse"; None for the former.
        time_budget: seconds from this call on that it may take; alone, or together with until_error.

    Raises:
        SceneError, SettingsError, ImageError, ClusterError: see their messages.
        CacheNotWrittenError: `save_cache` could not be written after the render; its `image` is the image.
    """
    others = {"settings": settings, "journal": journal, "resume": resume, "keep": keep, "strict": chosen.get("strict")}
    others |= {"save_cache": save_cache, "load_cache": load_cache}
    goal = goal_in_python(until_error, metric, time_budget, others)
    began = time.perf_counter()
    with (
        shown_live(live, source, display, progress) as (scene, live_display, live_progress),
        backend_here(slaves, threads, device) as backend,
    ):
        backend.display = live_display
        if goal is not None:
            used = time.perf_counter() - began
            return render_until(scene, goal, backend, progress=live_progress, used=used, **chosen)
        return render_in_passes(
            scene,
            backend,
            settings,
            progress=live_progress,
            journal=path_named(journal),
            resume=resume,
            keep=keep,
            cache=CacheFiles.named(save_cache, load_cache),
            **chosen,
        )


def inspect(source: Source, *, slaves: int = 4, **chosen: Any) -> Plan:
    """What a render with these settings would do with a scene: the effects that it calls for, and who would hold what.

    Args:
        source: a scene, a file, the name of a built-in scene, meshes of trimesh, or a function that gives a scene.
        slaves: how many to divide it among.
        chosen: settings of that render by name, see RenderSettings.

    Raises:
        SceneError, SettingsError: see their messages.
    """
    return plan_of(source, slaves, chosen)


def replay(
    source: Source,
    x: int,
    y: int,
    sample: int,
    settings: RenderSettings | None = None,
    *,
    threads: int | None = None,
    device: str = "cpu",
    progress: Progress | None = None,
    **chosen: Any,
) -> Replay:
    """Trace one sample of one pixel as a render with these settings does, in one cell in this process.

    Args:
        source: a scene, a file, the name of a built-in scene, or a function that gives a scene.
        x, y: the pixel, from the upper left of the image.
        sample: its number, from 0.
        settings: all settings; or give single ones by name, see RenderSettings. `strict` is not looked at.
        threads: cores to use; None for all there are.
        device: "cpu" or a CUDA device, "cuda:0".

    Raises:
        SceneError, SettingsError: see their messages; also where there is no such pixel or sample.
    """
    check_follows("progress", progress, Progress)
    with InProcess(threads=threads, device=device) as backend:
        return replay_sample(source, backend, x, y, sample, settings, progress=progress, **chosen)
