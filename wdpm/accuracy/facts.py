"""What a sweep has to know of a scene before anything is rendered: what the renderer would choose, and what is idle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from wdpm.accuracy.knobs import MAPS, Value
from wdpm.accuracy.points import LEFT_OPEN
from wdpm.accuracy.uses import idle_knobs
from wdpm.cluster.render_settings import RenderSettings
from wdpm.progress import Progress
from wdpm.rendering.backend import Backend
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.left_out import leave_out
from wdpm.scenes.model.scene import Scene


@dataclass(frozen=True)
class Facts:
    """Of a scene with the settings of a base.

    Attributes:
        identity: digests of scene and camera.
        maps: photon maps that are made, of MAPS.
        radii: largest gather radius of each of MAPS, given or chosen [scene units].
        light_samples: given or chosen.
        idle: knobs that change nothing, by name, with the reason.
    """

    identity: Mapping[str, str]
    maps: tuple[str, ...]
    radii: tuple[float, ...]
    light_samples: int
    idle: Mapping[str, str]

    @property
    def chosen(self) -> dict[str, Value]:
        """The knobs of LEFT_OPEN, as the base has them."""
        return dict(zip(LEFT_OPEN, (*self.radii, self.light_samples), strict=True))


def find_facts(scene: Scene, settings: RenderSettings, backend: Backend, progress: Progress) -> Facts:
    """Compile, and fly the pilot of a render. Raises SceneError, SettingsError."""
    prepared = backend.prepare(scene, settings, progress)
    world = prepared.session.world
    return Facts(
        identity={name: prepared.identity[name] for name in ("scene", "camera")},
        maps=tuple(name for name, plan in zip(MAPS, world.maps, strict=True) if plan.paths),
        radii=tuple(plan.radius * world.unit for plan in world.maps),
        light_samples=prepared.session.view.light_samples,
        idle=idle_knobs(flatten(leave_out(scene, settings.without)), world, settings),
    )
