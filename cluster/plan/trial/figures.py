"""What a trial of integrators tells: how noisy a sample is by each, and what photon maps get wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wdpm.cluster.plan.map_worth import MapError
from wdpm.cluster.plan.path_caustics import PathCaustics
from wdpm.cluster.plan.small_view import BY_CHANCE, Figures, Values
from wdpm.cluster.plan.trial.mean_error import NO_MEAN_ERROR, MeanError
from wdpm.cluster.render_settings import RenderSettings

GATHERED = 0.3
"""Noise of a gather ray's light, as a share of that of a whole path's."""

MOST_NOISE = 4.0
"""Of a pixel's relative squared error, where samples go by it (allotment): a rare bright sample may draw no more."""


@dataclass(frozen=True)
class Trial:
    """What a trial tells.

    Attributes:
        by_photons: their figures, with Indirect.MAP.
        by_paths: of path tracing.
        caustics: what paths make of those, where smooth surfaces make any.
        even: the share of the diffuse surfaces that camera paths meet that records serve.
        unread: the share of gather rays that would find no irradiance within reach.
        map_errors: what gathers of the global and the caustic map get wrong; None where too little is known.
        bias: of the global map, as relMSE: what it shows beyond what paths do, and beyond noise.
        caustic_grain: noise of a sample's caustics, as relMSE: samples of one pixel do not see the same of the map.
        noises: of a sample of each pixel: by photons, by paths as rendered, and the part of unguided ones that indirect
            light makes, shape [height, width].
        uneven: of what each of those pixels reflects diffusely, the part that records do not serve, shape
            [height, width].
        by_guided: figures of path tracing as it would be rendered, guided to caustics; None where it would not be.
        mean_error: of the image's mean, by photons that gather rays read.
    """

    by_photons: Figures
    by_paths: Figures
    caustics: PathCaustics
    even: float
    unread: float
    map_errors: Sequence[MapError | None]
    bias: float
    caustic_grain: float
    noises: tuple[Values, Values, Values]
    uneven: Values
    by_guided: Figures | None = None
    mean_error: MeanError = NO_MEAN_ERROR

    @property
    def as_rendered(self) -> Figures:
        """Of path tracing, as it would be rendered."""
        return self.by_paths if self.by_guided is None else self.by_guided

    def noise_by(self, settings: RenderSettings) -> float:
        """Of one sample of every pixel by photon mapping: with that of gather rays, where each sample has one."""
        noise, gathered = self.noises[2], self._gathered(settings)
        # By pixels: a dark floor may be all that has a coat, beneath white walls that have all the noise.
        noise = np.minimum(noise, np.quantile(noise, 1.0 - BY_CHANCE))
        whole = float(noise.sum())
        share = float((gathered * noise).sum()) / whole if whole > 0 else float(gathered.mean())
        return self.by_photons.noise + share * GATHERED * self.by_paths.of_indirect

    def noises_by(self, settings: RenderSettings) -> Values:
        """Of one sample of each pixel, at most MOST_NOISE, shape [height, width]."""
        by_photons, by_path, of_indirect = self.noises
        if settings.algorithm.shoots_photons:
            by_path = by_photons + self._gathered(settings) * GATHERED * of_indirect
        return np.minimum(by_path, MOST_NOISE)

    def _gathered(self, settings: RenderSettings) -> Values:
        """The share of each pixel's light that is that of gather rays, by photon mapping, shape [height, width]."""
        if not settings.final_gathers:
            return np.zeros_like(self.uneven)
        return self.uneven if settings.algorithm.has_irradiance_cache(settings) else np.ones_like(self.uneven)
