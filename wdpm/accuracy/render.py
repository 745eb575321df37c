"""Renders the points of a sweep and takes their time, in one process that stays warm."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType
from typing import Self

from wdpm.accuracy.points import Point
from wdpm.accuracy.store import Record
from wdpm.cluster.render_settings import RenderSettings
from wdpm.goal.clock import cpu_seconds
from wdpm.images.image import Image
from wdpm.rendering.backend import Backend, Backends
from wdpm.rendering.passes import render_in_passes
from wdpm.report import report
from wdpm.scenes.model.scene import Scene

UNTIMED = ("load", "compile")
"""Phases that are no part of a point's time: a warm process has them behind it."""

TINY_PHOTONS = 1000
"""Of renders that are done for their side effects: kernels compiled, photons forgotten."""


class PointRenderer:
    """Renders one scene at any point. A context manager: backends that it had made stay up until it is closed.

    Args:
        backends: makes the one for a number of slaves, when it is first needed.

    Attributes:
        compile_seconds: spent on kernels so far.
    """

    def __init__(self, scene: Scene, backends: Backends) -> None:
        self.compile_seconds = 0.0
        self._scene = scene
        self._make_backend = backends
        self._stack = ExitStack()
        self._backends: dict[int, Backend] = {}
        self._last_seed: dict[int, int] = {}
        self._warm: set[object] = set()

    def render(self, point: Point, seed: int) -> tuple[Image, Record]:
        """Render a point with a seed.

        Raises:
            ClusterError: a slave failed or was lost.
        """
        settings = replace(point.settings, seed=seed)
        self._warm_up(point, settings)
        # A cluster keeps its photons for the next render if they are the same; then their time would be missing.
        if point.slaves and self._last_seed.get(point.slaves) == seed:
            self._render(_tiny(settings, seed ^ 1), point.slaves)
        # Slaves tell what they took; processes forked from this one do not.
        cpu_clock = time.process_time if point.slaves else cpu_seconds
        began, cpu_began = time.perf_counter(), cpu_clock()
        image = self._render(settings, point.slaves)
        own_cpu, elapsed = cpu_clock() - cpu_began, time.perf_counter() - began
        self._last_seed[point.slaves] = seed
        account = report.from_dict(image.metadata["report"])
        untimed = sum(account.phases.get(phase, 0.0) for phase in UNTIMED)
        self.compile_seconds += untimed
        record = Record(
            seconds=elapsed - untimed,
            cpu_seconds=own_cpu + (sum(slave.busy_s for slave in account.slaves) if point.slaves else 0.0),
            phases=account.phases,
            digest=image.digest(),
            stored=account.stored,
            ghosts=sum(slave.ghosts for slave in account.slaves),
            bytes=sum(slave.bytes_out for slave in account.slaves),
            left_band=account.gathers_left_band,
        )
        return image, record

    def _warm_up(self, point: Point, settings: RenderSettings) -> None:
        """Compile, and load, what a point calls for; in slaves, too."""
        kinds = (point.slaves, settings.integrator, settings.indirect, settings.without, settings.all_effects)
        if kinds in self._warm:
            return
        began = time.perf_counter()
        self._render(_tiny(settings, settings.seed ^ 1), point.slaves)
        self.compile_seconds += time.perf_counter() - began
        self._warm.add(kinds)

    def _render(self, settings: RenderSettings, slaves: int) -> Image:
        return render_in_passes(self._scene, self.backend(slaves), settings)

    def backend(self, slaves: int) -> Backend:
        """The one that points with so many slaves are rendered by."""
        if slaves not in self._backends:
            self._backends[slaves] = self._stack.enter_context(self._make_backend(slaves))
        return self._backends[slaves]

    def close(self) -> None:
        """Close the backends."""
        self._stack.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)


def _tiny(settings: RenderSettings, seed: int) -> RenderSettings:
    """The least work that touches all that a render touches."""
    return replace(
        settings,
        seed=seed,
        spp=1,
        passes=1,
        pass_samples=(),
        photons=min(settings.photons, TINY_PHOTONS),
        caustic_photons=min(settings.caustic_photons, TINY_PHOTONS),
        volume_photons=min(settings.volume_photons, TINY_PHOTONS),
    )
