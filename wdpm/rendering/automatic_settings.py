"""What is chosen where nobody said, before anything else: the integrator, and where its indirect light comes from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.plan.caustics.guide import CausticsLearnt
from wdpm.cluster.plan.effects import calls_for_caustics, features_of
from wdpm.cluster.plan.integrator_trial import choose_integrator, reason_for_photons, trial_features
from wdpm.cluster.plan.light_guide import Learnt
from wdpm.cluster.plan.light_samples import light_samples_of
from wdpm.cluster.plan.photon_pilot import PhotonPilot
from wdpm.cluster.plan.record_worth import SampleNoise
from wdpm.cluster.plan.trial.caustic_share import share_in_words
from wdpm.cluster.plan.trial.shadow_rays import rays_in_words
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.kernels.camera.pixel_filter import is_signed, placed_by
from wdpm.kernels.features import Features
from wdpm.kernels.launch import Launcher
from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.used_media import calls_for_media


@dataclass(frozen=True)
class ChosenSettings:
    """Settings that leave nothing open but radii and numbers of paths.

    Attributes:
        chose: what was chosen, and why, one line each.
        pilot: that was flown to choose.
        learnt: how shadow rays choose among lights, where a choice asked for it.
        noise: of a sample of each pixel of a small picture, where a choice told, shape [height, width].
        caustic_share: 1 of so many samples of a pixel asks the caustic map.
        caustics: where paths go on to find caustics, where a choice asked for it.
        square_of_indirect: mean square of indirect light, as `noise` is weighted, where photons were chosen.
    """

    settings: RenderSettings
    chose: tuple[str, ...]
    pilot: PhotonPilot | None = None
    learnt: Learnt | None = None
    noise: NDArray[np.float64] | None = None
    caustic_share: int = 1
    caustics: CausticsLearnt | None = None
    square_of_indirect: float | None = None

    @property
    def found(self) -> tuple[PhotonPilot | None, Learnt | None, CausticsLearnt | None, SampleNoise | None]:
        """What was found out to choose them, as plans take it (render_plan.make_render_plan)."""
        seen = None
        if self.noise is not None and self.square_of_indirect is not None:
            seen = SampleNoise(self.noise, self.square_of_indirect)
        return self.pilot, self.learnt, self.caustics, seen


def choose_settings(
    flat: FlatScene,
    settings: RenderSettings,
    launcher: Launcher,
    compile_for: Callable[[Features], object],
) -> ChosenSettings:
    """Choose what settings leave open.

    Args:
        flat: the scene without what is left out.
        compile_for: compiles kernels; called where a trial needs some.

    Raises:
        SceneError: light is to come by photons, and a lamp is too bright for them.
    """
    if not settings.algorithm.stands_for_others:
        if settings.algorithm.shoots_photons and (bright := too_bright_for_photons(flat)):
            raise SceneError(f"{bright}; dim all lamps alike, or render by paths (--integrator path)")
        return _settled(flat, settings)
    if bright := too_bright_for_photons(flat):
        if why := reason_for_photons(flat, settings):
            raise SceneError(f"{bright}; dim all lamps alike (integrator: {why})")
        by_paths = _settled(flat, replace(settings, integrator=Integrator.PATH))
        return replace(by_paths, chose=(f"integrator: path, since {bright}", *by_paths.chose))
    if why := reason_for_photons(flat, settings):
        by_photons = _settled(flat, replace(settings, integrator=Integrator.PHOTONS))
        return replace(by_photons, chose=(f"integrator: {why}", *by_photons.chose))
    compile_for(trial_features(flat, settings))
    by_map = replace(settings, integrator=Integrator.PHOTONS, indirect=Indirect.MAP)
    choice = choose_integrator(flat, settings, _with_light_samples(flat, by_map), launcher)
    chosen = _with_light_samples(flat, choice.settings)
    words: tuple[str, ...] = (f"integrator: {choice.words}",)
    signed = is_signed(placed_by(flat.camera.filter))
    share = 1 if signed else choice.caustic_share  # weights are balanced over all samples
    if choice.settings.algorithm.shoots_photons:
        words += (*choice.indirect, *share_in_words(share))
        if settings.light_samples is None:
            chosen = replace(chosen, light_samples=choice.shadow_rays)
            words += rays_in_words(choice.shadow_rays)
    caustics = None if chosen.algorithm.shoots_photons else choice.caustics
    return ChosenSettings(
        chosen, words, choice.pilot, choice.learnt, choice.noise, share, caustics, choice.square_of_indirect
    )


BRIGHTEST = 1e32
"""Most flux of a lamp whose photons are followed, in the renderer's units [W].

Single precision ends at 3.4e38, and numbers of irradiance records, which have the change of light with place besides,
at 1e35. A room lit evenly stays below both; right beside a small lamp of less flux light may overflow all the same."""


def too_bright_for_photons(flat: FlatScene) -> str | None:
    """What is wrong with the brightest lamp of a scene, if no photon can carry its light; in words."""
    lights = flat.lights
    if not len(lights.power) or lights.power.max() <= BRIGHTEST:
        return None
    flux = np.bincount(lights.light, lights.power)
    light = int(flux.argmax())
    watts, most = flux[light] * flat.unit**2, BRIGHTEST * flat.unit**2
    return f'lamp "{lights.names[light]}" shines with {watts:.2g} W, and photons here carry up to {most:.2g} W'


def _settled(flat: FlatScene, settings: RenderSettings) -> ChosenSettings:
    """Where indirect light comes from, and how many shadow rays there are.

    Also where few photons come to what is seen it is the cache: its gather rays go on where they find none, but where a
    map is read there is nothing else. Of four such scenes it had 0.02 to 0.16 of the map's relMSE, for 1.0 to 3.3 of
    its time.
    """
    indirect, why = settings.algorithm.choose(flat, settings)
    chosen = _with_light_samples(flat, replace(settings, indirect=indirect))
    words = () if why is None else (why,)
    return ChosenSettings(chosen, (*words, *_maps_as_ever(flat, chosen)))


def _maps_as_ever(flat: FlatScene, settings: RenderSettings) -> tuple[str, ...]:
    """That other maps have photons as ever, where somebody has said how many the global one has; in words."""
    plain = RenderSettings()
    if settings.photons == plain.photons or not settings.algorithm.shoots_photons:
        return ()
    maps = {"caustic": calls_for_caustics(flat, features_of(flat, settings), settings), "volume": calls_for_media(flat)}
    return tuple(
        f"{name} photons: {count:,}, as ever: --photons is of the global map alone; theirs is --{name}-photons"
        for name, is_there in maps.items()
        if is_there and (count := getattr(settings, f"{name}_photons")) == getattr(plain, f"{name}_photons")
    )


def _with_light_samples(flat: FlatScene, settings: RenderSettings) -> RenderSettings:
    return replace(settings, light_samples=light_samples_of(flat, settings))
