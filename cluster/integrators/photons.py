"""Photon mapping: direct light by shadow rays, glossy parts by paths, the rest from photon maps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wdpm.cluster.integrators.algorithm import Algorithm, WantedMaps
from wdpm.cluster.integrators.indirect import Indirect
from wdpm.cluster.integrators.indirect_choice import choose_indirect
from wdpm.kernels.camera.diffuse_light import DiffuseLight

if TYPE_CHECKING:
    from wdpm.cluster.integrators.integrator_settings import IntegratorSettings
    from wdpm.kernels.features import Features
    from wdpm.scenes.flat.flatten import FlatScene
    from wdpm.scenes.model.scene import Scene

RULE = "diffuse parts are gathered, glossy parts are traced, at any roughness"
"""Which light is found how: one rule, without a threshold (kernels.materials.types)."""

SHADOW_RAYS = 4
"""To lamps that have an extent, or to several: light straight from them is most of the noise that is left, and a shadow
ray costs a fraction of a camera ray with all that follows from it. On ten scenes of 8 samples a pixel, four rays take
0 to 25 % longer than one, and divide the mean squared error by 1.0 to 3.3."""

_KINDS = {
    Indirect.AUTO: "as it suits the scene",
    Indirect.MAP: "photon map",
    Indirect.GATHER: "final gathering",
    Indirect.CACHE: "final gathering with an irradiance cache",
}


class PhotonMapping(Algorithm):
    """Direct light by path tracing, indirect light from photon maps."""

    name = "photons"
    words = "photon mapping"
    option_help = "photons"
    shoots_photons = True
    biased = True
    shadow_rays = SHADOW_RAYS
    ignored = ()
    why_ignored = ""
    cannot_leave_out = frozenset()

    def check(self, settings: IntegratorSettings) -> None:
        """Whatever is right by itself goes with photons."""

    def choose(self, flat: FlatScene, settings: IntegratorSettings) -> tuple[Indirect, str | None]:
        return choose_indirect(flat, settings, wanted=self.maps(settings).indirect)

    def maps(self, settings: IntegratorSettings) -> WantedMaps:
        return WantedMaps(
            indirect=settings.photons > 0 and "indirect" not in settings.without,
            caustic=settings.caustic_photons > 0 and "caustics" not in settings.without,
            volume=settings.volume_photons > 0,
        )

    def diffuse_light(self, settings: IntegratorSettings) -> DiffuseLight:
        by_rays = self.maps(settings).indirect and settings.indirect in (Indirect.GATHER, Indirect.CACHE)
        return DiffuseLight.FINAL_GATHER if by_rays else DiffuseLight.PHOTON_MAP

    def has_irradiance_cache(self, settings: IntegratorSettings) -> bool:
        return self.maps(settings).indirect and settings.indirect is Indirect.CACHE

    def traced_by(self, settings: IntegratorSettings) -> tuple[str, ...]:
        gathers = self.diffuse_light(settings) is DiffuseLight.FINAL_GATHER
        return (f"--indirect {settings.indirect.value}",) if gathers else ()

    def in_words(self, settings: IntegratorSettings) -> str:
        return _KINDS[settings.indirect]

    def approximations(self, scene: Scene, features: Features) -> tuple[str, ...]:
        return (RULE,) if features.goes_on else ()

    def kinds_to_try(self, settings: IntegratorSettings) -> tuple[Indirect, ...]:
        if settings.indirect is not Indirect.AUTO:
            return (settings.indirect,)
        return (Indirect.MAP, Indirect.CACHE, Indirect.GATHER) if settings.photons else (Indirect.MAP,)
