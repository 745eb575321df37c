"""Where the passes of a goal are rendered."""

from __future__ import annotations

import time
from dataclasses import dataclass

from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.trial import Clock
from wdpm.progress import Progress, SilentProgress
from wdpm.rendering.backend import Backend
from wdpm.rendering.passes import PassRenderer
from wdpm.scenes.model.scene import Scene


@dataclass(frozen=True, eq=False)
class Workplace:
    """Where passes are rendered.

    Attributes:
        clock: that costs are measured with [s].
    """

    backend: Backend
    progress: Progress
    clock: Clock = time.perf_counter

    def renderer(self, scene: Scene, settings: RenderSettings) -> PassRenderer:
        """One whose phases show as no more than signs of life."""
        return PassRenderer(scene, self.backend, settings, progress=_SignsOfLife(self.progress))


class _SignsOfLife(SilentProgress):
    """Of many small renders that are one phase to a person."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def advance(self, amount: int = 1) -> None:
        self._progress.advance(amount)
