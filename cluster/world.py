"""What every process of a cluster has a copy of. None of it grows with the scene's triangles or photons.

World is what photons depend on; View is what a camera adds. A cluster that stays up keeps its photons for as long as
the World is the same, and renders any number of Views from them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.allotment import NO_ALLOTMENT, NO_LAMP_OUTLINES, Allotment, LampOutlines
from wdpm.cluster.guide import NO_CAUSTIC_GUIDE, NO_GUIDE, CausticGuide, LightGuide
from wdpm.cluster.lit_places import NO_LIT_PLACES, LitPlaces
from wdpm.cluster.records import NO_CACHE, CachePlan
from wdpm.cluster.render_settings import Routing
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.features import Features
from wdpm.scenes.flat.arrays import Media
from wdpm.scenes.flat.light_table import LightTable
from wdpm.scenes.flat.material_table import MaterialTable
from wdpm.scenes.model.scene import Camera
from wdpm.scenes.model.textures import Texture


@dataclass(frozen=True, eq=False)
class Outlines:
    """Boxes around all that each cell holds, those near each other together (kernels.rays.outlines).

    Attributes:
        first: of the boxes of each cell, and the end of the last, int32, shape [cells + 1]; empty where nothing is
            known, and each cell may hold something anywhere.
        low, high: corners of boxes, float32, shape [N, 3].
        plane: number of the plane that all in a box lies in, int32, shape [N]; -1 for none.
        normal: unit normals of planes, float64, shape [P, 3].
        slab: between which distances along the normal it lies, and from how far the plane is asked, float64,
            shape [P, 3].
    """

    first: NDArray[np.int32]
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    plane: NDArray[np.int32]
    normal: NDArray[np.float64]
    slab: NDArray[np.float64]

    def __len__(self) -> int:
        """How many boxes there are."""
        return len(self.low)


NO_OUTLINES = Outlines(
    np.zeros(0, np.int32),
    np.zeros((0, 3), np.float32),
    np.zeros((0, 3), np.float32),
    np.zeros(0, np.int32),
    np.zeros((0, 3), np.float64),
    np.zeros((0, 3), np.float64),
)
"""Nothing is known of the cells."""


@dataclass(frozen=True, eq=False)
class TopTree:
    """The kd-tree of n levels whose 2^n leaves are the cells.

    A complete binary tree in heap order: the children of node i are 2i + 1 and 2i + 2; leaf number c is node
    2^n - 1 + c. A point lies in the left child iff point[axis] < split.

    Attributes:
        axis: int32, shape [2^n - 1].
        split: float32, shape [2^n - 1].
        outlines: of what the cells hold.
    """

    axis: NDArray[np.int32]
    split: NDArray[np.float32]
    outlines: Outlines = NO_OUTLINES

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
        point_area: the area that each surface point stands for where this map is gathered (surface_points.py).
        read: whether anything is gathered from it; where not, its paths are shot for the sake of another map.
        point_set: which of many sets of such points; each pass of a render has another.
    """

    paths: int = 0
    radius: float = 1.0
    band: float = 1.0
    read: bool = True
    point_area: float = 1.0
    point_set: int = 0


@dataclass(frozen=True)
class IrradiancePlan:
    """Irradiance that is computed ahead, at some photons of the global map, for gather rays to read.

    Attributes:
        share: of the photons of the global map, that have it; 0 for a map that gather rays do not read.
        k: photons that the estimate at such a photon looks for.
        caustic_k: the same, of the caustic map.
        reach: how far from a place the photon may lie whose irradiance is taken for that of the place.
        longest: edges of the longest paths that bring light worth mentioning to photons; 0 where paths have no limit.
    """

    share: float = 0.0
    k: int = 1
    caustic_k: int = 1
    reach: float = 0.0
    longest: int = 0


@dataclass(frozen=True)
class PhotonPlan:
    """What changes from one pass of a progressive render to the next: the photons, and how far they are gathered.

    Attributes:
        Each as in World.
    """

    seed: int
    global_map: MapPlan
    caustic_map: MapPlan
    volume_map: MapPlan
    volume_unit: float
    irradiance: IrradiancePlan = IrradiancePlan()


NO_REGIONS: NDArray[np.float32] = np.empty((0, 2, 3), np.float32)
"""Of maps that are built of all photons."""


START_NUMBERS = 6
"""Numbers that a photon sets out by (kernels.lights.steering)."""

STEERING_LEVELS = 20
"""Of a tree, at most. A car on a large field is a millionth of what parallel light of all directions falls on."""


@dataclass(frozen=True, eq=False)
class Steering:
    """How photons of the global map are steered: a tree that halves the cube of these numbers. The root is node 0.

    Attributes:
        axis: along which a node is halved, int32, shape [nodes].
        lower: number of the node of the lower half, greater than its own, and the upper half's is one more; 0 of a
            leaf; int32, shape [nodes].
        split: where a node is cut, as a part of its width, float64, shape [nodes].
        chance: of the lower half, float64, shape [nodes].
    """

    axis: NDArray[np.int32]
    lower: NDArray[np.int32]
    split: NDArray[np.float64]
    chance: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.axis)


NO_STEERING = Steering(np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0, np.float64), np.empty(0, np.float64))
"""Of photons that leave lights in proportion to what these shine."""


@dataclass(frozen=True, eq=False)
class Emission:
    """How photons are shared out and aimed.

    Attributes:
        share: probability of each light element in the global pass, float64, shape [elements].
        caustic_share: the same in the caustic pass.
        target_center: spheres that hold all surfaces with a glossy part, float32, shape [S, 3].
        target_radius: float32, shape [S].
        steering: of photons of the global pass.
        caustic_steering: of the caustic pass.
    """

    share: NDArray[np.float64]
    caustic_share: NDArray[np.float64]
    target_center: NDArray[np.float32]
    target_radius: NDArray[np.float32]
    steering: Steering = NO_STEERING
    caustic_steering: Steering = NO_STEERING


@dataclass(frozen=True, eq=False)
class World:
    """What photons depend on, besides the triangles.

    Photon paths are numbered from 0: those of the global map first (they make the volume map as well), then those of
    the caustic map.

    Attributes:
        features: what kernels are compiled for.
        extent: largest absolute coordinate of the scene, its lights and its camera, in the renderer's space.
        volume_unit: what one counts for in the exact sums of beams (kernels.photons.beam) [W / (sr m²)].
        unit: the scene's length of the renderer's unit (renderer_space.py), that lengths and fluxes are told with.
        strict: whether the first guard that acts ends the render (cluster.work.guards).
        stores_direct: whether the global map holds photons straight from the lights too. A pilot's alone does: in
            images direct light comes by shadow rays.
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
    irradiance: IrradiancePlan = IrradiancePlan()
    unit: float = 1.0
    strict: bool = False
    stores_direct: bool = False

    @property
    def maps(self) -> tuple[MapPlan, MapPlan, MapPlan]:
        """By the numbers of kernels.photons.deposits."""
        return self.global_map, self.caustic_map, self.volume_map

    @property
    def paths(self) -> int:
        """All photon paths."""
        return self.global_map.paths + self.caustic_map.paths

    @property
    def gathers_ahead(self) -> bool:
        """Whether the global map is read ahead alone, for irradiance at photons: no vertex asks it itself.

        Those that do are on surfaces with a coat, or ask for photons of shorter paths than others (final_gather).
        """
        return self.irradiance.share > 0 and not self.features.coated and self.max_depth is None

    @property
    def photon_plan(self) -> PhotonPlan:
        """What may change while triangles, materials and lights stay."""
        return PhotonPlan(*(getattr(self, field.name) for field in fields(PhotonPlan)))

    def with_photons(self, plan: PhotonPlan) -> Self:
        """The same scene with other photons."""
        return replace(self, **{field.name: getattr(plan, field.name) for field in fields(PhotonPlan)})


@dataclass(frozen=True, eq=False)
class View:
    """What a camera adds to a World.

    Attributes:
        first_sample: number of the first of the `spp` samples of each pixel.
        diffuse_light: where the indirect light of diffuse parts comes from.
        cache: how irradiance records are made.
        guide: how shadow rays choose among lights.
        allotment: the samples of each part of the image, in multiples of `spp` where there are beams; where there is
            none, all pixels take `spp`.
        lit_places: where gather rays of irradiance records are worth while.
        outlines: pixels that take some times as many samples as the View or its allotment says.
        caustic_share: about 1 of so many samples of a pixel asks the caustic map, for all of them; a power of two.
        caustic_guide: where paths go on from diffuse surfaces to find caustics.
    """

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
    diffuse_light: DiffuseLight = DiffuseLight.PHOTON_MAP
    first_sample: int = 0
    cache: CachePlan = NO_CACHE
    guide: LightGuide = NO_GUIDE
    allotment: Allotment = NO_ALLOTMENT
    lit_places: LitPlaces = NO_LIT_PLACES
    outlines: LampOutlines = NO_LAMP_OUTLINES
    caustic_share: int = 1
    caustic_guide: CausticGuide = NO_CAUSTIC_GUIDE

    @property
    def caustic_turn(self) -> tuple[int, int]:
        """Of each run of so many samples of a pixel, how many ask the caustic map: the first, for all of the run.

        Every pixel takes whole runs, or what it shows would be brighter or darker by what is missing.
        """
        if self.caustic_share == 1:
            return 1, 1
        counts = (self.allotment.first, self.allotment.count) if len(self.allotment) else (self.first_sample, self.spp)
        run = int(np.gcd.reduce([np.gcd.reduce(np.ravel(each)) for each in counts])) or 1
        return run, -(-run // self.caustic_share)
