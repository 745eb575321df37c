"""Progressive rendering: the same scene in several passes, whose mean is the image (pass_plan, docs/passes.md).

    with PassRenderer(source, settings) as renderer:
        average = PassAverage(renderer.prepared)
        for plan in spread_samples(settings.spp, settings.passes):
            average.add(renderer.render(plan))
        image = average.image()

Memory stays that of one pass: geometry stays where it is, photons are let go of before others are traced.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.session import Session, SessionResult
from wdpm.images.image import Image
from wdpm.images.limits import check_memory
from wdpm.kernels.launch import Launcher
from wdpm.progress import Progress, SilentProgress
from wdpm.rendering.cache_file import (
    NO_CACHE_FILES,
    CacheFiles,
    CacheNotWrittenError,
    check_can_save,
    check_wanted,
    read_records,
    write_records,
)
from wdpm.rendering.in_process import memory_cluster
from wdpm.rendering.pass_average import PassAverage
from wdpm.rendering.pass_journal import read_journal, write_journal
from wdpm.rendering.pass_plan import PassPlan, PassResult, plans_for, session_of, shrink, spread_samples
from wdpm.rendering.pass_progress import PassProgress
from wdpm.rendering.prepare import Prepared, Source, prepare, scene_of
from wdpm.rendering.results import image_of
from wdpm.rendering.scene_settings import settings_for
from wdpm.scenes.errors import ImageError, SettingsError

if TYPE_CHECKING:
    from wdpm.clusters import Cluster

__all__ = ["PassAverage", "PassPlan", "PassRenderer", "PassResult", "render_in_passes", "shrink", "spread_samples"]


class PassRenderer:
    """Prepares a scene once, and renders any number of its passes. A context manager.

    Between passes it keeps the cells, wherever they are, and nothing else.

    Args:
        source: a scene, a file, the name of a built-in scene, or a function that gives a scene.
        settings: all settings; or give single ones by name, see RenderSettings. `passes` is not looked at: which
            passes are rendered is the caller's business.
        slaves: processes of a local cluster to start; 0 renders in this process.
        cells: a power of two; None for the least that serves the workers.
        threads: cores to use in all; None for all there are.
        device: "cpu" or a CUDA device, "cuda:0".
        progress: is told of every phase of every pass.
        cluster: to render with, in place of one of its own.
        workers, shuffle: of a cluster in this process, for tests (in_process.memory_cluster).
        cache: where irradiance records are read from.

    Attributes:
        prepared: the scene, planned for the first pass.
        progress: may be set to another.

    Raises:
        SceneError, SettingsError, ClusterError: see their messages.
    """

    def __init__(
        self,
        source: Source,
        settings: RenderSettings | None = None,
        *,
        slaves: int = 0,
        cells: int | None = None,
        threads: int | None = None,
        device: str = "cpu",
        progress: Progress | None = None,
        cluster: Cluster | None = None,
        workers: int = 1,
        shuffle: random.Random | None = None,
        cache: CacheFiles = NO_CACHE_FILES,
        **chosen: Any,
    ) -> None:
        self.progress = progress or SilentProgress()
        with ExitStack() as stack:
            if cluster is None and slaves:
                cluster = _local_cluster(stack, slaves, threads, device)
            scene = scene_of(source)
            check_memory(scene.camera)
            settings = settings or settings_for(scene, **chosen)
            if cluster is None:
                launcher = Launcher(device, threads)
                self.prepared: Prepared = prepare(scene, settings, workers, launcher, self.progress, cells)
                here, self._session = memory_cluster(self.prepared, workers, launcher, shuffle)
                self._run: Callable[[Session, Progress], SessionResult] = here.render
            else:
                self.prepared = cluster.prepare(scene, settings, self.progress, cells)
                self._session = self.prepared.session
                self._run = cluster.run
            check_wanted(cache, self.prepared.settings)
            if cache.load is not None:
                self._session = replace(self._session, records=read_records(cache.load, self.prepared.lit_scene))
            self._stack = stack.pop_all()

    def render(self, plan: PassPlan) -> PassResult:
        """Render a pass.

        Raises:
            ClusterError: a slave failed or was lost; the cluster has ended.
        """
        result = self._run(session_of(self._session, plan), self.progress)
        return PassResult(plan, result.layers, dict(result.seconds), result)

    def close(self) -> None:
        """Stop the cluster, if it is this renderer's own; may be called again."""
        self._stack.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)


def render_in_passes(
    source: Source,
    settings: RenderSettings | None = None,
    *,
    slaves: int = 0,
    cells: int | None = None,
    threads: int | None = None,
    device: str = "cpu",
    progress: Progress | None = None,
    cluster: Cluster | None = None,
    workers: int = 1,
    shuffle: random.Random | None = None,
    journal: Path | None = None,
    resume: bool = False,
    keep: bool = False,
    cache: CacheFiles = NO_CACHE_FILES,
    **chosen: Any,
) -> Image:
    """Render a scene in as many passes as `settings.passes` says; in one, the image is that of a plain render.

    Args:
        journal: file that keeps the passes so far; None to keep them nowhere.
        resume: go on from the journal.
        keep: leave the journal behind at the end.
        cache: where irradiance records are written to, and read from; of a render in one pass.
        Others are as of PassRenderer.

    Raises:
        SceneError, SettingsError, ImageError, ClusterError: see their messages. The journal keeps what was done.
        CacheNotWrittenError: an ImageError that has the image.
    """
    progress = progress or SilentProgress()
    check_can_save(cache)
    if journal is None and (resume or keep):
        raise SettingsError("there is no journal to resume from or to keep; give its path")
    with ExitStack() as stack:
        if slaves and cluster is None:
            cluster = _local_cluster(stack, slaves, threads, device)
        scene = [scene_of(source)]
        settings = settings or settings_for(scene[0], **chosen)
        saved = read_journal(journal) if journal is not None and resume else None
        plans = plans_for(settings, () if saved is None else saved.plans)
        if journal is not None and saved is None:
            _refuse_to_overwrite(journal)
        renderer = stack.enter_context(
            PassRenderer(
                scene.pop,  # whoever holds the scene no longer lets its triangles go where they are needed
                settings,
                cells=cells,
                threads=threads,
                device=device,
                progress=progress,
                cluster=cluster,
                workers=workers,
                shuffle=shuffle,
                cache=cache,
            )
        )
        if len(plans) == 1 and journal is None:
            return _render_one(renderer, plans[0], cache)
        average = PassAverage(renderer.prepared) if saved is None else saved.average(renderer.prepared)
        return _render_all(renderer, plans, average, journal, keep)


def _render_one(renderer: PassRenderer, plan: PassPlan, cache: CacheFiles) -> Image:
    """Render the only pass, and keep its irradiance records."""
    prepared = renderer.prepared
    result = renderer.render(plan).result
    image = image_of(prepared, result)
    if cache.save is not None:
        try:
            write_records(cache.save, result.records, prepared.lit_scene)
        except ImageError as error:
            raise CacheNotWrittenError(str(error), image) from None
    return image


def _render_all(
    renderer: PassRenderer, plans: Sequence[PassPlan], average: PassAverage, journal: Path | None, keep: bool
) -> Image:
    """Render the passes that the average lacks, and keep a journal of them."""
    prepared, progress = renderer.prepared, renderer.progress
    left = plans[len(average.plans) :]
    camera, bucket = prepared.session.view.camera, prepared.session.view.bucket
    buckets = -(-camera.width // bucket) * -(-camera.height // bucket)
    asked = prepared.settings.spp
    if plans[-1].first_sample + plans[-1].spp != asked:
        together = plans[-1].first_sample + plans[-1].spp
        progress.note(
            f"{len(average.plans)} passes of {plans[0].spp} samples are done, so {len(plans)} take {together} samples "
            f"in all, not {asked}"
        )
    renderer.progress = PassProgress(progress, buckets, len(left))
    try:
        for plan in left:
            average.add(renderer.render(plan))
            if journal is not None:
                write_journal(journal, average, prepared)
    finally:
        renderer.progress = progress
    image = average.image()
    if journal is not None and not keep:
        journal.unlink(missing_ok=True)
    return image


def _refuse_to_overwrite(journal: Path) -> None:
    if journal.exists():
        raise SettingsError(
            f"{journal}: keeps the passes of a render that was interrupted, or is to be gone on with; give --resume to "
            "go on, or delete it"
        )


def _local_cluster(stack: ExitStack, slaves: int, threads: int | None, device: str) -> Cluster:
    from wdpm.clusters import Cluster as LocalCluster

    return stack.enter_context(LocalCluster.local(slaves=slaves, threads=threads, device=device))
