"""The Python interface: load, render, inspect.

import wdpm
scene = wdpm.load("scene.xml")
image = wdpm.render(scene, photons=250_000, spp=16)
image.save("image.exr")
"""

from __future__ import annotations

import random
from typing import Any

from wdpm.cluster import memory
from wdpm.cluster.plan import cells_of
from wdpm.cluster.worker import Worker
from wdpm.image import Image
from wdpm.kernels.launch import Launcher
from wdpm.kernels.settings import RenderSettings
from wdpm.prepare import Prepared, Source, image_of, prepare, scene_of
from wdpm.progress import Progress, SilentProgress
from wdpm.scene_settings import settings_for
from wdpm.scenes.model import Scene


def render(
    source: Source,
    settings: RenderSettings | None = None,
    *,
    slaves: int = 0,
    threads: int | None = None,
    device: str = "cpu",
    progress: Progress | None = None,
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

    Raises:
        SceneError, SettingsError, ClusterError: see their messages.
    """
    progress = progress or SilentProgress()
    if slaves:
        from wdpm.cluster_api import Cluster

        with Cluster.local(slaves=slaves, threads=threads, device=device) as cluster:
            return cluster.render(source, settings, progress=progress, **chosen)
    launcher = Launcher(device, threads)
    scene = scene_of(source)
    prepared = prepare(scene, settings or settings_for(scene, **chosen), 1, launcher, progress)
    del scene  # its triangles are the cells' now
    return _in_this_process(prepared, 1, launcher, progress, None)


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
    launcher = Launcher("cpu", threads)
    prepared = prepare(scene, settings, workers, launcher, SilentProgress(), cells)
    return _in_this_process(prepared, workers, launcher, SilentProgress(), shuffle)


def _in_this_process(
    prepared: Prepared, workers: int, launcher: Launcher, progress: Progress, shuffle: random.Random | None
) -> Image:
    session = prepared.session
    if prepared.pilot is not None:
        made = [prepared.pilot]
        prepared.pilot.adopt(session.world)
    else:
        parts = {cell: session.partition(cell) for cell in range(session.world.top_tree.cells)}
        made = [
            Worker(
                number,
                session.world,
                {cell: parts[cell] for cell in cells_of(session.holders, number)},
                session.holders,
                launcher,
            )
            for number in range(workers)
        ]
    return image_of(prepared, memory.run(session, made, progress, shuffle=shuffle))
