"""What every process of a cluster has a copy of. None of it grows with the scene's triangles or photons.

World is what photons depend on; View is what a camera adds. A cluster that stays up keeps its photons for as long as
the World is the same, and renders any number of Views from them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.kernels.settings import Routing
from wdpm.scenes.model import Bitmap, Camera


@dataclass(frozen=True, eq=False)
class TopTree:
    """The kd-tree of n levels whose 2^n leaves are the cells.

    A complete binary tree in heap order: the children of node i are 2i + 1 and 2i + 2; leaf number c is node
    2^n - 1 + c. A point lies in the left child iff point[axis] < split.

    Attributes:
        axis: int32, shape [2^n - 1].
        split: float32, shape [2^n - 1].
    """

    axis: NDArray[np.int32]
    split: NDArray[np.float32]

    @property
    def cells(self) -> int:
        """How many cells there are."""
        return len(self.axis) + 1


@dataclass(frozen=True, eq=False)
class Materials:
    """Diffuse materials, one a row.

    Attributes:
        reflectance: float32, shape [M, 3].
        texture: index into World.textures or -1, int32, shape [M].
        twosided: 0 or 1, int32, shape [M].
    """

    reflectance: NDArray[np.float32]
    texture: NDArray[np.int32]
    twosided: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Lights:
    """All that emits, one element a row: emitting triangles first, then points.

    Attributes:
        corners: corners of the triangles, float32, shape [E, 3, 3].
        triangle_radiance: radiance from the front, float32, shape [E, 3].
        triangle_light: which light of the scene (for reports), int32, shape [E].
        point_position: float32, shape [P, 3].
        point_intensity: float32, shape [P, 3].
        point_light: which light of the scene, int32, shape [P].
        power: flux of each element, mean of RGB [W], float64, shape [E + P].
        names: of the scene's lights.
    """

    corners: NDArray[np.float32]
    triangle_radiance: NDArray[np.float32]
    triangle_light: NDArray[np.int32]
    point_position: NDArray[np.float32]
    point_intensity: NDArray[np.float32]
    point_light: NDArray[np.int32]
    power: NDArray[np.float64]
    names: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class World:
    """What photons depend on, besides the triangles.

    Attributes:
        emitter_radiance: radiance from the front by emitter number, linear RGB, float32, shape [E, 3].
        extent: largest absolute coordinate of the scene, its lights and its camera, in the renderer's space.
        paths: photon paths to shoot.
        radius: largest gather radius.
        point_area: the area that each surface point stands for (kernels.surface_points).
        band: width of the overlap band; ghosts lie in it. At least `radius` unless the image may be approximate.
    """

    materials: Materials
    textures: tuple[Bitmap, ...]
    lights: Lights
    emitter_radiance: NDArray[np.float32]
    top_tree: TopTree
    extent: float
    seed: int
    max_depth: int | None
    paths: int
    radius: float
    point_area: float
    band: float


@dataclass(frozen=True, eq=False)
class View:
    """What a camera adds to a World."""

    camera: Camera
    seed: int
    spp: int
    light_samples: int
    max_depth: int | None
    k: int
    bucket: int
    routing: Routing
