"""Where paths are to go on from diffuse surfaces to find caustics, and whether that is worth it.

Path tracing finds a caustic by going, from a diffuse surface, where something glossy leads to a lamp. Of a small bright
lamp in a metal that is nearly a mirror, or in glass, that hardly ever happens, and then it is a firefly. A few hundred
photons tell, of each region of space, where caustics come from: each becomes a lobe of directions (kernels.photons.
lobes), and a part of the rays that go on is drawn from the lobes (kernels.camera.caustic_guide).

It is on where it leaves clearly less of the second moment of what rays that go on bring: photons taught, and others
tried. Where caustics are dim, or as wide as all other light, other light would only get noisier.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.guide import NO_CAUSTIC_GUIDE, CausticGuide
from wdpm.cluster.plan.caustics.flight import CausticPhotons, caustic_photons, other_photons
from wdpm.cluster.plan.effects import has_caustics
from wdpm.cluster.plan.photon_pilot import PhotonPilot
from wdpm.cluster.plan.pilot_gathers import AmongPhotons
from wdpm.cluster.plan.regions import Regions, divide
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.world import View
from wdpm.kernels.camera import caustic_guide
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.lobes import TOLD, WIDER, fit_lobes
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.used_media import calls_for_media

Values = NDArray[np.float64]

LOBES_A_REGION = 48
"""Least lobes of a region; it has less than twice as many. All are asked for the density of a direction, and fewer
photons would tell less of each other's lobes."""

NOISE_OF_LOBES = 4.0
"""Root of the second moment of what rays drawn from lobes bring, over the caustics' irradiance: 1 if lobes were just as
light is. Photons that did not teach told 1.8 to 3.3 in five scenes; what no photon of the pilot told of makes more."""

LEAST_PART, MOST_PART = 0.04, 0.2
"""Of the rays that go on where there are lobes, drawn from these: within these bounds as leaves the least sum of both
second moments, of caustics by lobes and of other light by the cosine. With up to 0.5 other light was noisier than that
tells, as its samples are stratified."""

WORTH = 0.6
"""Second moment with a guide over that without, above which it is not worth its time: rays that go on make a part of
all noise, and other light is more uneven than is known here. In a room with a dull ball of metal under a point 0.65 was
said to be left, and error times time was 1.1 times as much."""

LEAST_EDGES = 3
"""Of a path that a guide is of use for: to a diffuse surface, to what mirrors a lamp, to the lamp."""


@dataclass(frozen=True, eq=False)
class Untaught:
    """Caustic photons of which a guide by as many others was taught nothing.

    Attributes:
        photons: their flux over the number of paths.
        brought: by a ray that goes on to where such a photon came from, as a radiance that one by the cosine would
            bring: the less, the more often rays are drawn that way [photons].
    """

    photons: Arrays
    brought: Values


@dataclass(frozen=True, eq=False)
class CausticsLearnt:
    """A guide, and what it is expected to bring.

    Attributes:
        guide: NO_CAUSTIC_GUIDE where it would not pay, or nothing was to be learnt.
        left: second moment with it over that without; 1 where none was tried.
        untaught: photons that tried it, of a guide that pays.
    """

    guide: CausticGuide = NO_CAUSTIC_GUIDE
    left: float = 1.0
    untaught: Untaught | None = None

    @property
    def words(self) -> tuple[str, ...]:
        """What was chosen, for people; nothing where there was no choice."""
        if len(self.guide):
            return (
                f"paths go on to where caustics come from, by {len(self.guide.rim):,} lobes in {len(self.guide):,} "
                f"regions, which leaves {self.left:.2f} of the second moment of what they find",
            )
        if self.left < 1.0:
            return (f"paths not guided to caustics, which would leave {self.left:.2f} of the second moment",)
        return ()


NO_CAUSTICS_LEARNT = CausticsLearnt()


def learn_caustics(flat: FlatScene, settings: RenderSettings, view: View, pilot: PhotonPilot) -> CausticsLearnt:
    """Fly photons, and learn from them, if paths are to find caustics.

    Scenes with media have none: a lobe would lead through fog that it knows nothing of.

    Args:
        pilot: whose worker has the whole scene in one cell, and flies them.
    """
    if view.diffuse_light != DiffuseLight.PATHS or not has_caustics(flat, pilot.world.features):
        return NO_CAUSTICS_LEARNT
    if calls_for_media(flat) or (view.max_depth is not None and view.max_depth < LEAST_EDGES):
        return NO_CAUSTICS_LEARNT
    photons = caustic_photons(flat, settings, pilot)
    if photons is None:
        return NO_CAUSTICS_LEARNT
    light = _light_at(photons, flat, pilot)
    left, untaught = _moment(photons, light, pilot.cell.replica.launcher)
    if not left <= WORTH:
        return CausticsLearnt(left=left)
    return CausticsLearnt(guide_of(photons, light, pilot.cell.replica.launcher), left, untaught)


@dataclass(frozen=True, eq=False)
class _Light:
    """Irradiance where photons landed [W/m²], mean of RGB, shape [photons] each.

    Attributes:
        caustics: by all caustics of lamps with an extent.
        others: by way of diffuse surfaces.
        lamps: straight from lamps.
    """

    caustics: Values
    others: Values
    lamps: Values

    def take(self, rows: NDArray[np.intp]) -> _Light:
        """At some of them."""
        return _Light(self.caustics[rows], self.others[rows], self.lamps[rows])


def _light_at(photons: CausticPhotons, flat: FlatScene, pilot: PhotonPilot) -> _Light:
    """The light where photons landed."""
    others, direct = other_photons(flat, pilot)

    def irradiance(among: Arrays) -> Values:
        if not len(among["id"]):
            return np.zeros(len(photons))
        found, _ = AmongPhotons(pilot.cell, among).gather(photons.position, photons.normal, pilot.world.extent)
        return found.astype(np.float64)

    return _Light(
        irradiance(photons.as_arrays()),
        irradiance({name: column[~direct] for name, column in others.items()}),
        irradiance({name: column[direct] for name, column in others.items()}),
    )


@dataclass(frozen=True, eq=False)
class _Lobes:
    """Lobes of photons, in the order of their regions.

    Attributes:
        photon: of each lobe, int64, shape [lobes].
        region: likewise.
        radiance: that the photon came with, about, as those that came alike tell.
    """

    photon: NDArray[np.intp]
    region: NDArray[np.int64]
    target: NDArray[np.float32]
    rim: NDArray[np.float32]
    radiance: Values


def _fitted(photons: CausticPhotons, light: _Light, regions: Regions, launcher: Launcher) -> _Lobes:
    """A lobe for each photon. Of so many in its region TOLD came from within its lobe's own width: from as bright."""
    region = regions.of(photons.position)
    order = np.argsort(region, kind="stable")
    photons, region = photons.take(order), region[order]
    count = np.bincount(region, minlength=len(regions.axis) + 1)
    first = np.concatenate([[0], np.cumsum(count)])
    device = launcher.device
    target, rim = (wp.empty(len(photons), dtype=kind, device=device) for kind in (wp.vec3, wp.float32))
    numbers = {"light": photons.light, "first": first.astype(np.int32), "region": region.astype(np.int32)}
    launcher(
        fit_lobes,
        len(photons),
        position=wp.array(photons.position, dtype=wp.vec3, device=device),
        direction=wp.array(photons.direction, dtype=wp.vec3, device=device),
        **{name: wp.array(column, dtype=wp.int32, device=device) for name, column in numbers.items()},
        near=wp.array(photons.near, dtype=wp.float32, device=device),
        far=wp.array(photons.far, dtype=wp.float32, device=device),
        target_out=target,
        rim_out=rim,
    )
    width = rim.numpy()
    solid = 2.0 * np.pi * width.astype(np.float64) / float(WIDER)
    radiance = light.caustics[order] * (float(TOLD) / count[region]) / (solid * photons.cosine)
    return _Lobes(order, region, target.numpy(), width, radiance)


def guide_of(photons: CausticPhotons, light: _Light, launcher: Launcher) -> CausticGuide:
    """Lobes for what is brighter than all that rays which go on by the cosine find on the mean: they find the rest."""
    regions = divide(photons.position, LOBES_A_REGION)
    lobes = _fitted(photons, light, regions, launcher)
    mean = (light.caustics + light.others)[lobes.photon] / np.pi
    use = np.maximum(1.0 - np.divide(mean, lobes.radiance, out=np.ones(len(mean)), where=lobes.radiance > mean), 0.0)
    weight, kept = photons.flux[lobes.photon] * use, np.flatnonzero(use > 0)
    nodes = len(regions.axis) + 1
    whole = np.bincount(lobes.region, weight, nodes)
    other = np.bincount(lobes.region, (photons.area(light.caustics) * light.others)[lobes.photon], nodes)
    noise = NOISE_OF_LOBES * whole
    part = np.divide(noise, noise + other, out=np.zeros(nodes), where=noise > 0)
    count = np.bincount(lobes.region[kept], minlength=nodes)
    return CausticGuide(
        regions.axis,
        regions.split,
        np.concatenate([[0], np.cumsum(count)]).astype(np.int32),
        lobes.target[kept],
        lobes.rim[kept],
        (weight[kept] / whole[lobes.region[kept]]).astype(np.float32),
        np.where(whole > 0, np.clip(part, LEAST_PART, MOST_PART), 0.0).astype(np.float32),
    )


def _moment(photons: CausticPhotons, light: _Light, launcher: Launcher) -> tuple[float, Untaught]:
    """Second moment of what rays that go on bring, with what every other photon teaches over that without.

    The rest of the photons try it, and are given back. Each came with a radiance, and stands for the area that its flux
    lights. Places count by the relative error of what they show, dark ones for less.
    """
    lobes = _fitted(photons, light, divide(photons.position, LOBES_A_REGION), launcher)
    radiance = np.empty(len(photons))
    radiance[lobes.photon] = lobes.radiance
    teaching, trying = np.arange(0, len(photons), 2), np.arange(1, len(photons), 2)
    known = guide_of(photons.take(teaching), light.take(teaching), launcher)
    tried, seen, radiance = photons.take(trying), light.take(trying), radiance[trying]
    cosine, (by_lobes, part) = tried.cosine, _densities(known, tried.position, tried.direction, launcher)
    both = (1.0 - part) * cosine / np.pi + part * by_lobes
    without = seen.others**2 + seen.caustics * radiance * np.pi
    with_guide = seen.others**2 / (1.0 - part) + seen.caustics * radiance * cosine / both
    square = (seen.caustics + seen.others + seen.lamps) ** 2
    weight = np.divide(
        tried.area(seen.caustics), square + square.mean(), out=np.zeros(len(tried)), where=square + square.mean() > 0
    )
    whole = float(weight @ without)
    untaught = Untaught(tried.scaled(2.0).as_arrays(), radiance * cosine / np.pi / both)
    return (float(weight @ with_guide) / whole if whole > 0 else 1.0), untaught


def cosine_over_both(guide: CausticGuide, photons: Arrays, launcher: Launcher) -> Values:
    """Of the directions that photons came from: density of rays that go on by the cosine, over that with a guide."""
    by_lobes, part = _densities(guide, photons["position"], photons["direction"], launcher)
    cosine = (photons["normal"] * photons["direction"]).sum(axis=1, dtype=np.float64) / np.pi
    both = (1.0 - part) * cosine + part * by_lobes
    return np.divide(cosine, both, out=np.ones(len(both)), where=(cosine > 0) & (both > 0))


def _densities(
    guide: CausticGuide, position: NDArray[np.float32], direction: NDArray[np.float32], launcher: Launcher
) -> tuple[Values, Values]:
    """With which lobes make some directions at some places, and the part of rays drawn from lobes there."""
    device, count = launcher.device, len(position)
    pdf, part = (wp.empty(count, dtype=wp.float32, device=device) for _ in range(2))
    launcher(
        caustic_guide.guided_pdfs,
        count,
        guide=caustic_guide.upload(**vars(guide), device=device),
        position=wp.array(position, dtype=wp.vec3, device=device),
        direction=wp.array(direction, dtype=wp.vec3, device=device),
        pdf_out=pdf,
        part_out=part,
    )
    return pdf.numpy().astype(np.float64), part.numpy().astype(np.float64)
