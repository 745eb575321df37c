"""What a trial sees without photons: the view in a few pixels, by paths and by photon mapping less its maps.

It takes a tenth of a second, and tells what samples leave by each, what they cost, and how much of the light is
indirect. Where that is enough to know that photons cannot pay, none are flown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wdpm.cluster.guide import CausticGuide
from wdpm.cluster.plan.light_guide import Learnt
from wdpm.cluster.plan.map_worth import MapError
from wdpm.cluster.plan.path_caustics import NO_CAUSTICS, PathCaustics
from wdpm.cluster.plan.small_view import Figures, Halves, SeenPlaces, Values, box_blurred, relmse_epsilon, small_camera
from wdpm.cluster.plan.trial.figures import Trial
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.cluster.work.worker import CellWorker
from wdpm.kernels.camera.pixel_filter import noise_left
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.model.scene import Camera, PixelFilter

CHOICE_SAMPLES = 1 << 12
LEAST_PIXELS = 512
"""Camera samples of a trial by each way to render, of so many pixels at least."""

LEAST_SAMPLES, MOST_SAMPLES = 2, 8
"""Of each pixel in each half of a trial, by each way to render, within these bounds as many as the render has: they are
spread over lamps and directions, and what a sample adds to the noise is the less the more there are."""


FAINT_INDIRECT = 0.5
"""Square of indirect light, as a share of the error that samples leave, up to which photons need not be steered: maps
of few get a fifth of that square wrong, which is a tenth of that error then. Of a bunny, gold and glass under the sky
(256x256, one sample, four seeds) images took 0.95 of the CPU time without steering, with the same error."""


@dataclass(frozen=True, eq=False)
class Looks:
    """A small image by each way to render, without photons.

    Attributes:
        places: that photon mapping would ask its maps at.
        photons: what it finds besides.
        paths: what path tracing finds.
        truth: what both come to, about, shape [height, width, 3].
        epsilon: added to squared radiance, as in relMSE.
        by_photons: figures of photon mapping, with Indirect.MAP.
        by_paths: figures of path tracing.
        samples: of each pixel, in both halves.
    """

    places: SeenPlaces
    photons: Halves
    paths: Halves
    truth: Values
    epsilon: float
    by_photons: Figures
    by_paths: Figures
    samples: int

    def trial(
        self,
        caustics: PathCaustics = NO_CAUSTICS,
        unread: float = 0.0,
        map_errors: Sequence[MapError | None] = (None, None),
        bias: float = 0.0,
        caustic_grain: float = 0.0,
    ) -> Trial:
        """All that is known, with what photons tell: see Trial. Without that, at the best for photon mapping."""
        weight = self._weight
        noises = (
            self.photons.noise(weight).mean(axis=2),
            self.paths.noise(weight).mean(axis=2),
            self.paths.noise(weight, "indirect").mean(axis=2),
        )
        even = self.places.even
        return Trial(
            self.by_photons,
            self.by_paths,
            caustics,
            even,
            unread,
            map_errors,
            bias,
            caustic_grain,
            noises,
            self.places.uneven(self.truth.shape[:2]),
        )

    def guided_trial(self, trial: Trial, guided: Halves, caustics: PathCaustics) -> Trial:
        """The same with path tracing that is guided to caustics, as photons tell it to be.

        Its noise is that of paths which are not guided, where that is less: these hardly ever meet caustics of smooth
        surfaces, whose noise photons tell. Guided ones do, and it would count twice.

        Args:
            guided: what it finds.
            caustics: what it then makes of them.
        """
        figures = guided.figures(self._weight)
        figures = replace(figures, noise=min(figures.noise, self.by_paths.noise))
        by_photons, _, of_indirect = trial.noises
        noises = (by_photons, guided.noise(self._weight).mean(axis=2), of_indirect)
        return replace(trial, caustics=caustics, noises=noises, by_guided=figures)

    def indirect_is_faint(self, spp: int) -> bool:
        """Whether it hardly matters, beside the noise of so many samples, where photons tell of indirect light."""
        return self.by_paths.indirect <= FAINT_INDIRECT * self.by_photons.noise / spp

    @property
    def share_of_indirect(self) -> float:
        """Of the light of all pixels together; 1 where paths have met none."""
        indirect, whole = (
            np.mean([half[name].mean() for half in self.paths.layers]) for name in ("indirect", "beauty")
        )
        return float(indirect / whole) if whole > 0 else 1.0

    @property
    def _weight(self) -> Values:
        """Of squared errors, as in relMSE."""
        weight: Values = 1.0 / (self.truth**2 + self.epsilon)
        return weight


def look(flat: FlatScene, worker: CellWorker, photons: RenderSettings, paths: RenderSettings, learnt: Learnt) -> Looks:
    """Render a small image twice in each way: figures by one and the same idea of the truth.

    Args:
        worker: that has the whole scene in one cell, and no photons.
        learnt: how shadow rays choose among lights.
    """
    samples = 2 * min(max(photons.samples_of_pass, LEAST_SAMPLES), MOST_SAMPLES)
    looking, places = replace(flat, camera=_few_pixels(flat.camera, _pixels(samples))), SeenPlaces()
    worker.replica.observer = places
    left = noise_left(flat.camera.filter)
    photon_halves = Halves(looking, worker, replace(photons, indirect=Indirect.MAP), learnt, samples, left)
    worker.replica.observer = None
    path_halves = Halves(looking, worker, paths, learnt, samples, left)
    # A pixel that one sample made bright is as bright as those around it: its error is not to hide behind itself.
    by_path = path_halves.layers
    indirect = np.mean([half["indirect"] for half in by_path], axis=0)
    images = [half["beauty"] for half in by_path] + [half["beauty"] + indirect for half in photon_halves.layers]
    truth = box_blurred(np.mean(images, axis=0))
    epsilon = relmse_epsilon(truth)
    weight = 1.0 / (truth**2 + epsilon)
    by_photons, by_paths = photon_halves.figures(weight), path_halves.figures(weight)
    return Looks(places, photon_halves, path_halves, truth, epsilon, by_photons, by_paths, samples)


def look_by_guided_paths(
    flat: FlatScene, worker: CellWorker, looks: Looks, learnt: Learnt, guide: CausticGuide
) -> Halves:
    """The small image twice once more, by paths that are guided to caustics.

    Args:
        worker: that has the whole scene in one cell, and no photons.
    """
    looking = replace(flat, camera=_few_pixels(flat.camera, _pixels(looks.samples)))
    left = noise_left(flat.camera.filter)
    return Halves(looking, worker, looks.by_paths.settings, learnt, looks.samples, left, guide)


def _pixels(samples: int) -> int:
    """Of a trial of so many samples each."""
    return max(CHOICE_SAMPLES // samples, LEAST_PIXELS)


def _few_pixels(camera: Camera, pixels: int) -> Camera:
    """Some pixels of the image, spread over it: each as small as it is there, or all would lie on edges."""
    few = small_camera(camera, pixels)
    return replace(few, filter=PixelFilter(radius=PixelFilter().radius * few.width / camera.width))
