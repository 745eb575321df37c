"""What an integrator is to everybody else: one algorithm of light transport, and all that depends on which it is.

Plans, checks of settings, reports, sweeps and searches for an error ask the Algorithm of their settings
(`RenderSettings.algorithm`); nothing but the registry knows which there are. A new one is a file beside this one and a
line in the registry. How it finds light is up to what kernels offer: photon maps (`maps`), and camera paths that take
the light of diffuse surfaces from one of several places (`diffuse_light`).

The settings import these modules, so they load no Warp: the command line must not wait for it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from wdpm.kernels.camera.diffuse_light import DiffuseLight

if TYPE_CHECKING:
    from wdpm.cluster.integrators.indirect import Indirect
    from wdpm.cluster.integrators.integrator_settings import IntegratorSettings
    from wdpm.kernels.features import Features
    from wdpm.scenes.flat.flatten import FlatScene
    from wdpm.scenes.model.scene import Scene


@dataclass(frozen=True)
class WantedMaps:
    """The photon maps that are gathered from in scenes that call for them."""

    indirect: bool = False
    caustic: bool = False
    volume: bool = False


class Algorithm(ABC):
    """One algorithm of light transport. It has no state: methods are told the settings of a render.

    Attributes:
        name: of the integrator in files and on the command line.
        words: for people, within a sentence.
        option_help: what the help of --integrator has about it; begins with the name.
        shoots_photons: whether light comes by photon maps.
        biased: whether images have errors that more samples do not lessen.
        shadow_rays: from what a camera sample sees, where nobody says how many and lights are worth more than one.
        ignored: fields of RenderSettings that it does not look at.
        why_ignored: in words that follow its name; empty if there are none.
        stands_for_others: whether what renders is picked among the others, for each scene (plan.integrator_trial).
        cannot_leave_out: effects of EFFECTS_TO_LEAVE_OUT that `without` must not name: `check` refuses them.
    """

    name: ClassVar[str]
    words: ClassVar[str]
    option_help: ClassVar[str]
    shoots_photons: ClassVar[bool]
    biased: ClassVar[bool]
    shadow_rays: ClassVar[int]
    ignored: ClassVar[tuple[str, ...]]
    why_ignored: ClassVar[str]
    stands_for_others: ClassVar[bool] = False
    cannot_leave_out: ClassVar[frozenset[str]]

    @abstractmethod
    def check(self, settings: IntegratorSettings) -> None:
        """Raise SettingsError for settings that are right by themselves, but not with this integrator."""

    @abstractmethod
    def choose(self, flat: FlatScene, settings: IntegratorSettings) -> tuple[Indirect, str | None]:
        """Choose where indirect light comes from, where that was left to it.

        Args:
            flat: the scene without what is left out.

        Returns:
            Anything but AUTO, and a line on what was chosen and why; None where nothing was.
        """

    @abstractmethod
    def maps(self, settings: IntegratorSettings) -> WantedMaps:
        """The photon maps that it gathers from, where the scene calls for them."""

    @abstractmethod
    def diffuse_light(self, settings: IntegratorSettings) -> DiffuseLight:
        """Where camera paths find the light of diffuse surfaces. What images have follows from it: cluster.layers."""

    @abstractmethod
    def has_irradiance_cache(self, settings: IntegratorSettings) -> bool:
        """Whether irradiance records are made."""

    @abstractmethod
    def traced_by(self, settings: IntegratorSettings) -> tuple[str, ...]:
        """The options of the command line for which camera paths go on by diffuse parts."""

    @abstractmethod
    def in_words(self, settings: IntegratorSettings) -> str:
        """How light is found, for people."""

    @abstractmethod
    def approximations(self, scene: Scene, features: Features) -> tuple[str, ...]:
        """One line for each approximation of its own; those of the maps that it wants are told apart from these.

        Args:
            features: what kernels are compiled for.
        """

    @abstractmethod
    def kinds_to_try(self, settings: IntegratorSettings) -> tuple[Indirect, ...]:
        """What a search for the cheapest way to an error may set `indirect` to, the first to be tried first."""
