"""Which integrator suits a scene: a trial of a few thousand samples by each, and what their errors cost.

A trial counts, it looks at no clock: rays, vertices and gathers, at fixed prices. So the same scene and settings choose
alike on every machine and cluster, as the bits of the image depend on it (docs/exactness.md).

What samples leave of noise is measured, by the integrators that are compared: each renders the same few pixels twice,
with other samples, and half the squared difference is the variance. What photons leave besides, whatever the samples,
is a share of the square of indirect light. Paths may miss what hardly any of them meets, and a trial of few samples
does not know what it has missed: caustics that smooth surfaces make are left to photons.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.light_guide import NOTHING_LEARNT, Learnt, with_guide
from wdpm.cluster.plan.light_samples import light_samples_of
from wdpm.cluster.plan.map_plans import map_plans
from wdpm.cluster.plan.photon_pilot import PhotonPilot, pilot_for
from wdpm.cluster.plan.small_view import small, without_photons
from wdpm.cluster.plan.view import view_of
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.cluster.task import BucketRendered, BucketTask
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import MapPlan, View
from wdpm.kernels.features import Features
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.used_media import calls_for_media

Values = NDArray[np.float64]

TRIAL_PIXELS = 1024
TRIAL_SAMPLES = 2
"""Of each pixel, by each way to render, in two halves: some 6,000 samples in all take about a tenth of a second."""

DARK = 0.01
"""Added to squared radiance, as in relMSE: noise in the dark is not worth as much."""

# Prices, about nanoseconds of one core. Only their ratios matter.
CAMERA_RAY = 600.0
SHADOW_RAY = 250.0
VERTEX = 800.0
"""A ray that goes on and what it meets, but for its shadow ray."""
GATHER = 40.0
"""Of each photon that a gather looks for."""
PHOTON_PATH = 1300.0
STORED_PHOTON = 2500.0
"""To be put into a map."""
RECORD_RAY = 2000.0
RECORD_RAYS = 1.6
"""Of a pixel and a sample, of the irradiance cache."""

LEFT_BY_MAP = 0.02
LEFT_BY_CACHE = 0.003
"""Error that samples do not lessen, as a share of the square of indirect light: noise and blur of gathers of 50
photons, and of irradiance records of 16 samples a pixel. On cbox and sibenik 0.013 to 0.022, and 0.001 to 0.004."""

BETTER_BY = 3.0
"""Path tracing is chosen where it is expected to take this many times less than photons. A trial sees too little of
what paths seldom meet, and nothing of what is gained as samples of lamps are spread evenly: on breakfast-room path
tracing is expected to take half of what photons do, and takes one and a half times as much."""


@dataclass(frozen=True)
class Figures:
    """What a trial tells of one integrator.

    Attributes:
        settings: that were tried.
        noise: of one sample of every pixel, as relMSE.
        cost: of a sample, at the prices above.
        indirect: the mean square of indirect light, as relMSE is weighted; of photons, without their maps, 0.
    """

    settings: RenderSettings
    noise: float
    cost: float
    indirect: float


@dataclass(frozen=True)
class IntegratorChoice:
    """What was chosen, and why.

    Attributes:
        settings: with the integrator, and where its indirect light comes from.
        words: for people.
        pilot: that was flown for photons.
    """

    settings: RenderSettings
    words: str
    pilot: PhotonPilot


def trial_features(flat: FlatScene, settings: RenderSettings) -> Features:
    """What kernels have to be compiled for before a trial."""
    return features_of(flat, replace(settings, integrator=Integrator.PATH, without=()))


def without_a_trial(flat: FlatScene, settings: RenderSettings) -> str | None:
    """Why it is photons whatever a trial would find; None if a trial is to decide."""
    if asked := _asked_of_photons(settings):
        return f"photons, since they were asked for: {', '.join(asked)}"
    if calls_for_media(flat):
        return "photons, since the scene has media"
    if not flat.lights.power.sum() > 0:
        return "photons, since nothing shines"
    return None


def choose_integrator(
    flat: FlatScene,
    settings: RenderSettings,
    photons: RenderSettings,
    launcher: Launcher,
    flown: PhotonPilot | None = None,
    *,
    smooth: bool,
) -> IntegratorChoice:
    """Choose between photon mapping and path tracing. Kernels for `trial_features` are to be compiled before.

    Args:
        settings: with an integrator that stands for several.
        photons: the same with photon mapping, and what that chose for itself.
        flown: a pilot that was flown before, perhaps for other settings.
        smooth: whether light is reflected or refracted in single directions anywhere.
    """
    pilot = pilot_for(flat, trial_features(flat, settings), photons, launcher, flown)
    maps = map_plans(pilot, photons, flat).maps
    if smooth and maps[CAUSTIC_MAP].paths:
        words = "photons, since smooth surfaces make caustics, which paths hardly ever find"
        return IntegratorChoice(photons, words, pilot)
    tried = _try_all(flat, pilot, [replace(photons, indirect=Indirect.MAP), *_ways_of_paths(flat, settings)])
    by_photons, by_path = tried[0], min(tried[1:], key=lambda way: way.noise * way.cost)
    left = _left(photons) * by_path.indirect
    error = by_photons.noise / photons.spp + left
    pixels = flat.camera.width * flat.camera.height
    paths_cost = pixels * max(by_path.noise / error, 1.0) * by_path.cost if error > 0 else math.inf
    ratio = paths_cost / _price_of_photons(pixels, photons, maps, by_photons)
    chosen, name = (by_path.settings, "path") if ratio * BETTER_BY < 1.0 else (photons, "photons")
    return IntegratorChoice(
        chosen,
        f"{name}, since path tracing is expected to take {ratio:.2g} times what photons take to the same error (in a "
        f"trial, relMSE of a sample was {by_path.noise:.2g} by paths and {by_photons.noise:.2g} by photons, which add "
        f"{left:.2g})",
        pilot,
    )


def _asked_of_photons(settings: RenderSettings) -> list[str]:
    """Settings that were chosen, and that mean something to photon maps alone."""
    plain, paths = RenderSettings(), Integrator.PATH.algorithm
    names = [name for name in paths.ignored if getattr(settings, name) != getattr(plain, name)]
    return names + [f"without {effect}" for effect in settings.without if effect in paths.cannot_leave_out]


def _ways_of_paths(flat: FlatScene, settings: RenderSettings) -> list[RenderSettings]:
    """Path tracing with one shadow ray of what the camera sees, and with as many as photon mapping has."""
    paths = replace(settings, integrator=Integrator.PATH, indirect=Indirect.MAP)
    if settings.light_samples is not None:
        return [paths]
    both = (Integrator.PATH, Integrator.PHOTONS)
    counts = {light_samples_of(flat, replace(settings, integrator=each)) for each in both}
    return [replace(paths, light_samples=count) for count in sorted(counts)]


def _price_of_photons(
    pixels: int, settings: RenderSettings, maps: tuple[MapPlan, MapPlan, MapPlan], by_photons: Figures
) -> float:
    """Of a whole render by photons."""
    asked = ((maps[GLOBAL_MAP].paths, settings.photons), (maps[CAUSTIC_MAP].paths, settings.caustic_photons))
    shot = sum(paths * PHOTON_PATH + min(count, paths) * STORED_PHOTON for paths, count in asked)
    by_records = RECORD_RAY * RECORD_RAYS if settings.algorithm.has_irradiance_cache(settings) else 0.0
    return settings.passes * shot + pixels * settings.spp * (by_photons.cost + by_records)


def _left(settings: RenderSettings) -> float:
    """Of the square of indirect light, what samples do not lessen."""
    left = LEFT_BY_CACHE if settings.algorithm.has_irradiance_cache(settings) else LEFT_BY_MAP
    return left / settings.passes


def _try_all(flat: FlatScene, pilot: PhotonPilot, ways: Sequence[RenderSettings]) -> list[Figures]:
    """Render a small image, without photons, twice in each way: figures by one and the same idea of the truth."""
    looking = replace(flat, camera=small(flat.camera, TRIAL_PIXELS))
    with without_photons(pilot) as worker:
        halves = [Halves(looking, worker, each) for each in ways]
    truth = np.mean([half["beauty"] for each in halves for half in each.layers], axis=0)
    # A pixel that one sample made bright is as bright as those around it: its error is not to hide behind itself.
    weight = 1.0 / (around(truth) ** 2 + DARK)
    return [each.figures(weight) for each in halves]


class Halves:
    """Two independent images of a trial, and what a sample of them costs."""

    def __init__(
        self, flat: FlatScene, worker: CellWorker, settings: RenderSettings, learnt: Learnt = NOTHING_LEARNT
    ) -> None:
        self.settings = settings
        view = with_guide(view_of(flat, replace(settings, spp=TRIAL_SAMPLES, passes=1), 1), learnt)
        half = TRIAL_SAMPLES // 2
        images = [_image(worker, replace(view, spp=half, first_sample=first)) for first in (0, half)]
        self.layers = [layers for layers, _ in images]
        samples = TRIAL_SAMPLES * view.camera.width * view.camera.height
        vertices = sum(count for _, count in images) / samples
        self.cost = CAMERA_RAY + view.light_samples * SHADOW_RAY + vertices * (VERTEX + SHADOW_RAY)
        if settings.algorithm.shoots_photons:
            self.cost += GATHER * settings.k * (1.0 + vertices)

    def figures(self, weight: Values) -> Figures:
        """What they tell, with that weight of each pixel's squared error."""
        a, b = self.layers
        indirect = (a["indirect"] * b["indirect"] * weight).mean()  # independent: the square of the truth
        return Figures(self.settings, float(self.noise(weight).mean()), self.cost, max(float(indirect), 0.0))

    def noise(self, weight: Values) -> Values:
        """Of one sample of every pixel, shape [height, width, 3], with that weight of its squared error."""
        a, b = self.layers
        noise: Values = (a["beauty"] - b["beauty"]) ** 2 * weight / 2.0 * (TRIAL_SAMPLES // 2)
        return noise


def _image(worker: CellWorker, view: View) -> tuple[dict[str, Values], int]:
    """The layers of an image, and how many vertices camera paths had beyond the first."""
    worker.set_view(view)
    outbox = worker.start(BucketTask(0, 0, 0, view.camera.width, view.camera.height))
    (rendered,) = (result for result in outbox.results if isinstance(result, BucketRendered))
    layers = {name: np.nan_to_num(rendered.layers[name].astype(np.float64)) for name in ("beauty", "indirect")}
    return layers, worker.cells[0].vertices


def around(image: Values) -> Values:
    """Mean of each pixel and the eight about it, shape [height, width, 3]."""
    height, width = image.shape[:2]
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    total: Values = np.sum([padded[y : y + height, x : x + width] for y in range(3) for x in range(3)], axis=0)
    return total / 9.0
