"""Path tracing: everything by paths from the camera, without bias and without photons."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wdpm.cluster.integrators.algorithm import Algorithm, WantedMaps
from wdpm.cluster.integrators.indirect import Indirect
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.model.bsdfs import is_smooth_anywhere
from wdpm.scenes.model.lights import DeltaLight

if TYPE_CHECKING:
    from wdpm.cluster.integrators.integrator_settings import IntegratorSettings
    from wdpm.kernels.features import Features
    from wdpm.scenes.flat.flatten import FlatScene
    from wdpm.scenes.model.scene import Scene

HIDDEN = "light of points, spots and suns without size that comes off smooth mirrors or glass is not found by paths"
"""What path tracing leaves out (photons find it: the caustic map)."""


class PathTracing(Algorithm):
    """Everything by path tracing: the reference that others are held against."""

    name = "path"
    words = "path tracing"
    option_help = "path: unbiased path tracing, to compare with"
    shoots_photons = False
    biased = False
    shadow_rays = 1  # time is better spent on whole paths
    ignored = (
        "photons",
        "k",
        "radius",
        "caustic_photons",
        "caustic_k",
        "caustic_radius",
        "volume_photons",
        "volume_samples",
        "volume_radius",
        "indirect",
        "band",
        "inexact",
        "unsteered",
    )
    why_ignored = "has no photons"
    cannot_leave_out = frozenset({"indirect", "caustics"})  # they come by photon maps alone

    def check(self, settings: IntegratorSettings) -> None:
        if maps := self.cannot_leave_out.intersection(settings.without):
            raise SettingsError(
                f"without {', '.join(sorted(maps))} leaves out photon maps, and integrator {self.name} has none; "
                "for direct light alone use max_depth 2"
            )

    def choose(self, flat: FlatScene, settings: IntegratorSettings) -> tuple[Indirect, str | None]:
        return self.kinds_to_try(settings)[0], None

    def maps(self, settings: IntegratorSettings) -> WantedMaps:
        return WantedMaps()

    def diffuse_light(self, settings: IntegratorSettings) -> DiffuseLight:
        return DiffuseLight.PATHS

    def has_irradiance_cache(self, settings: IntegratorSettings) -> bool:
        return False

    def traced_by(self, settings: IntegratorSettings) -> tuple[str, ...]:
        return (f"--integrator {self.name}",)

    def in_words(self, settings: IntegratorSettings) -> str:
        return self.words

    def approximations(self, scene: Scene, features: Features) -> tuple[str, ...]:
        return (HIDDEN,) if _hides_light(scene) else ()

    def kinds_to_try(self, settings: IntegratorSettings) -> tuple[Indirect, ...]:
        return (Indirect.MAP if settings.indirect is Indirect.AUTO else settings.indirect,)


def _hides_light(scene: Scene) -> bool:
    """Whether some light can reach neither a shadow ray nor a path: from a light without size, off a smooth surface."""
    if not any(isinstance(light, DeltaLight) for light in scene.lights):
        return False
    used = {mesh.material for mesh in scene.meshes}
    return any(is_smooth_anywhere(scene.materials[number].bsdf) for number in used)
