"""A worker's copy of what every process has, on its device."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.world import View, World
from wdpm.kernels import camera, cells, lights, texture
from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.launch import Launcher


@dataclass(eq=False)
class Replica:
    """A worker's copy of the World, on its device, and the View of the moment.

    Attributes:
        worker: its number.
        paths_by_light: photon paths that its homes have started, by light.
    """

    world: World
    launcher: Launcher
    worker: int
    view: View | None = None
    camera: Any = None
    paths_by_light: NDArray[np.int64] = field(init=False)
    cells: Any = field(init=False)
    lights: Any = field(init=False)
    textures: Any = field(init=False)

    def __post_init__(self) -> None:
        world, device = self.world, self.launcher.device
        tree, lamps = world.top_tree, world.lights
        self.paths_by_light = np.zeros(len(lamps.names), np.int64)
        self.cells = cells.upload(tree.axis, tree.split, self.pad, device)
        self.lights = lights.upload(
            lamps.corners,
            lamps.triangle_radiance,
            lamps.point_position,
            lamps.point_intensity,
            np.concatenate([lamps.triangle_light, lamps.point_light]),
            lamps.power,
            world.extent,
            device,
        )
        self.textures = texture.upload(world.textures, device)

    @property
    def pad(self) -> float:
        """How far boxes are grown (constants.PAD_SHARE)."""
        return self.world.extent * PAD_SHARE

    def set_view(self, view: View) -> None:
        """Look through another camera."""
        self.view = view
        self.camera = camera.upload(view.camera, view.seed, self.launcher.device)
