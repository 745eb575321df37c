"""What caustics cost path tracing: the noise that they make there, told by the pilot's caustic photons.

A path finds a caustic backwards: from a diffuse surface it happens to go where mirrors or glass lead to a lamp. It then
carries the radiance L of the lamp, and does so as often as the caustic's irradiance E calls for: with a chance of
E / (pi L). So of many samples hardly one sees the caustic of a small bright lamp, a trial of a few thousand sees none,
and would call the scene easy. But photons know E, and lamps know L: a sample whose radiance is w E of a diffuse surface
(w: the kernels' query weight / pi) has a second moment of pi w² E L. Of lamps without size L is infinite: no path ever
meets them.

Where paths are guided to caustics (plan.caustics), such a sample is the less bright, and the more often met, the more
often its direction is drawn: pi L falls to L cos / p, of the density p of both ways together. That is asked of photons
which taught the guide nothing: those that it knows nothing of make most of the noise.

That is so where light is reflected and refracted in single directions. A rough metal spreads it, shadow rays from there
find the lamp, and trials see what comes of it: E is that of photons in the same scene with its rough metals black. Only
where paths are guided to caustics is that of rough metals told by photons, too: what is left is as rare.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.guide import CausticGuide
from wdpm.cluster.plan.caustics.guide import NO_CAUSTICS_LEARNT, CausticsLearnt, Untaught, cosine_over_both
from wdpm.cluster.plan.effects import calls_for_caustics
from wdpm.cluster.plan.photon_pilot import ENOUGH, LEAST_PATHS, PhotonPilot, caustic_photons_among
from wdpm.cluster.plan.pilot_gathers import AmongPhotons
from wdpm.cluster.plan.small_view import SeenPlaces
from wdpm.cluster.render_settings import RenderSettings
from wdpm.kernels.constants import INV_PI
from wdpm.kernels.features import Features
from wdpm.kernels.materials.types import DIFFUSE
from wdpm.kernels.photons.deposits import CAUSTIC_MAP
from wdpm.kernels.photons.flight import BOUNCE_BITS
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.light_table import LightTable
from wdpm.scenes.flat.material_table import MaterialTable
from wdpm.scenes.model.leaf_kind import BLACK

Values = NDArray[np.float64]


FIREFLIES = 1e-5
"""Of an image's pixels, those that may meet a caustic for it to count by what the others lack: twenty in a
picture of 1920 x 1080. Where errors of images are measured the worst thousandth is left out (`wdpm bench peers`)."""

MOST_LACKED = 5e-3
"""Of an image's light, what may be found by so few."""

LACKED_BESIDE_GRAIN = 0.1
"""Squared error of what the others lack, as a share of what samples leave: light that is missing has a shape, and is
seen where grain of the same error is not."""


@dataclass(frozen=True, eq=False)
class PathCaustics:
    """What path tracing makes of the caustics of an image.

    Attributes:
        noise: that they add to a sample of every pixel, as relMSE.
        hidden: the share of the image's light that no path finds: caustics of lamps without size.
        chance: that a sample of a pixel meets one, shape [pixels].
        share: of them in the image's light.
        square: of what they bring, as relMSE is weighted.
        of_guided: noise as above of all caustics, those of rough surfaces too, where paths are guided to them.
    """

    noise: float
    hidden: float
    chance: Values
    share: float
    square: float
    of_guided: float = 0.0

    @property
    def are_found(self) -> bool:
        """Whether what few paths show has all light in it, or nearly so: little of it is in caustics."""
        return self.hidden + self.share <= MOST_LACKED

    def left(self, spp: int, grain: float) -> float:
        """What they add to the error of an image, as relMSE.

        Where hardly a pixel meets one, all others lack their light, and that is the error that is seen: a few that are
        a million times too bright would otherwise outweigh whatever photons get wrong everywhere.

        Args:
            spp: samples of a pixel.
            grain: that samples leave besides.
        """
        met = float((-np.expm1(-spp * self.chance)).mean()) if len(self.chance) else 0.0
        if met <= FIREFLIES and self.share <= MOST_LACKED and self.square <= LACKED_BESIDE_GRAIN * grain:
            return max(self.square, self.of_guided / spp)
        return max(self.noise, self.of_guided) / spp


MOST_PLACES = 4096
"""At which photons are gathered, of all that a trial has seen."""

FEWER_PATHS = 4
"""Of the pilot's paths, one of so many is flown again among smooth surfaces alone, if that stores ENOUGH photons. On
four scenes noise was told to be 0.9 to 1.3 of what all tell; in a shop where it is a twentieth of all noise, 0.7."""

OTHER_SEED = 0x5EED
"""Changes the seed of photons that try what those of the pilot have taught."""

GREY = 0.5
"""Photons are stored on it; what it reflects of them is no caustic any more."""

NO_CAUSTICS = PathCaustics(0.0, 0.0, np.zeros(0), 0.0, 0.0)


def may_have_caustics(flat: FlatScene, features: Features, settings: RenderSettings) -> bool:
    """Whether a scene may have caustics that smooth surfaces make, which trials of few paths do not know of."""
    return calls_for_caustics(flat, features, settings) and _smooth_alone(flat) is not None


def has_rough_metals(flat: FlatScene) -> bool:
    """Whether anything is rough and glossy, of whose caustics trials see some."""
    return _smooth_alone(flat) is not flat.materials


def caustics_by_paths(
    pilot: PhotonPilot,
    flat: FlatScene,
    places: SeenPlaces,
    truth: Values,
    samples: int,
    epsilon: float,
    learnt: CausticsLearnt = NO_CAUSTICS_LEARNT,
) -> PathCaustics:
    """What caustics cost path tracing.

    Args:
        places: that an image of `samples` samples a pixel has seen.
        truth: that image, or about so, shape [height, width, 3].
        epsilon: added to squared radiance, as in relMSE.
        learnt: where paths will go on to find caustics.
    """
    if not len(places.all("pixel")):
        return NO_CAUSTICS
    seen = _Seen(places, truth, samples)
    of_smooth = _caustics_of_smooth(pilot, flat, seen, epsilon, learnt.guide)
    if learnt.untaught is None:
        return of_smooth
    return replace(of_smooth, of_guided=_noise_of_untaught(learnt.untaught, pilot, seen, epsilon))


class _Seen:
    """Some of the places that an image has seen, and what they bring to its pixels.

    Args:
        places, truth, samples: as of caustics_by_paths.

    Attributes:
        position, normal: of each place.
        weight: of its irradiance in a pixel's radiance.
        radiance: of each pixel.
    """

    def __init__(self, places: SeenPlaces, truth: Values, samples: int) -> None:
        step = -(-len(places.all("pixel")) // MOST_PLACES)
        self.position, self.normal, self._pixel = (places.all(name)[::step] for name in ("position", "normal", "pixel"))
        self.weight = places.all("weight")[::step].mean(axis=1).astype(np.float64) * float(INV_PI)
        self.radiance: Values = truth.mean(axis=2).reshape(-1)
        self._of_each = step / samples

    def by_pixel(self, value: Values) -> Values:
        """The sum of a value of each place, of the mean sample of each pixel."""
        return np.asarray(np.bincount(self._pixel, value, len(self.radiance)) * self._of_each, np.float64)


def _noise_of_untaught(untaught: Untaught, pilot: PhotonPilot, seen: _Seen, epsilon: float) -> float:
    """That caustics make in paths which are guided to them, by photons that half of the others have taught nothing.

    More is left by half of them than by all: noise is told to be twice as much, about. But what is left is rare, and
    bright, and photons know the less of it the rarer it is.
    """
    factors = [np.ones(len(untaught.brought)), untaught.brought]
    told = _irradiance(pilot, untaught.photons, 1, factors, seen.position, seen.normal)
    found, second = seen.by_pixel(seen.weight * told[0]), seen.by_pixel(np.pi * seen.weight**2 * told[1])
    return float((second / (np.maximum(seen.radiance, found) ** 2 + epsilon)).mean())


def _caustics_of_smooth(
    pilot: PhotonPilot, flat: FlatScene, seen: _Seen, epsilon: float, guide: CausticGuide
) -> PathCaustics:
    """What caustics of smooth surfaces cost."""
    smooth = None if not len(pilot.photons[CAUSTIC_MAP]["id"]) else _smooth_alone(flat)
    if smooth is None:
        return NO_CAUSTICS
    photons, light, paths = _photons_by_smooth(smooth, flat, pilot, taught=len(guide) > 0)
    if not len(photons["id"]):
        return NO_CAUSTICS
    bright, weight = _radiance_of(flat.lights), seen.weight
    sized = np.isfinite(bright)
    once = np.divide(1.0, np.pi * bright, out=np.zeros(len(bright)), where=sized & (bright > 0))
    over = cosine_over_both(guide, photons, pilot.cell.replica.launcher) if len(guide) else np.ones(len(light))
    factors = [sized[light], np.where(sized, bright, 0.0)[light] * over, once[light] / over]
    told = _irradiance(pilot, photons, paths, factors, seen.position, seen.normal)
    # A trial may have met no caustic: where photons know that one is, the image is at least as bright.
    values = (weight * told[0], np.pi * weight**2 * told[1], told[2])
    found, second, chance = (seen.by_pixel(value) for value in values)
    hidden = np.zeros(len(found))
    if not sized.all():
        by_sizeless = _irradiance(pilot, photons, paths, [~sized[light]], seen.position, seen.normal)[0]
        hidden = seen.by_pixel(weight * by_sizeless)
    radiance = np.maximum(seen.radiance, found + hidden)
    whole, relative = float(radiance.sum()), 1.0 / (radiance**2 + epsilon)
    return PathCaustics(
        float((second * relative).mean()),
        float(hidden.sum()) / whole if whole > 0 else 0.0,
        chance,
        float(found.sum()) / whole if whole > 0 else 0.0,
        float((found**2 * relative).mean()),
    )


def _smooth_alone(flat: FlatScene) -> MaterialTable | None:
    """The same materials, but what is rough reflects by diffuse parts alone; None if nothing glossy is left.

    The table itself, where nothing glossy is rough. Shadow rays go straight through panes, so these count for nothing,
    but for what they reflect of lamps without size.
    """
    table, sizeless = flat.materials, len(flat.lights.delta_kind) > 0
    kind, value, texture = table.kind.copy(), table.value.copy(), table.texture.copy()
    smooth = rough = False
    for node in range(len(table)):
        leaf = table.leaf(node)
        if leaf is None or not leaf[0].glossy:
            continue
        of, row = leaf
        if of.straight:
            smooth = smooth or sizeless
            continue
        if of.is_smooth(row):
            smooth = True
            continue
        rough = True
        kind[node] = int(DIFFUSE) if of.gathers(row) else BLACK
        value[node], texture[node] = GREY, -1
    if not smooth:
        return None
    return replace(table, kind=kind, value=value, texture=texture) if rough else table


def _photons_by_smooth(
    smooth: MaterialTable, flat: FlatScene, pilot: PhotonPilot, *, taught: bool
) -> tuple[Arrays, NDArray[np.int32], int]:
    """Caustic photons that smooth surfaces make, which light each comes from, and of how many paths they are.

    Args:
        taught: whether the pilot's may have taught what these are to try.
    """
    seed = pilot.world.seed ^ OTHER_SEED if taught else None
    if smooth is flat.materials and not taught:
        photons = pilot.photons[CAUSTIC_MAP]
        return photons, pilot.light_of_path()[photons["id"] >> BOUNCE_BITS], pilot.paths
    few = min(max(pilot.paths // FEWER_PATHS, LEAST_PATHS), pilot.paths)
    photons, light = caustic_photons_among(smooth, pilot, few, seed)
    if few == pilot.paths or len(photons["id"]) >= ENOUGH:
        return photons, light, few
    return *caustic_photons_among(smooth, pilot, pilot.paths, seed), pilot.paths


def _irradiance(
    pilot: PhotonPilot,
    photons: Arrays,
    paths: int,
    factors: Sequence[NDArray[Any]],
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
) -> list[Values]:
    """Of some photons at some places, mean of RGB, by each of up to three factors of the photons: shape [places] each.

    Args:
        paths: of which these photons are.
    """
    flux = photons["flux"].mean(axis=1, dtype=np.float64)
    scaled, units = np.zeros((len(flux), 3), np.float32), []
    for number, factor in enumerate(factors):
        each = flux * factor
        # Flux times radiance may be beyond what float32 holds, though neither is: a power of two changes nothing else.
        units.append(2.0 ** math.frexp(float(each.max(initial=0.0)))[1])
        scaled[:, number] = each / units[-1]
    among = AmongPhotons(pilot.cell, {**photons, "flux": scaled})
    found, _ = among.gather_each(position, normal, pilot.world.extent)
    return [found[:, number].astype(np.float64) * (unit / paths) for number, unit in enumerate(units)]


def _radiance_of(lights: LightTable) -> Values:
    """What paths that meet a light find there, mean by flux [W/(m² sr)], shape [lights]; infinite if none can."""
    power, areas = lights.power, len(lights.prim)
    radiance = np.full(len(power), np.inf)
    edges = lights.corners[:, 1:].astype(np.float64) - lights.corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2.0
    radiance[:areas] = np.divide(power[:areas], np.pi * area, out=np.zeros(areas), where=area > 0)
    if lights.environment_pixels.size:
        sky = lights.environment_pixels.mean(axis=2, dtype=np.float64)
        solid = np.sin((np.arange(len(sky)) + 0.5) / len(sky) * np.pi)[:, None]
        whole = float((sky * solid).sum())
        radiance[-1] = float((sky**2 * solid).sum()) / whole if whole > 0 else 0.0
    by_light = np.bincount(lights.light, power, len(lights.names))
    known = power * np.where(power > 0, radiance, 0.0)
    every = np.bincount(lights.light, known, len(lights.names))
    return np.divide(every, by_light, out=np.zeros(len(by_light)), where=by_light > 0)
