"""What is in a scene, which effects it calls for, and what each slave would hold of it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from wdpm.cluster.host_memory import SlaveMemory
from wdpm.cluster.limits import check_most_slaves
from wdpm.cluster.plan.copies import Copies, largest_team, scene_memory, sharing
from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.effects_in_words import Effect, LightUse, effects_of, missing_effects, uses_of_lights
from wdpm.cluster.plan.render_plan import RenderPlan, make_render_plan
from wdpm.cluster.work.replica import with_camera
from wdpm.inspection.shares import Share, shares_of
from wdpm.kernels.compile import compile_kernels
from wdpm.kernels.launch import Launcher
from wdpm.kernels.variants import make_variants
from wdpm.rendering.approximations import approximations, settings_without_effect
from wdpm.rendering.automatic_settings import choose_settings
from wdpm.rendering.scene_settings import settings_for
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.flat.room import in_file
from wdpm.scenes.model.left_out import leave_out
from wdpm.scenes.model.scene import Scene


@dataclass(frozen=True)
class Inspection:
    """A scene in figures.

    Attributes:
        extent: largest absolute coordinate after the scene is moved to its centre [scene units].
        photons: photons to be stored by a render with these settings: in the global, the caustic and the volume map.
        paths: photon paths that it would shoot: of the global (and volume) pass, and of the caustic pass.
        radius: largest gather radius of each map [scene units]; 0 for a map that is not made.
        targets: spheres that photons of the caustic pass are aimed at.
        modules: kernel modules that its features call for.
        effects: every effect, on or off, and why.
        lights: how photons are shared out among them.
        chose: what would be chosen where nobody said, and why.
        left_out: what the image would lack, knowingly.
        approximated: what it would only approximate.
        dropped: triangles that are left out, by cause.
    """

    name: str
    meshes: int
    triangles: int
    materials: int
    textures: int
    media: int
    size: tuple[int, int]
    extent: float
    photons: tuple[int, int, int]
    paths: tuple[int, int]
    radius: tuple[float, float, float]
    targets: int
    features: tuple[str, ...]
    modules: int
    effects: tuple[Effect, ...]
    lights: tuple[LightUse, ...]
    slaves: tuple[Share, ...]
    chose: tuple[str, ...]
    left_out: tuple[str, ...]
    approximated: tuple[str, ...]
    dropped: dict[str, int]
    warnings: tuple[str, ...]

    def to_json(self) -> str:
        """All of it as JSON."""
        return json.dumps(asdict(self), indent=2)


def inspect(
    scene: Scene, *, slaves: int = 4, copies: Copies = Copies.AUTO, memory: int | None = None, **chosen: Any
) -> Inspection:
    """Look at a scene as a render would.

    Args:
        slaves: how many to divide it among.
        copies: whether slaves with room for it hold the whole scene.
        memory: that each may use [bytes]; None if nobody said: then the scene is cut among all of them.
        chosen: settings of that render by name, see RenderSettings.

    Raises:
        SettingsError: more slaves than there can be, or all together have not room for the scene.
    """
    check_most_slaves(slaves)
    settings = settings_for(scene, **chosen)
    room = in_file if slaves > 1 else np.empty
    as_it_is = flatten(scene, settings.instances, room)
    flat = flatten(leave_out(scene, settings.without), settings.instances, room) if settings.without else as_it_is
    unused = settings_without_effect(settings)
    launcher = Launcher("cpu")
    automatic = choose_settings(flat, settings, launcher, partial(compile_kernels, "cpu"))
    settings = automatic.settings
    features = with_camera(features_of(flat, settings), flat.camera)
    compile_kernels("cpu", features)
    photons = settings.photons + settings.caustic_photons + settings.volume_photons
    team_size = slaves
    if memory is not None:
        each = SlaveMemory("", 0, memory)
        standing = len(flat.triangles.instances)
        needed = scene_memory(flat.triangles.held, photons, flat.textures, flat.media.grids.voxels, standing)
        team_size = sharing(copies, [each] * slaves, needed).team_size
    team = largest_team(slaves, team_size)
    plan = make_render_plan(flat, settings, team, launcher, None, *automatic.found)
    world = plan.world
    made = _by_map(plan, (settings.photons, settings.caustic_photons, settings.volume_photons))
    effects = effects_of(as_it_is, flat, [medium.name for medium in scene.media], world, features, settings)
    shining = set(world.lights.names)
    return Inspection(
        name=scene.name,
        meshes=len(scene.meshes),
        triangles=flat.triangles.total,
        materials=len(scene.materials),
        textures=len(flat.textures),
        media=len(scene.media),
        size=(flat.camera.width, flat.camera.height),
        extent=flat.extent * flat.unit,
        photons=made,
        paths=(world.global_map.paths, world.caustic_map.paths),
        radius=_by_map(plan, tuple(each.radius * world.unit for each in world.maps)),
        targets=len(world.emission.target_radius),
        features=features.names(),
        modules=len(make_variants(features).modules()),
        effects=effects,
        lights=uses_of_lights(
            world, [mesh.name for mesh in scene.meshes if mesh.emission is not None and mesh.name not in shining]
        ),
        slaves=shares_of(plan, flat, slaves, team_size, sum(made)),
        chose=(*automatic.chose, *plan.chose),
        left_out=missing_effects(effects, settings),
        approximated=approximations(scene, world, settings),
        dropped=flat.dropped,
        warnings=scene.warnings + unused,
    )


def _by_map(plan: RenderPlan, amounts: tuple[Any, ...]) -> tuple[Any, Any, Any]:
    """Amounts of the three maps, 0 for one that is not made."""
    made = [amount if each.paths else 0 for amount, each in zip(amounts, plan.world.maps, strict=True)]
    return made[0], made[1], made[2]
