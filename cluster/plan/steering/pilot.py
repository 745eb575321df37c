"""A pilot whose photons are steered, where that pays: most of them towards places that light what the camera sees.

Under the open sky nearly all photons fall where nobody looks, and those that light a room come in by its windows.
Lights do not know which these are, but a camera path does: from where it comes to first, it goes on to places that
light that one. The light there is shared out among the nearest photons of a few thousand paths, and a path is of as
much use as its photons have of it. A tree over the numbers that paths set out by (kernels.lights.steering) learns which
are of use. Where half of the paths, judged by what the others teach, leave little enough of the second moment, more
paths are flown, steered by it, which see what hardly one saw before; and so on for as long as that helps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays
from wdpm.cluster.plan.guide_pilot import pilot_scene, places_of_paths
from wdpm.cluster.plan.light_shares import measured_emission
from wdpm.cluster.plan.photon_pilot import PhotonPilot, flown_again, photons_with_direct
from wdpm.cluster.plan.pilot_gathers import PILOT_K, AmongPhotons
from wdpm.cluster.plan.steering.caustics import steered_caustics
from wdpm.cluster.plan.steering.numbers import start_numbers
from wdpm.cluster.plan.steering.tree import Array, Known
from wdpm.cluster.world import NO_STEERING, Emission, Steering, View, World
from wdpm.kernels.maths.random import PURPOSE_EMISSION
from wdpm.kernels.photons.deposits import GLOBAL_MAP
from wdpm.kernels.photons.flight import BOUNCE_BITS
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.used_media import calls_for_media

INDOORS = 0.5
"""Photons that a path stores from which on lights shine on what encloses them, where hardly any path is of no use."""

FIRST_PATHS = 1 << 13
"""Of a first look, which tells whether more is worth while."""

ROUNDS = 4
"""At most, of as many paths as the pilot has."""

BOUNCES = 2
"""Of these paths: what comes in by a window lights walls as well."""

FEW = 0.1
"""Part of the paths that may do for all: a tree gains a good part of what that leaves."""

GOES_ON = 0.8
"""Second moment of the paths' use that a round must leave, of that by what was known before, to call for another."""

PROMISES = 0.4
"""And of that unsteered, after the first round; half as much after the second, and so on, or it is given up."""

WORTH = 0.1
"""The same, in the end. Photons that are not alike make gathers noisy, since a few heavy ones count for many: where a
sixth was left, as in rooms that the sky lights by their windows, that took all the gain; where a tenth or less, squared
errors of images were a half to a sixth of what they had been."""

LEAST_PLACES = 64
"""Places that tell anything."""

REFLECTED = 0.5
"""What a place counts beside the one that it lights."""


def steered_pilot(flat: FlatScene, pilot: PhotonPilot, view: View, *, is_faint: bool = False) -> PhotonPilot:
    """The pilot, flown again with steered photons where that pays.

    Args:
        view: which the replica of the pilot's worker has from now on.
        is_faint: whether what the global map gets wrong is not seen beside the samples: then its photons are not.
    """
    pilot.worker.set_view(view)
    if pilot.left is not None or calls_for_media(flat):
        return pilot
    if pilot.settings.unsteered:
        return pilot.as_it_is()
    world = replace(pilot.world, emission=measured_emission(pilot.world, pilot.flux_by_light()))
    samples = flat.camera.width * flat.camera.height * pilot.settings.samples_of_pass
    known = Known() if is_faint else _steered(flat, world, pilot, view)
    caustics = steered_caustics(world, pilot, samples)
    if not (len(known.tree) or len(caustics.tree)):
        return pilot.as_it_is()
    emission = replace(world.emission, steering=known.tree, caustic_steering=caustics.tree)
    return flown_again(flat, replace(world, emission=emission), pilot, known.left, caustics.left)


def _steered(flat: FlatScene, world: World, pilot: PhotonPilot, view: View) -> Known:
    """How photons of the global map are steered; nothing known where that does not pay."""
    known = Known()
    if not world.global_map.paths or len(pilot.photons[GLOBAL_MAP]["id"]) > INDOORS * pilot.paths:
        return known
    places = _lighting_places(flat, pilot, view)
    if len(places.weight) < LEAST_PLACES:
        return known
    known.add(NO_STEERING, *_flown(world, pilot, places, FIRST_PATHS))
    if known.share_of_use() <= FEW:
        known = _learnt(world, pilot, places)
    return known if known.left <= WORTH else Known()


def _learnt(world: World, pilot: PhotonPilot, places: _Places) -> Known:
    """What rounds of paths teach, each steered by what those before have taught."""
    known = Known()
    for halved in range(ROUNDS):
        emission = replace(world.emission, steering=known.tree)
        known.add(known.tree, *_flown(replace(world, emission=emission), pilot, places, max(pilot.paths, FIRST_PATHS)))
        if not known.learn(GOES_ON) or known.left > PROMISES / 2**halved:
            break
    return known


def steering_in_words(pilot: PhotonPilot) -> tuple[str, ...]:
    """What was chosen, for people; nothing where photons are not steered."""
    emission, words = pilot.world.emission, []
    if len(emission.steering) and pilot.left is not None:
        words.append(
            f"photons steered among {_parts(emission.steering)} parts of what lights send out, which leaves "
            f"{pilot.left:.2g} of the second moment of what they bring to where it is of use"
        )
    if len(emission.caustic_steering):
        words.append(
            f"caustic photons steered among {_parts(emission.caustic_steering)} parts, which leaves "
            f"{pilot.caustics_left:.2g} of the second moment of what paths store"
        )
    return tuple(words)


def _parts(tree: Steering) -> int:
    return int((tree.lower == 0).sum())


def emission_of(pilot: PhotonPilot) -> Emission:
    """How a render's photons are shared out, and steered."""
    emission = pilot.world.emission
    if len(emission.steering) or len(emission.caustic_steering):
        return emission
    return measured_emission(pilot.world, pilot.flux_by_light())


@dataclass(frozen=True, eq=False)
class _Places:
    """Places whose light counts: position and normal, shape [P, 3], and how much, shape [P]."""

    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    weight: Array


def _lighting_places(flat: FlatScene, pilot: PhotonPilot, view: View) -> _Places:
    """Where camera paths come to behind the first place, whose direct light is no matter of photons."""
    spp = pilot.settings.samples_of_pass
    paths = places_of_paths(pilot_scene(flat, pilot.cell), pilot.cell.replica, view, spp)
    passed = np.zeros(len(paths[0][2]), np.int64)
    positions, normals, weight = [], [], []
    for position, normal, found in paths:
        wanted = found & (passed > 0)
        positions.append(position[wanted])
        normals.append(normal[wanted])
        weight.append(REFLECTED ** (passed[wanted] - 1.0))
        passed += found
    return _Places(np.concatenate(positions), np.concatenate(normals), np.concatenate(weight))


def _flown(world: World, pilot: PhotonPilot, places: _Places, count: int) -> tuple[Array, Array]:
    """Some paths that set out in a world: by which numbers, shape [paths, START_NUMBERS], and of what use each is."""
    use = _use(pilot, photons_with_direct(world, pilot, count, BOUNCES), places, count)
    return start_numbers(pilot, world.emission.steering, world.seed, PURPOSE_EMISSION, count), use


def _use(pilot: PhotonPilot, photons: Arrays, places: _Places, count: int) -> Array:
    """What of the light at the places comes by each of some paths, shape [paths]."""
    if not len(photons["id"]):
        return np.zeros(count)
    asked = AmongPhotons(pilot.cell, photons).neighbours(places.position, places.normal, pilot.world.extent, PILOT_K)
    flux = np.where(asked >= 0, photons["flux"].mean(axis=1, dtype=np.float64)[asked], 0.0)
    whole = flux.sum(axis=1, keepdims=True)
    part = np.divide(flux, whole, out=np.zeros_like(flux), where=whole > 0) * places.weight[:, None]
    path = photons["id"] >> BOUNCE_BITS
    return np.bincount(path[asked.reshape(-1)], part.reshape(-1), count).astype(np.float64)
