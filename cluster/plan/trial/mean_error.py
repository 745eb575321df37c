"""What a photon map that gather rays read gets wrong everywhere at once: how far the mean of an image is off by chance.

A room that is lit through a door has its light from those few paths of photons that came in by it. Every gather ray
reads what they left, wherever it lands, and what they bring too much all pixels show too much. Neither samples nor
records average that out, and relMSE hardly knows of it: 1 % of all light is 0.0001, less than the grain of most images,
in which nobody sees it. In the mean of the image, and in that of a region, the grain is gone, and 1 % is seen.

Paths know nothing of each other. If m is what one of them adds to the mean, that of N paths has a relative variance of
(E[m²] / E[m]² - 1) / N. The pilot's paths tell it: camera paths go on to places that light what they see, and m is
what gathers of k photons there have of a path, as far as rays find photons with irradiance. Which photons are asked is
chance as well, and would count as much as theirs does: so m is told twice, by either half of the places, and m² is the
product of both. That is of the light which is read from photons: indirect light, without that which gather rays find by
shadow rays where they land. Such light was scattered once before it came to what is seen, all other more often, and
photons there know how often they were.

How many photons there are is then decided twice: by an image's pixels (map_worth), and by its mean, of which other
things make BESIDES, whatever the photons. Fewer are not taken where that is a loss for the mean, as error times price.
Where thousands of paths light what is seen, as in most rooms with a lamp, the mean is exact enough with any number, and
pixels alone decide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.plan.guide_pilot import pilot_scene, places_of_paths
from wdpm.cluster.plan.photon_pilot import PhotonPilot
from wdpm.cluster.plan.pilot_gathers import PILOT_K
from wdpm.kernels.photons.deposits import GLOBAL_MAP
from wdpm.kernels.photons.flight import BOUNCE_BITS
from wdpm.scenes.flat.flatten import FlatScene

_Values = NDArray[np.float64]

BESIDES = 0.003
"""Relative error of an image's mean that is there whatever the photons: noise of the records' gather rays, blur, and
interpolation. With a million photons means of four rooms that are lit through a door were 0.2 to 0.6 % apart (standard
deviation, 128x128, 16 samples), and 0.3 % off at most."""

REGION = 1024
"""Pixels in whose mean what photons get wrong is seen, if at all: 32 x 32. Of few samples grain is left in that."""

MOST_PLACES = 1024
"""At which gather rays end, to tell what paths bring: of 4096 it was the same to a quarter."""

GOLDEN = 0.6180339887498949
"""Multiples of it, less what is whole of them, are spread evenly, and have no step in common with an image's rows."""

SEEN_PLACES = 256
"""Which tell how much of indirect light is read from photons."""

TWICE = 3
"""Edges from the light to what is seen of light that was scattered twice, or more often, on its way there."""


@dataclass(frozen=True)
class MeanError:
    """How far the mean of an image is off by chance, by photons that gather rays read.

    Attributes:
        of_path: its relative variance in a map of one path.
    """

    of_path: float

    def of(self, paths: float) -> float:
        """Its relative variance in maps of so many paths, those of all passes together."""
        return min(self.of_path / max(paths, 1.0), 1.0)

    def worth(self, paths: float, price: float, of_samples: float) -> float:
        """Error times price of the mean.

        Args:
            of_samples: what samples leave, as relMSE.
        """
        return (BESIDES**2 + of_samples / REGION + self.of(paths)) * price


NO_MEAN_ERROR: Final = MeanError(0.0)


def mean_error(
    flat: FlatScene,
    pilot: PhotonPilot,
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
    indirect: float,
    sites: float,
) -> MeanError:
    """What the pilot tells of it. The replica of its worker has the view.

    Args:
        position, normal: of places that the camera sees, shape [P, 3].
        indirect: the share of indirect light in the image's.
        sites: as cache_worth.sites_about tells it.
    """
    paths = pilot.world.global_map.paths
    if not paths or not len(pilot.photons[GLOBAL_MAP]["id"]) or not len(position):
        return NO_MEAN_ERROR
    brought, all_light = [], 0.0
    for half in _where_gather_rays_land(flat, pilot):
        asked, density, squared = _densities(pilot, *half)
        found = 1.0 - np.exp(-sites / np.maximum(squared, np.finfo(np.float32).tiny))
        brought.append(_of_paths(pilot, asked, density * found))
        all_light += float(density.sum())
    read = [float(half.sum()) for half in brought]
    if not all(read):
        return NO_MEAN_ERROR
    variance = paths * float((brought[0] * brought[1]).sum()) / (read[0] * read[1]) - 1.0
    share = min(indirect, 1.0) * _scattered_again(pilot, position, normal) * sum(read) / all_light
    return MeanError(share**2 * max(variance, 0.0))


Places = tuple[NDArray[np.float32], NDArray[np.float32]]


def _where_gather_rays_land(flat: FlatScene, pilot: PhotonPilot) -> list[Places]:
    """The second places of camera paths, in two halves: position and normal, shape [places, 3]."""
    replica, spp = pilot.cell.replica, pilot.settings.samples_of_pass
    if replica.view is None:
        return []
    paths = places_of_paths(pilot_scene(flat, pilot.cell), replica, replica.view, spp)
    passed = np.zeros(len(paths[0][2]), np.int64)
    positions, normals = [], []
    for position, normal, found in paths:
        second = found & (passed == 1)
        positions.append(position[second])
        normals.append(normal[second])
        passed += found
    position, normal = np.concatenate(positions), np.concatenate(normals)
    # Spread over all: every so many-th is one that paths set out for in the same columns of pixels.
    some = np.argsort(np.arange(len(position)) * GOLDEN % 1.0, kind="stable")[:MOST_PLACES]
    return [(position[some[half::2]], normal[some[half::2]]) for half in (0, 1)]


def _of_paths(pilot: PhotonPilot, asked: NDArray[np.int32], light: _Values) -> _Values:
    """What each of the pilot's paths brings, shape [paths], by what photons bring that are asked."""
    path = pilot.photons[GLOBAL_MAP]["id"] >> BOUNCE_BITS
    return np.bincount(path[asked.reshape(-1)], light.reshape(-1), pilot.world.global_map.paths).astype(np.float64)


def _scattered_again(pilot: PhotonPilot, position: NDArray[np.float32], normal: NDArray[np.float32]) -> float:
    """The share of indirect light at some places that gather rays from there find no shadow rays for."""
    some = np.linspace(0, len(position) - 1, min(SEEN_PLACES, len(position))).astype(np.intp)
    asked, density, _ = _densities(pilot, position[some], normal[some])
    again = density[pilot.photons[GLOBAL_MAP]["edges"][asked] >= TWICE].sum()
    whole = float(density.sum())
    return float(again) / whole if whole else 0.0


def _densities(
    pilot: PhotonPilot, position: NDArray[np.float32], normal: NDArray[np.float32]
) -> tuple[NDArray[np.int32], _Values, _Values]:
    """Which photons gathers at some places ask, what each brings there [W x paths / m²], shape [places, k], and the
    square of how far they lie, shape [places, 1].
    """
    photons = pilot.photons[GLOBAL_MAP]
    asked = pilot.among(GLOBAL_MAP).neighbours(position, normal, pilot.world.extent, PILOT_K)
    flux = np.where(asked >= 0, photons["flux"].mean(axis=1, dtype=np.float64)[asked], 0.0)
    way = photons["position"][asked].astype(np.float64) - position[:, None]
    squared = np.where(asked >= 0, (way**2).sum(axis=2), 0.0).max(axis=1, keepdims=True, initial=0.0)
    area = np.pi * squared
    return asked, np.divide(flux, area, out=np.zeros_like(flux), where=area > 0), squared
