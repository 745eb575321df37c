"""A worker's copy of what every process has, on its device."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.cluster.guide import LightGuide
from wdpm.cluster.host_cache import CacheEntry, HostCache, name_of
from wdpm.cluster.records import NO_RECORDS, Records
from wdpm.cluster.world import View, World
from wdpm.kernels.camera import camera, caustic_guide
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.vertices import Orders
from wdpm.kernels.compile import ready_kernels
from wdpm.kernels.constants import PAD_SHARE
from wdpm.kernels.features import ALL, Features
from wdpm.kernels.irradiance import record_tree
from wdpm.kernels.irradiance.record_tree import IrradianceCache
from wdpm.kernels.launch import Launcher
from wdpm.kernels.lights import environment, guide, lights, steering
from wdpm.kernels.materials import medium, resolve, texture
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.photons.emit_photons import EmitScene
from wdpm.kernels.rays import cells
from wdpm.kernels.rays.cell_triangles import Surfaces
from wdpm.kernels.variants import Variants
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.flat.material_sides import even_sides
from wdpm.scenes.model.scene import Camera


class Observer(Protocol):
    """Who looks over a worker's shoulder. What it is shown changes with the next launch: it copies what it keeps."""

    def shaded(self, scene: Any, orders: Any, rays: Any, shaded: Any) -> None:
        """Vertices on surfaces of a cell were shaded.

        Args:
            scene: kernels.camera.scene.Scene, in the cell.
            orders: kernels.camera.vertices.Orders.
            rays: kernels.camera.rays.Rays or paths.Paths that came.
            shaded: kernels.camera.vertices.Shaded.
        """

    def gathered(self, number: int, queries: Any, count: Any, radius: Any, truncated: Any) -> None:
        """Some of the vertices that were shaded last asked a map.

        Args:
            number: of the map.
            queries: kernels.camera.vertices.Queries; count, radius, truncated: as gather_kernel gives them, one a
                vertex.
        """


class Replica:
    """A worker's copy of the World, on its device, and the View of the moment.

    Args:
        worker: its number.
        host_cache: what workers on this machine that hold the same make once for all of them.
        trace_all: traces all photon paths into the only cell: who shares a scene does it where it must go on alone.
        of_all: what all workers on this machine make once, whatever they hold: textures.

    Attributes:
        kernels: compiled for the features of the World and the view's camera.
        outputs: features of which its kernels that shade write the arrays; no fewer than the view's.
        cells, textures, media, materials, lights: structs of kernels.rays.cells, materials.texture, materials.medium,
            materials.nodes and lights.elements, on the device.
        even_sides: of each material, as scenes.flat.material_sides has them.
        emit_scene: what emission needs.
        tiled_sky: the environment as guides divide it.
        camera: kernels.camera.camera.CameraView of the view.
        records: irradiance records of the view.
        paths_by_light: photon paths that its homes have started, by pass (global, caustic) and light.
        observer: is shown what happens at the vertices of camera paths, for replays; None in a render.
    """

    kernels: Variants
    outputs: Features
    emit_scene: EmitScene
    materials: Any
    even_sides: NDArray[np.int32]

    def __init__(
        self,
        world: World,
        launcher: Launcher,
        worker: int,
        host_cache: HostCache,
        trace_all: Callable[[], None],
        of_all: HostCache,
    ) -> None:
        self.world = world
        self.launcher = launcher
        self.worker = worker
        self.host_cache = host_cache
        self.trace_all = trace_all
        self.view: View | None = None
        self.camera: Any = None
        self.observer: Observer | None = None
        self.records = NO_RECORDS
        self._record_tree: Any = None
        self._view_lights: Any = None
        self._caustics: Any = None
        self._bare_scene: Any = None
        self._orders: dict[tuple[int, DiffuseLight, bool], Any] = {}
        self._tiled_environment: Any = None
        device, tree = launcher.device, world.top_tree
        self._choose_kernels(world.features)
        self.paths_by_light = np.zeros((2, len(world.lights.names)), np.int64)
        outlines = vars(tree.outlines) if len(tree.outlines.first) else None
        self.cells = cells.upload(tree.axis, tree.split, self.pad, device, outlines)
        (self.textures,) = of_all.get(_textures(lambda: texture.upload(world.textures, device)))
        self.media = medium.upload(world.media, device)
        self.lights = lights.upload(world.lights, world.extent, device)
        self.tiled_sky = guide.TiledSky(world.lights.environment_pixels)
        self.update_materials()
        self.update_emission()

    def lend_textures(self, host_cache: HostCache) -> Sequence[Any]:
        """Have workers that share this cache map the textures that lie here; what keeps them there."""
        return host_cache.get(_textures(lambda: self.textures))

    def update_materials(self) -> None:
        """Upload the materials of the World, which have changed."""
        self.materials = resolve.upload(self.world.materials, self.launcher.device)
        self.even_sides = even_sides(self.world.materials)

    def update_emission(self) -> None:
        """Start photons as the World says: shares of the lights, steering, and what the caustic pass aims at."""
        emission, device = self.world.emission, self.launcher.device
        scene = EmitScene()
        scene.lights, scene.textures, scene.media, scene.cells = self.lights, self.textures, self.media, self.cells
        scene.targets = lights.upload_targets(emission.target_center, emission.target_radius, device)
        scene.steering = steering.upload(**vars(emission.steering), device=device)
        scene.caustic_steering = steering.upload(**vars(emission.caustic_steering), device=device)
        scene.cumulative = lights.upload_shares(emission.share, device)
        scene.caustic_cumulative = lights.upload_shares(emission.caustic_share, device)
        self.emit_scene = scene

    def update_features(self) -> None:
        """Choose kernels for the features of the World, which have changed."""
        self._choose_kernels(self.world.features)

    def _choose_kernels(self, features: Features) -> None:
        """Have kernels for these features: by and by their own, if others stand in for them now."""
        chosen = ready_kernels(self.launcher.device, features, wait=self.launcher.wait_for_kernels)
        self.kernels, self.outputs = chosen.variants, chosen.outputs

    @property
    def pad(self) -> float:
        """How far boxes are grown (constants.PAD_SHARE)."""
        return self.world.extent * PAD_SHARE

    @property
    def pixel_width(self) -> float:
        """Width of a pixel at distance 1 along the camera's axis; anywhere, of an orthographic camera."""
        return 2.0 * float(wp.length(self.camera.right)) / self.camera.whole_width

    def set_records(self, records: Records) -> None:
        """Have these irradiance records in place of those before."""
        self.records, self._record_tree = records, None

    @property
    def cache(self) -> Any:
        """The tree of the irradiance records (kernels.irradiance.record_tree), None without records in this view.

        It is built by who asks for it first: a worker whose tasks other processes do never needs it.
        """
        if self._record_tree is None and self.records is not NO_RECORDS:
            arrays = vars(self.records)
            name = f"records {name_of(arrays)}" if self.host_cache.is_shared else ""
            tree = CacheEntry(name, (IrradianceCache,), lambda: [record_tree.build(arrays, self.launcher.device)])
            (self._record_tree,) = self.host_cache.get(tree)
        return self._record_tree

    def set_view(self, view: View) -> None:
        """Look through another camera, without irradiance records at first."""
        self.view = view
        self.records, self._record_tree = NO_RECORDS, None
        features = with_camera(self.world.features, view.camera)
        self._choose_kernels(features)
        self._view_lights = self._guided(view.guide)
        self._caustics = caustic_guide.upload(**vars(view.caustic_guide), device=self.launcher.device)
        self.camera = camera.upload(view.camera, view.seed, self.launcher.device)
        self._bare_scene = None
        self._orders.clear()

    @property
    def scene(self) -> Any:
        """kernels.camera.scene.Scene seen through the view, without surfaces, which each cell has its own of.

        It is made for who asks first: nobody does where nothing lies beyond the scene.
        """
        if self._bare_scene is None:
            self._bare_scene = self._scene()
        return self._bare_scene

    def scene_of(self, surfaces: Surfaces) -> Any:
        """The scene of the view (kernels.camera.scene.Scene) in a cell with these surfaces."""
        scene = self._scene()
        scene.surfaces = surfaces
        return scene

    def _scene(self) -> Any:
        scene = Scene()
        for name in ("materials", "textures", "media", "cells", "camera"):
            setattr(scene, name, getattr(self, name))
        scene.lights = self._view_lights
        scene.caustics = self._caustics
        return scene

    def _guided(self, known: LightGuide) -> Any:
        """The lights, for shadow rays that know this of them."""
        if not len(known):
            return self.lights
        sky, around = self.tiled_sky, self.lights.environment
        if known.chance.size:
            if not sky.pixels.size or known.chance.shape[1:] != guide.tiles_of(sky.pixels):
                raise ProtocolError(f"a guide of {known.chance.shape[1:]} tiles came for another environment")
            around = self.tiled_environment()
        lights_there = (self.lights.tree.choices, self.lights.count - self.lights.first_distant)
        if known.starts.size and (known.starts.shape[1], known.distant.shape[1]) != lights_there:
            raise ProtocolError(f"a guide of {known.starts.shape[1]} lights came where there are {lights_there[0]}")
        tables = guide.upload(**vars(known), sky=sky, device=self.launcher.device)
        return lights.guided(self.lights, tables, around)

    def orders(self, shots: int, diffuse_light: DiffuseLight | None = None, *, asks: bool = True) -> Any:
        """What is asked of vertices (kernels.camera.vertices.Orders), which is made once for a view.

        Args:
            shots: shadow rays of each vertex.
            diffuse_light: where they find it, if not as the view says.
            asks: whether some may ask for photons.
        """
        if self.view is None:
            raise ValueError("vertices were to be lit before a view was set")
        light = self.view.diffuse_light if diffuse_light is None else diffuse_light
        asked = shots, light, asks
        if asked not in self._orders:
            orders = self._orders[asked] = Orders()
            orders.light_samples, orders.shots = self.view.light_samples, shots
            orders.max_depth = self.view.max_depth or 0
            orders.diffuse_light = int(light)
            orders.asks = int(asks)
        return self._orders[asked]

    def tiled_environment(self) -> Any:
        """The environment as guides divide it (kernels.lights.environment.Environment): uploaded once."""
        if self._tiled_environment is None:
            axes = self.world.lights.environment_axes
            self._tiled_environment = environment.upload(self.tiled_sky.pixels, axes, self.launcher.device)
        return self._tiled_environment


def _textures(make: Callable[[], Any]) -> CacheEntry:
    """The scene's textures, as workers of one machine share them."""
    return CacheEntry("textures", (Textures,), lambda: [make()])


def with_camera(features: Features, view: Camera) -> Features:
    """The features of a scene seen through a camera."""
    if features == ALL:
        return features
    return replace(features, lens=view.aperture_radius > 0, orthographic=view.orthographic)
