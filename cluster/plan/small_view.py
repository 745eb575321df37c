"""What a trial looks at before a render is planned: the view in few pixels, without photons, and twice."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.guide import NO_CAUSTIC_GUIDE, CausticGuide
from wdpm.cluster.plan.light_guide import NOTHING_LEARNT, Learnt, with_guide
from wdpm.cluster.plan.photon_pilot import PhotonPilot
from wdpm.cluster.plan.view import view_of
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.task import BucketRendered, BucketTask
from wdpm.cluster.work.worker import CellWorker
from wdpm.cluster.world import IrradiancePlan, MapPlan, View
from wdpm.kernels import columns
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.model.scene import Camera, PixelFilter

Values = NDArray[np.float64]

TRIAL_SAMPLES = 2
"""Of each pixel, in two halves: of a trial that tells how noisy one sample is."""

BY_CHANCE = 0.01
"""Share of a trial's pixels whose noise counts for no more than that of the noisiest others."""

RELMSE_EPSILON = 0.01
"""Added to squared radiance, as in relMSE: noise in the dark is not worth as much."""

DIMMEST, BRIGHTEST = 0.03, 2.0
"""Radiance, as the logarithmic mean of a picture, between which it can be looked at as it is. Others are looked at with
an exposure that brings them there, whatever unit their lamps are in, and what is dark is told by that."""


@contextmanager
def without_photons(pilot: PhotonPilot) -> Iterator[CellWorker]:
    """The pilot's worker in the same world with no photon map, for as long as the context lasts."""
    world, worker = pilot.world, pilot.worker
    nothing = replace(world, global_map=MapPlan(), caustic_map=MapPlan(), volume_map=MapPlan())
    worker.adopt(replace(nothing, irradiance=IrradiancePlan()))
    try:
        yield worker
    finally:
        worker.adopt(world)


def small_camera(camera: Camera, pixels: int) -> Camera:
    """The same view in some `pixels` pixels, each with samples of its own; as it is if it has no more."""
    whole = math.sqrt(pixels / (camera.width * camera.height))
    if whole >= 1.0:
        return replace(camera, filter=PixelFilter())
    size = [max(round(side * whole), 1) for side in (camera.width, camera.height)]
    if camera.crop is None or camera.full_size is None:
        return replace(camera, width=size[0], height=size[1], filter=PixelFilter())
    shrunk = [size[0] / camera.width, size[1] / camera.height]
    left, top, _, _ = camera.crop
    full = (max(round(camera.full_size[0] * shrunk[0]), size[0]), max(round(camera.full_size[1] * shrunk[1]), size[1]))
    crop = (
        min(round(left * shrunk[0]), full[0] - size[0]),
        min(round(top * shrunk[1]), full[1] - size[1]),
        size[0],
        size[1],
    )
    return replace(camera, width=size[0], height=size[1], crop=crop, full_size=full, filter=PixelFilter())


class SeenPlaces:
    """An observer of a worker (cluster.work.replica.Observer) that keeps where camera paths ask for photons.

    Attributes:
        even: the share of these places whose diffuse part irradiance tells of (LeafKind.even); 1 of none.
    """

    def __init__(self) -> None:
        none: dict[str, NDArray[Any]]  # where the camera sees nothing but sky, nobody asks
        none = {name: np.zeros((0, 3), np.float32) for name in ("position", "normal", "weight")}
        none |= {"even": np.zeros(0, np.bool_), "pixel": np.zeros(0, np.int32), "sample": np.zeros(0, np.int32)}
        self._found: list[Mapping[str, NDArray[Any]]] = [none]

    @property
    def even(self) -> float:
        even = np.concatenate([found["even"] for found in self._found])
        return float(even.mean()) if len(even) else 1.0

    def uneven(self, shape: tuple[int, int]) -> Values:
        """Of what each pixel reflects diffusely, the part that records do not serve; 0 of nothing.

        Args:
            shape: height and width of the image.
        """
        pixel, weight = self.all("pixel"), self.all("weight").mean(axis=1, dtype=np.float64)
        whole, served = (
            np.bincount(pixel, part, shape[0] * shape[1]).reshape(shape) for part in (weight, weight * self.all("even"))
        )
        share: Values = 1.0 - np.divide(served, whole, out=np.ones(shape), where=whole > 0)
        return share

    def shaded(self, scene: Any, orders: Any, rays: Any, shaded: Any) -> None:  # noqa: ARG002
        queries = shaded.queries
        asks = queries.weight.numpy().max(axis=1) > 0
        found: dict[str, NDArray[Any]]
        found = {name: getattr(queries, name).numpy()[asks] for name in ("position", "normal", "weight")}
        found["even"] = np.ones(len(found["weight"]), np.bool_)
        if columns.are_there(shaded.coats):
            found["even"] = columns.column(shaded.coats, "even")[asks]
            found["weight"] = found["weight"] * columns.column(shaded.coats, "reflectance")[asks]
        self._found.append(found | {name: getattr(rays, name).numpy()[asks] for name in ("pixel", "sample")})

    def gathered(self, number: int, queries: Any, count: Any, radius: Any, truncated: Any) -> None:
        """Nothing: trials have no maps that could be asked."""

    def all(self, name: str) -> NDArray[Any]:
        """Of all places: position, normal and weight, shape [places, 3], or pixel, sample and even, shape [places]."""
        return np.concatenate([found[name] for found in self._found])


@dataclass(frozen=True)
class Figures:
    """What a trial tells of one integrator.

    Attributes:
        settings: that were tried.
        noise: of one sample of every pixel, as relMSE.
        of_indirect: the part of it that indirect light makes.
        vertices: of a sample, beyond the first.
        light_samples: shadow rays of a sample at the first one.
        indirect: the mean square of indirect light, as relMSE is weighted; of photons, without their maps, 0.
        of_direct: the part of the noise that direct light makes.
    """

    settings: RenderSettings
    noise: float
    of_indirect: float
    vertices: float
    light_samples: int
    indirect: float
    of_direct: float = 0.0


class Halves:
    """Two independent images of a trial.

    Args:
        learnt: how shadow rays choose among lights.
        samples: of each pixel, in both.
        noise_left: the variance that the image's pixel filter leaves of that of samples (pixel_filter.noise_left); a
            trial's own samples count in one pixel alone.
        guide: to caustics, of paths.

    Attributes:
        layers: of each image.
        light_samples: shadow rays of a camera sample.
    """

    def __init__(
        self,
        flat: FlatScene,
        worker: CellWorker,
        settings: RenderSettings,
        learnt: Learnt = NOTHING_LEARNT,
        samples: int = TRIAL_SAMPLES,
        noise_left: float = 1.0,
        guide: CausticGuide = NO_CAUSTIC_GUIDE,
    ) -> None:
        self._settings = settings
        self._noise_left = noise_left
        self._half = samples // 2
        view = with_guide(view_of(flat, replace(settings, spp=samples, passes=1, pass_samples=()), 1), learnt)
        self.layers, vertices = _halves(worker, replace(view, spp=self._half, caustic_guide=guide))
        self._vertices = vertices / (samples * view.camera.width * view.camera.height)
        self.light_samples = view.light_samples

    def figures(self, weight: Values) -> Figures:
        """What they tell, with that weight of each pixel's squared error."""
        a, b = self.layers
        indirect = (a["indirect"] * b["indirect"] * weight).mean()  # independent: the square of the truth
        noise, of_indirect, of_direct = (
            mean_but_for_chance(self.noise(weight, layer).mean(axis=2)) for layer in ("beauty", "indirect", "direct")
        )
        settings = replace(self._settings, light_samples=self.light_samples)
        of_indirect, indirect = min(of_indirect, noise), max(float(indirect), 0.0)
        return Figures(settings, noise, of_indirect, self._vertices, self.light_samples, indirect, of_direct)

    def noise(self, weight: Values, layer: str = "beauty") -> Values:
        """Of one sample of every pixel, shape [height, width, 3], with that weight of its squared error."""
        a, b = self.layers
        noise: Values = (a[layer] - b[layer]) ** 2 * weight / 2.0 * self._half * self._noise_left
        return noise


def relmse_epsilon(image: Values) -> float:
    """What is added to squared radiance for an image to be weighed as it is looked at, shape [height, width, 3].

    So lamps that are all a thousand times weaker lead to the same decisions, and to the same picture but for that.
    """
    radiance = image.mean(axis=2)
    lit = radiance[radiance > 1e-6 * radiance.max()]
    if not lit.size:
        return RELMSE_EPSILON
    middle = math.exp(float(np.log(lit).mean()))
    return float(RELMSE_EPSILON * (middle / min(max(middle, DIMMEST), BRIGHTEST)) ** 2)


def mean_but_for_chance(of_pixels: Values) -> float:
    """Mean noise of pixels of which the noisiest count as those that are next to them: one sample decides nothing."""
    return float(np.minimum(of_pixels, np.quantile(of_pixels, 1.0 - BY_CHANCE)).mean())


def _halves(worker: CellWorker, view: View) -> tuple[list[dict[str, Values]], int]:
    """The layers of two images, of the view's samples and of as many more, and how many vertices camera paths had.

    Both are rendered at once: so few samples take the interpreter as long as the kernels.
    """
    worker.set_view(view)
    samples = [range(first, first + view.spp) for first in (0, view.spp)]
    outbox = worker.start(BucketTask(0, 0, 0, view.camera.width, view.camera.height), samples)
    (rendered,) = (result for result in outbox.results if isinstance(result, BucketRendered))
    both = {name: np.nan_to_num(rendered.layers[name].astype(np.float64)) for name in ("beauty", "direct", "indirect")}
    images = [{name: np.split(layer, 2)[half] for name, layer in both.items()} for half in (0, 1)]
    return images, worker.cells[0].vertices


def box_blurred(image: Values) -> Values:
    """Mean of each pixel and the eight about it, shape [height, width, 3]."""
    height, width = image.shape[:2]
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    total: Values = np.sum([padded[y : y + height, x : x + width] for y in range(3) for x in range(3)], axis=0)
    return total / 9.0
