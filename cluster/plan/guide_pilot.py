"""The pilot of a guide: places that camera paths come to, and rays from them to the lights.

It is one computation of the whole scene in one cell, whatever the cluster; it depends on scene, camera, seed, size of
the image and samples of a pass alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.guide import LightGuide
from wdpm.cluster.plan.regions import Regions
from wdpm.cluster.work.cell import Cell
from wdpm.cluster.work.misses import no_hits, start_paths
from wdpm.cluster.work.replica import Replica
from wdpm.cluster.world import View
from wdpm.kernels import columns
from wdpm.kernels.camera import guide_pilot
from wdpm.kernels.camera.rays import Rays
from wdpm.kernels.lights import guide
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.material_facts import facts

Array = NDArray[np.float64]

MOST_PATHS = 4096
"""Camera paths, at most; some fifteen thousand places."""

LEAST_PATHS = 1024

SAMPLES_A_PATH = 256
"""Camera samples of a pass for which there is a path, within these bounds: what a path asks for is some two hundred
rays, a tenth of what so many samples do."""

BOUNCES = 4
"""Places of a path."""

RAYS = 12
"""Rays from each place to the environment in a round."""

RAYS_TO_LIGHTS = 16
"""Rays from each place to all lights together, but one to each at least."""


@dataclass(frozen=True, eq=False)
class Looks:
    """Rays from places to the environment, [places, rays].

    Attributes:
        tile: in which each ended.
        square: of the cosine at the place; 0 where nothing arrives.
        weight: density without a guide over that by which the ray was chosen.
    """

    tile: NDArray[np.int32]
    square: Array
    weight: Array

    def of(self, chosen: NDArray[np.bool_]) -> Looks:
        """Those of some places."""
        return Looks(self.tile[chosen], self.square[chosen], self.weight[chosen])

    def and_also(self, others: Looks) -> Looks:
        """These, and other ones from the same places."""
        tile, square = np.hstack([self.tile, others.tile]), np.hstack([self.square, others.square])
        return Looks(tile, square, np.hstack([self.weight, others.weight]))


@dataclass(frozen=True, eq=False)
class LightLooks:
    """What arrives at places from each of what a walk to a light may start with, and each light infinitely far away.

    Attributes:
        square: mean of cosine² of the rays from a place to a choice, 0 for those that do not arrive, [places, choices].
        chance: probability of the choice at the place without a guide, [places, choices].
        heads: how many choices are heads of the light tree: the first.
    """

    square: Array
    chance: Array
    heads: int


def factors(chance: Array, mass: Array) -> Array:
    """Probability of each tile in each region over that without a guide, shape [regions, tiles]."""
    whole = mass.reshape(-1)
    return np.divide(chance, whole, out=np.ones_like(chance), where=whole > 0)


class GuidePilot:
    """Places, and rays from them.

    Args:
        cell: the whole scene.
        view: as the replica of the cell has it.
        spp: samples a pixel of a pass.

    Attributes:
        position, normal: of the places, float32, shape [N, 3].
        mass: probability of each tile of the environment without a guide, shape [rows, columns]; [0, 0] without one.
    """

    def __init__(self, flat: FlatScene, cell: Cell, view: View, spp: int) -> None:
        self._replica = cell.replica
        self._seed = wp.uint32(view.seed)
        sky = cell.replica.tiled_sky
        self.mass = sky.mass if sky.pixels.size else np.zeros((0, 0))
        self._scene = pilot_scene(flat, cell)
        places = places_of_paths(self._scene, cell.replica, view, spp)
        self.position = np.concatenate([position[found] for position, _, found in places])
        self.normal = np.concatenate([normal[found] for _, normal, found in places])

    @property
    def _device(self) -> str:
        return self._replica.launcher.device

    def _on_device(self, step: int = 1) -> dict[str, Any]:
        """Every so many-th place, as kernels take them."""
        return {
            "position": wp.array(np.ascontiguousarray(self.position[::step]), dtype=wp.vec3, device=self._device),
            "normal": wp.array(np.ascontiguousarray(self.normal[::step]), dtype=wp.vec3, device=self._device),
        }

    def look(self, number: int, known: LightGuide) -> Looks:
        """A round of rays to the environment from every place, chosen by what is known."""
        count = len(self.position) * RAYS
        tile = wp.empty(count, dtype=wp.int32, device=self._device)
        cosine = wp.empty(count, dtype=wp.float32, device=self._device)
        self._replica.launcher(
            guide_pilot.look_at_environment,
            count,
            scene=self._scene,
            environment=self._replica.tiled_environment(),
            guide=guide.upload(**vars(known), sky=self._replica.tiled_sky, device=self._device),
            **self._on_device(),
            first=number * RAYS,
            rays=RAYS,
            seed=self._seed,
            tile_out=tile,
            cosine_out=cosine,
        )
        tiles = tile.numpy().reshape(-1, RAYS)
        weight = np.ones(tiles.shape)
        if len(known):
            factor = factors(known.chance.reshape(len(known), -1).astype(np.float64), self.mass)
            region = Regions(known.axis, known.split, []).of(self.position)
            weight = 1.0 / factor[region[:, None], tiles]
        return Looks(tiles, cosine.numpy().astype(np.float64).reshape(-1, RAYS) ** 2, weight)

    def look_at_lights(self, step: int = 1) -> LightLooks:
        """Rays from every so many-th place to each head of the light tree and each light infinitely far away."""
        lights = self._replica.lights
        choices = lights.tree.head_count + lights.count - lights.first_distant
        rays = max(1, RAYS_TO_LIGHTS // choices)
        count = len(self.position[::step]) * rays * choices
        cosine, chance = (wp.empty(count, dtype=wp.float32, device=self._device) for _ in range(2))
        self._replica.launcher(
            guide_pilot.look_at_lights,
            count,
            scene=self._scene,
            lights=lights,
            **self._on_device(step),
            rays=rays,
            seed=self._seed,
            cosine_out=cosine,
            chance_out=chance,
        )
        shape = (-1, rays, choices)
        square = (cosine.numpy().astype(np.float64) ** 2).reshape(shape).mean(axis=1)
        return LightLooks(square, chance.numpy().astype(np.float64).reshape(shape)[:, 0], lights.tree.head_count)


Places = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]


def places_of_paths(scene: Any, replica: Replica, view: View, spp: int) -> list[Places]:
    """Where paths from evenly spread pixels come to, by bounce: position, normal, shape [paths, 3], and whether there
    is a place, shape [paths].

    Args:
        scene: pilot_scene's.
        replica: which has the view.
        spp: samples a pixel of a pass.
    """
    pixels, device = view.camera.width * view.camera.height, replica.launcher.device
    count = min(MOST_PATHS, max(LEAST_PATHS, pixels * spp // SAMPLES_A_PATH))
    arrays = {
        "slot": np.arange(count, dtype=np.int32),
        "pixel": ((2 * np.arange(count, dtype=np.int64) + 1) * pixels // (2 * count)).astype(np.int32),
        "sample": np.arange(count, dtype=np.int32),  # of small images pixels have several
        **no_hits(count, view),
    }
    paths = start_paths(replica, columns.upload(Rays, arrays, device), count)
    found = []
    for bounce in range(BOUNCES):
        position, normal = (wp.empty(count, dtype=wp.vec3, device=device) for _ in range(2))
        replica.launcher(
            guide_pilot.walk_on,
            count,
            scene=scene,
            bounce=bounce,
            seed=wp.uint32(view.seed),
            origin=paths.origin,
            direction=paths.direction,
            position_out=position,
            normal_out=normal,
        )
        here = normal.numpy()
        found.append((position.numpy(), here, here.any(axis=1)))
    return found


def pilot_scene(flat: FlatScene, cell: Cell) -> Any:
    """What the pilot's rays meet (kernels.camera.guide_pilot.PilotScene): the whole scene, which the cell has."""
    scene = guide_pilot.PilotScene()
    scene.trees, scene.surfaces = cell.geometry
    through = _through(flat)
    scene.through = wp.array(through, dtype=wp.int32, device=cell.replica.launcher.device)
    scene.passing = int((through == 2).any())
    scene.far_away = cell.replica.lights.far_away
    return scene


def _through(flat: FlatScene) -> NDArray[np.int32]:
    """PilotScene.through of each material."""
    every = facts(flat.materials, flat.textures)
    return np.array([2 if fact.calls_for("passing") else int(fact.transmits) for fact in every], np.int32)
