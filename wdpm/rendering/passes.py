"""Progressive rendering: the same scene in several passes, whose mean is the image (pass_plan, docs/passes.md).

    renderer = PassRenderer(source, backend, settings)
    average = PassAverage(renderer.prepared)
    for plan in spread_samples(settings.spp, settings.passes):
        average.add(renderer.render(plan))
    image = average.image()

Memory stays that of one pass: geometry stays where it is, photons are let go of before others are traced.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from wdpm.cluster.allotment import NO_ALLOTMENT, Allotment
from wdpm.cluster.render_settings import RenderSettings
from wdpm.images.image import Image
from wdpm.images.limits import check_memory
from wdpm.progress import Progress, SilentProgress
from wdpm.rendering.adaptive import FIRST
from wdpm.rendering.approximations import approximations
from wdpm.rendering.backend import Backend
from wdpm.rendering.cache_file import (
    NO_CACHE_FILES,
    CacheFiles,
    CacheNotWrittenError,
    check_can_save,
    check_wanted,
    read_records,
    write_records,
)
from wdpm.rendering.pass_average import PassAverage
from wdpm.rendering.pass_journal import read_journal, write_journal
from wdpm.rendering.pass_plan import (
    PassPlan,
    PassResult,
    is_spread,
    passes_in_words,
    plans_for,
    samples_of,
    session_of,
    shrink,
    spread_samples,
)
from wdpm.rendering.pass_progress import PassProgress
from wdpm.rendering.prepare import Source, scene_of, sound_scene_of
from wdpm.rendering.results import image_of
from wdpm.rendering.scene_settings import settings_given
from wdpm.rendering.session_journal import SessionJournal
from wdpm.scenes.errors import ClusterError, ImageError, SettingsError
from wdpm.scenes.model.scene import Scene

__all__ = ["PassAverage", "PassPlan", "PassRenderer", "PassResult", "render_in_passes", "shrink", "spread_samples"]


LOG_SUFFIX = ".pass"
"""After the name of a journal of passes: the journal of the pass that is rendered, beside it."""


class PassRenderer:
    """Prepares a scene once, and renders any number of its passes.

    Between passes it keeps the cells, wherever they are, and nothing else.

    Args:
        source: a scene, a file, the name of a built-in scene, or a function that gives a scene.
        backend: that renders; its maker closes it.
        settings: all settings; or give single ones by name, see RenderSettings. `passes` is not looked at: which
            passes are rendered is the caller's business.
        progress: is told of every phase of every pass.
        cache: where irradiance records are read from.
        log: keeps what is finished of each pass, and has what an interrupted render did of the first.

    Attributes:
        prepared: the scene, planned for the first pass.
        progress: may be set to another.

    Raises:
        SceneError, SettingsError, ClusterError: see their messages.
    """

    def __init__(
        self,
        source: Source,
        backend: Backend,
        settings: RenderSettings | None = None,
        *,
        progress: Progress | None = None,
        cache: CacheFiles = NO_CACHE_FILES,
        log: SessionJournal | None = None,
        **chosen: Any,
    ) -> None:
        self.progress = progress or SilentProgress()
        self._backend = backend
        self._log = log
        scene = scene_of(source)
        check_memory(scene.camera)
        settings = settings_given(scene, settings, chosen)
        handed_over = [scene]
        del scene  # whoever holds it no longer lets its triangles go
        self.prepared = backend.prepare(handed_over.pop, settings, self.progress)
        check_wanted(cache, self.prepared.settings)
        self._session = self.prepared.session
        if cache.load is not None:
            self._session = replace(self._session, records=read_records(cache.load, self.prepared.lit_scene))

    @property
    def enough(self) -> bool:
        """Whether the person who is shown the image wants no more passes."""
        display = self._backend.display
        return display is not None and display.enough

    def show(self, mean: PassAverage) -> None:
        """Show the mean of the passes so far to whoever looks."""
        if self._backend.display is not None:
            self._backend.display.pass_done(mean)

    def will_have(self, scene: Scene, samples: Sequence[int]) -> None:
        """Be told how many samples each pass will have, where that was open when it was made.

        Nothing of a pass depends on that but how its work is cut up; the image says it of itself.

        Args:
            scene: that it was made of.
        """
        prepared = self.prepared
        given = bool(prepared.settings.pass_samples)
        prepared.settings = replace(prepared.settings, **samples_of(samples, given=given))
        prepared.approximated = approximations(scene, prepared.session.world, prepared.settings)

    def see_by(self, seed: int) -> None:
        """Take other random numbers for camera paths from now on; photons stay as they are."""
        self._session = replace(self._session, view=replace(self._session.view, seed=seed))

    def render(self, plan: PassPlan, allotment: Allotment = NO_ALLOTMENT) -> PassResult:
        """Render a pass.

        Args:
            allotment: the samples of each part of the image (PassAverage.allotment).

        Raises:
            ClusterError: a slave failed or was lost; the cluster has ended.
        """
        session = session_of(self._session, plan, allotment)
        if self._log is not None:
            session = self._log.begin(self.prepared, session, plan, self.progress.note)
        self._backend.keeper = self._log
        result = self._backend.run(self.prepared, session, self.progress)
        return PassResult(plan, result.layers, dict(result.seconds), result, allotment)


def render_in_passes(
    source: Source,
    backend: Backend,
    settings: RenderSettings | None = None,
    *,
    progress: Progress | None = None,
    journal: Path | None = None,
    resume: bool = False,
    keep: bool = False,
    cache: CacheFiles = NO_CACHE_FILES,
    log: SessionJournal | None = None,
    **chosen: Any,
) -> Image:
    """Render a scene in as many passes as `settings.passes` says; in one, the image is that of a plain render.

    Args:
        journal: file that keeps the passes so far; None to keep them nowhere.
        resume: go on from the journal.
        keep: leave the journal behind at the end.
        cache: where irradiance records are written to, and read from; of a render in one pass.
        log: keeps what is finished of the pass that is rendered. Whoever made it removes its file when the image is
            written; with `journal` there is one beside it, unless another is given.
        Others are as of PassRenderer.

    Raises:
        SceneError, SettingsError, ImageError, ClusterError: see their messages. The journal keeps what was done.
        CacheNotWrittenError: an ImageError that has the image.
    """
    progress = progress or SilentProgress()
    check_can_save(cache, in_journal=journal is not None)
    if journal is None and (resume or keep):
        raise SettingsError("there is no journal to resume from or to keep; give its path")
    scene = [sound_scene_of(source)]
    settings = settings_given(scene[0], settings, chosen)
    if settings.adaptive and settings.passes <= FIRST:
        progress.note(
            f"adaptive sampling begins with pass {FIRST + 1}: give --passes, more than that, or it has no effect"
        )
    saved = read_journal(journal) if journal is not None and resume else None
    plans = plans_for(settings, () if saved is None else saved.plans)
    asked = settings.spp
    # Plans go by the samples of a pass: as many as in those that are done, or the others would not go on with them.
    given = bool(settings.pass_samples) or (saved is not None and not is_spread(saved.plans))
    settings = replace(settings, **samples_of([plan.spp for plan in plans], given=given))
    if journal is not None and saved is None:
        _refuse_to_overwrite(journal)
    own = None
    if journal is not None and log is None:
        log = own = SessionJournal(journal.with_name(journal.name + LOG_SUFFIX), resume=resume)
    try:
        # Whoever holds the scene no longer lets its triangles go where they are needed.
        renderer = PassRenderer(scene.pop, backend, settings, progress=progress, cache=cache, log=log)
        if len(plans) == 1 and journal is None:
            image = _render_one(renderer, plans[0], cache)
        else:
            average = PassAverage(renderer.prepared) if saved is None else saved.average(renderer.prepared)
            _note_samples(plans, len(average.plans), asked, renderer.progress)
            image = _render_all(renderer, plans, average, journal, keep, log)
        if own is not None:
            own.remove()
    finally:
        backend.keeper = None
        if own is not None:
            own.close()
    return image


def _render_one(renderer: PassRenderer, plan: PassPlan, cache: CacheFiles) -> Image:
    """Render the only pass, and keep its irradiance records."""
    prepared = renderer.prepared
    result = renderer.render(plan, prepared.session.view.allotment).result
    image = image_of(prepared, result)
    if cache.save is not None:
        try:
            write_records(cache.save, result.records, prepared.lit_scene)
        except ImageError as error:
            raise CacheNotWrittenError(str(error), image) from None
    return image


def _note_samples(plans: Sequence[PassPlan], done: int, asked: int, progress: Progress) -> None:
    """Tell a person if passes take other samples than were asked for."""
    together = plans[-1].first_sample + plans[-1].spp
    if together != asked:
        found = f"{passes_in_words([plan.spp for plan in plans[:done]])} {'is' if done == 1 else 'are'} done"
        progress.note(f"{found}, so {len(plans)} take {together} samples in all, not {asked}")


def _render_all(
    renderer: PassRenderer,
    plans: Sequence[PassPlan],
    average: PassAverage,
    journal: Path | None,
    keep: bool,
    log: SessionJournal | None,
) -> Image:
    """Render the passes that the average lacks, and keep a journal of them."""
    prepared, progress = renderer.prepared, renderer.progress
    left = plans[len(average.plans) :]
    camera, bucket = prepared.session.view.camera, prepared.session.view.bucket
    buckets = -(-camera.width // bucket) * -(-camera.height // bucket)
    renderer.progress = PassProgress(progress, buckets, len(left))
    kept = True
    try:
        for plan in left:
            alone = prepared.session.view.allotment if len(plans) == 1 else average.allotment(plan)
            average.add(renderer.render(plan, alone))
            if journal is not None:
                kept = _keep(journal, average, renderer, told=not kept)
            renderer.show(average)
            if renderer.enough:
                progress.note(f"good enough: {len(average.plans)} of {len(plans)} passes")
                break
    except (KeyboardInterrupt, ClusterError):
        if log is not None and average.plans:
            log.mean = average.image()
        raise
    finally:
        renderer.progress = progress
    image = average.image()
    if journal is not None and not keep:
        journal.unlink(missing_ok=True)
    return image


def _keep(journal: Path, average: PassAverage, renderer: PassRenderer, *, told: bool) -> bool:
    """Write what the passes have come to; returns whether that could be. A full disk must not cost the passes.

    Args:
        told: whether a person has heard already that it cannot be.
    """
    try:
        write_journal(journal, average, renderer.prepared)
    except ImageError as error:
        if not told:
            renderer.progress.note(f"{error}; the render goes on without, and tries again after each pass")
        return False
    return True


def _refuse_to_overwrite(journal: Path) -> None:
    if journal.is_dir():
        raise SettingsError(f"{journal}: is a folder; name a file in it that keeps the passes")
    if journal.exists():
        raise SettingsError(
            f"{journal}: keeps the passes of a render that was interrupted, or is to be gone on with; give --resume to "
            "go on, or delete it"
        )
