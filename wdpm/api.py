"""The Python interface: load, render, inspect.

import wdpm
scene = wdpm.load("scene.xml")
image = wdpm.render(scene, photons=250_000, spp=16)
image.save("image.exr")
"""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.checks import goal_in_python
from wdpm.goal.render import render_until
from wdpm.images.image import Image
from wdpm.progress import Progress
from wdpm.rendering.cache_file import CacheFiles
from wdpm.rendering.passes import render_in_passes
from wdpm.rendering.prepare import Source
from wdpm.scenes.model.scene import Scene


def render(
    source: Source,
    settings: RenderSettings | None = None,
    *,
    slaves: int = 0,
    threads: int | None = None,
    device: str = "cpu",
    progress: Progress | None = None,
    journal: Path | None = None,
    resume: bool = False,
    keep: bool = False,
    save_cache: Path | None = None,
    load_cache: Path | None = None,
    until_error: float | None = None,
    metric: str | None = None,
    time_budget: float | None = None,
    **chosen: Any,
) -> Image:
    """Render a scene on this machine.

    Args:
        source: a scene, a file, the name of a built-in scene, or a function that gives a scene.
        settings: all settings; or give single ones by name (`photons=250_000, spp=16`), see RenderSettings.
        slaves: processes of a local cluster; 0 renders in this process. The image is the same, bit for bit.
        threads: cores to use in all; None for all there are.
        device: "cpu" or a CUDA device, "cuda:0".
        progress: is told how far the render is.
        journal: file that keeps the passes of a render in several (`passes=8`), so that it can go on after it was
            interrupted; removed at the end.
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
    beside = {"settings": settings, "journal": journal, "resume": resume, "keep": keep, "strict": chosen.get("strict")}
    beside |= {"save_cache": save_cache, "load_cache": load_cache}
    goal = goal_in_python(until_error, metric, time_budget, beside)
    if goal is not None:
        return render_until(source, goal, slaves=slaves, threads=threads, device=device, progress=progress, **chosen)
    return render_in_passes(
        source,
        settings,
        slaves=slaves,
        threads=threads,
        device=device,
        progress=progress,
        journal=journal,
        resume=resume,
        keep=keep,
        cache=CacheFiles(save_cache, load_cache),
        **chosen,
    )


def render_in_process(
    scene: Scene,
    settings: RenderSettings,
    *,
    workers: int,
    cells: int | None = None,
    threads: int | None = None,
    shuffle: random.Random | None = None,
) -> Image:
    """Render with several workers in this process: a cluster without sockets, for tests.

    Args:
        cells: a power of two, at least `workers`; None for the least that serves them.
        shuffle: shuffles the order in which messages arrive.
    """
    return render_in_passes(scene, settings, workers=workers, cells=cells, threads=threads, shuffle=shuffle)
