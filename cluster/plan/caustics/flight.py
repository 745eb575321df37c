"""Photons that tell paths where caustics come from that they may find."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.plan.caustics.rough_alone import rough_alone
from wdpm.cluster.plan.light_shares import pilot_emission
from wdpm.cluster.plan.photon_pilot import PhotonPilot, first_paths, flown_photons, in_world, photons_with_direct
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.work.photon_home import emitted_photons
from wdpm.cluster.world import MapPlan, World
from wdpm.kernels.photons.deposits import CAUSTIC_MAP
from wdpm.kernels.photons.flight import BOUNCE_BITS
from wdpm.scenes.flat.flatten import FlatScene

WANTED = 512
"""Photons that tell where a scene's caustics come from."""

FEWEST = 16
"""With fewer photons from the first paths there are no caustics to speak of, or none that more paths would tell of."""

MOST_PHOTONS = 4096
"""That are looked at: of more, every so many-th."""

SAMPLES_A_PATH = 16
"""Camera samples of a pass for each path, at most: of each pass they take some hundredths of what its samples do."""

MOST_PATHS = 1 << 19

OTHER_PATHS, OTHER_BOUNCES = 1 << 13, 4
"""That tell how much other light there is."""

_LEAST_COSINE = 1e-6
_SHORTEST = 1e-3  # of a photon's whole way, that the last part of it is taken to be


@dataclass(frozen=True, eq=False)
class CausticPhotons:
    """Photons that came to diffuse surfaces by glossy ones alone.

    Attributes:
        position, normal, direction: where each landed, and the direction that it came from, float32, shape [P, 3].
        flux: mean of RGB, over the number of paths [W], float64, shape [P].
        light: that it comes from, int32, shape [P].
        near, far: how far back it was reflected last, and how long its way from the lamp was, about; float32, [P].
    """

    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    direction: NDArray[np.float32]
    flux: NDArray[np.float64]
    light: NDArray[np.int32]
    near: NDArray[np.float32]
    far: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.flux)

    def take(self, rows: NDArray[np.intp]) -> CausticPhotons:
        """Some of them."""
        return CausticPhotons(**{name: column[rows] for name, column in vars(self).items()})

    @property
    def cosine(self) -> NDArray[np.float64]:
        """Of each photon's direction to the surface's normal, above 0."""
        return np.maximum((self.normal * self.direction).sum(axis=1, dtype=np.float64), _LEAST_COSINE)

    def area(self, irradiance: NDArray[np.float64]) -> NDArray[np.float64]:
        """That each photon stands for, where all of them together make so much irradiance."""
        return np.divide(self.flux, irradiance, out=np.zeros(len(self)), where=irradiance > 0)

    def as_arrays(self) -> Arrays:
        """As gathers take them."""
        flux = np.repeat(self.flux.astype(np.float32)[:, None], 3, axis=1)
        ids = np.arange(len(self), dtype=np.int64)
        return {"id": ids, "position": self.position, "normal": self.normal, "flux": flux}

    def scaled(self, times: float) -> CausticPhotons:
        """With so many times the flux."""
        return replace(self, flux=self.flux * times)


def caustic_photons(flat: FlatScene, settings: RenderSettings, pilot: PhotonPilot) -> CausticPhotons | None:
    """Fly photons until they are WANTED, or as many paths as are worth it; None where there are hardly any.

    Of lamps that a path may meet by all that is glossy, and of points, spots and suns by what is rough: shadow rays
    find these from there.

    Args:
        pilot: whose worker flies them.
    """
    worlds = _worlds(flat, pilot)
    most = MOST_PHOTONS // max(len(worlds), 1)
    flown = [found for world in worlds if (found := _wanted_photons(world, flat, settings, pilot, most)) is not None]
    if len(flown) < 2:
        return flown[0] if flown else None
    columns = {name: np.concatenate([vars(photons)[name] for photons in flown]) for name in vars(flown[0])}
    return CausticPhotons(**columns)


def _wanted_photons(
    world: World, flat: FlatScene, settings: RenderSettings, pilot: PhotonPilot, looked_at: int
) -> CausticPhotons | None:
    """As caustic_photons, in a world.

    Args:
        looked_at: photons, at most.
    """
    paths = first_paths(flat, settings)
    found = _photons(world, paths, pilot, looked_at)
    if len(found) < FEWEST:
        return None
    samples = flat.camera.width * flat.camera.height * settings.samples_of_pass
    most = min(MOST_PATHS, max(paths, samples // SAMPLES_A_PATH))
    wanted = min(most, paths * WANTED // len(found))
    if wanted > paths:
        found = _photons(world, wanted, pilot, looked_at)
    return found


def other_photons(flat: FlatScene, pilot: PhotonPilot) -> tuple[Arrays, NDArray[np.bool_]]:
    """Photons of all other light, their flux over the number of paths; and which of them came straight from a lamp.

    They leave the lamps by power, however those of the pilot are shared out: what is learnt is the same beside photon
    mapping, which a trial compares with, as in a render by paths.
    """
    world = replace(pilot.world, emission=pilot_emission(flat, aimed=False))
    photons = photons_with_direct(world, pilot, OTHER_PATHS, OTHER_BOUNCES)
    return {**photons, "flux": photons["flux"] / np.float32(OTHER_PATHS)}, photons["edges"] == 1


def _worlds(flat: FlatScene, pilot: PhotonPilot) -> list[World]:
    """The pilot's world with caustic photons alone that paths may find: of lamps with an extent, and of others."""
    lights = flat.lights
    sized = np.zeros(len(lights.power), np.bool_)
    sized[: len(lights.prim)] = True
    if lights.environment_pixels.size:
        sized[-1] = True
    emission, every = pilot_emission(flat, aimed=True, known=pilot.world.emission), (sized, ~sized)
    worlds = []
    for materials, lamps in zip((flat.materials, rough_alone(flat.materials)), every, strict=True):
        share = np.where(lamps, emission.caustic_share, 0.0)
        if materials is not None and share.sum() > 0:
            shone = replace(emission, caustic_share=share / share.sum())
            alone = replace(pilot.world, emission=shone, global_map=MapPlan(0), volume_map=MapPlan(0))
            worlds.append(replace(alone, materials=materials))
    return worlds


def _photons(world: World, paths: int, pilot: PhotonPilot, looked_at: int) -> CausticPhotons:
    """What some paths store in a world, and where each of these photons set out; of more than are looked at some."""
    with in_world(replace(world, caustic_map=MapPlan(paths)), pilot) as worker:
        stored = flown_photons(worker)[CAUSTIC_MAP]
        flight = emitted_photons(worker.replica, 0, paths)
    path = stored["id"] >> BOUNCE_BITS
    start, out = (getattr(flight, name).numpy()[path].astype(np.float64) for name in ("origin", "direction"))
    position, direction = stored["position"].astype(np.float64), stored["direction"].astype(np.float64)
    near, far = _way_back(position, direction, start, out, stored["edges"] == 2)
    found = CausticPhotons(
        stored["position"],
        stored["normal"],
        stored["direction"],
        stored["flux"].mean(axis=1, dtype=np.float64) / paths,
        flight.light.numpy()[path],
        near.astype(np.float32),
        far.astype(np.float32),
    )
    step = max(-(-len(found) // looked_at), 1)
    return found.take(np.arange(0, len(found), step)).scaled(step)


def _way_back(
    position: NDArray[np.float64],
    direction: NDArray[np.float64],
    start: NDArray[np.float64],
    out: NDArray[np.float64],
    once: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """CausticPhotons.near and far.

    A photon that was reflected once was so where the ray on which it set out meets the one on which it came: the point
    of the latter that is nearest to the former, as both are rounded. Of others the straight way to the lamp tells.

    Args:
        once: which photons were.
    """
    way = position - start
    straight = np.linalg.norm(way, axis=1)
    out = out / np.linalg.norm(out, axis=1)[:, None]
    along, back, forth = (direction * out).sum(axis=1), (direction * way).sum(axis=1), (out * way).sum(axis=1)
    apart = 1.0 - along**2
    near = np.divide(along * forth - back, apart, out=straight / 2.0, where=once & (apart > 1e-9))
    near = np.clip(near, _SHORTEST * straight, None)
    before = np.linalg.norm(position + direction * near[:, None] - start, axis=1)
    return near, np.maximum(np.where(once, near + before, straight), near)
