"""What every process of a cluster has a copy of. None of it grows with the scene's triangles or photons.

World is what photons depend on; View is what a camera adds. A cluster that stays up keeps its photons for as long as
the World is the same, and renders any number of Views from them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wdpm.kernels.features import Features
from wdpm.kernels.settings import Routing
from wdpm.scenes.geometry import Media
from wdpm.scenes.light_table import LightTable
from wdpm.scenes.material_table import MaterialTable
from wdpm.scenes.model import Camera
from wdpm.scenes.textures import Texture


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


@dataclass(frozen=True)
class MapPlan:
    """One photon map.

    Attributes:
        paths: photon paths that are shot for it; 0 for a map that is not made.
        radius: largest gather radius.
        band: width of the overlap band; ghosts lie in it. At least `radius` unless the image may be approximate.
        point_area: the area that each surface point stands for where this map is gathered (kernels.surface_points).
        read: whether anything is gathered from it; where not, its paths are shot for the sake of another map.
    """

    paths: int = 0
    radius: float = 1.0
    band: float = 1.0
    read: bool = True
    point_area: float = 1.0


@dataclass(frozen=True, eq=False)
class Emission:
    """How photons are shared out and aimed.

    Attributes:
        share: probability of each light element in the global pass, float64, shape [elements].
        caustic_share: the same in the caustic pass.
        target_center: spheres that hold all surfaces with a glossy part, float32, shape [S, 3].
        target_radius: float32, shape [S].
    """

    share: NDArray[np.float64]
    caustic_share: NDArray[np.float64]
    target_center: NDArray[np.float32]
    target_radius: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class World:
    """What photons depend on, besides the triangles.

    Photon paths are numbered from 0: those of the global map first (they make the volume map as well), then those of
    the caustic map.

    Attributes:
        features: what kernels are compiled for.
        extent: largest absolute coordinate of the scene, its lights and its camera, in the renderer's space.
        volume_unit: what one counts for in the exact sums of beams (kernels.beam) [W / (sr m²)].
        strict: whether the first guard that acts ends the render (cluster.guards).
    """

    features: Features
    materials: MaterialTable
    textures: tuple[Texture, ...]
    lights: LightTable
    media: Media
    top_tree: TopTree
    extent: float
    seed: int
    max_depth: int | None
    emission: Emission
    global_map: MapPlan
    caustic_map: MapPlan
    volume_map: MapPlan
    volume_unit: float
    strict: bool = False

    @property
    def maps(self) -> tuple[MapPlan, MapPlan, MapPlan]:
        """By the numbers of kernels.photon_paths."""
        return self.global_map, self.caustic_map, self.volume_map

    @property
    def paths(self) -> int:
        """All photon paths."""
        return self.global_map.paths + self.caustic_map.paths


@dataclass(frozen=True, eq=False)
class View:
    """What a camera adds to a World."""

    camera: Camera
    seed: int
    spp: int
    light_samples: int
    max_depth: int | None
    k: int
    caustic_k: int
    volume_samples: int
    bucket: int
    routing: Routing
    way: int = 0
