"""What a person may choose about a render, with the defaults."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from wdpm.cluster.integrators.algorithm import Algorithm
from wdpm.cluster.integrators.indirect import Indirect as Indirect
from wdpm.cluster.integrators.registry import Integrator as Integrator
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.limits import MAX_K, MAX_PHOTONS, MAX_VOLUME_PHOTONS
from wdpm.scenes.errors import SettingsError
from wdpm.scenes.flat.shapes import Instancing as Instancing

EFFECTS_TO_LEAVE_OUT = ("indirect", "caustics", "media", "lens", "bump")
"""What --without takes: light of the global map, of the caustic map, media, depth of field, bent normals."""

MOST_SHADOW_RAYS = max(integrator.algorithm.shadow_rays for integrator in Integrator)
"""Of a camera sample, where nobody says how many."""

CHANGE_NO_BIT = ("bucket", "routing", "all_effects", "strict", "instances")
"""Settings that change no bit of an image."""


class Routing(Enum):
    """How camera rays find their nearest hit among several cells. Both give the same bits."""

    FORWARD = "forward"
    """Only the first cell starts a ray; a miss travels on to the next cell with its best hit."""
    MERGE = "merge"
    """The paper's way: every cell on a ray's way works at once, and the home merges the hits, nearest first."""


@dataclass(frozen=True, kw_only=True)
class RenderSettings:
    """Settings of a render.

    Attributes:
        photons: photons to store in the global map; a fixed pilot turns this into a number of paths. With the default
            and the integrator AUTO, half or a quarter of them where more would bring little beside the samples.
        k: photons of a density estimate: the k nearest.
        radius: largest gather radius, in scene units; None derives it from the scene and the pilot.
        spp: samples a pixel.
        light_samples: shadow rays of a camera sample, from the first surface that it sees; None for as many as the
            lights are worth. Later vertices of its path have one.
        max_depth: longest light path in edges (1: emitted light only, 2: direct light, ...); None for no limit.
        passes: renders of the same scene, each with its own photons, a share of the samples, and a smaller gather
            radius than the one before; the image is their mean. Numbers of photons are those of each pass.
        pass_samples: of a pixel in each of the passes; spp is their sum. Empty where it is spread evenly.
        plan_samples: of a pixel, of a pass that integrator, numbers of photons and the like are chosen for; None for as
            many as a pass has on average.
        adaptive: from the third pass on, more samples where the passes before show more error, and fewer elsewhere;
            spp stays the average.
        seed: of all random numbers.
        bucket: side of a bucket in pixels; None derives it from the image, spp and slaves. Changes no bit of the image.
        caustic_photons: photons to store in the caustic map of a scene that calls for one; fewer as of photons.
        caustic_k: k of density estimates from the caustic map.
        caustic_radius: its largest gather radius, in scene units; None derives it from the pilot.
        volume_photons: photons to store in the volume map of a scene with participating media.
        volume_samples: at most so many of a pixel's samples gather light in media, on behalf of all.
        volume_radius: radius of the beam estimate in media, in scene units; None derives it from the pilot.
        integrator: how light is found.
        indirect: how indirect light on diffuse surfaces is estimated.
        all_effects: compile all effects in, whatever the scene calls for. Changes no bit of the image.
        strict: the first guard that acts ends the render with an error (work/guards.py). Changes no bit of the image.
        without: effects that are left out knowingly, of EFFECTS_TO_LEAVE_OUT.
        instances: whether shapes that stand in several places are held once. Changes no bit of the image.
        routing: how camera rays find their nearest hit among cells. Changes no bit of the image.
        band: width of the overlap band as a share of the gather radius. Below 1 the image is approximate,
            and `inexact` must say so.
        inexact: permits band < 1 (the paper's approximation).
        unsteered: photons are not steered towards what the camera sees; all frames of a sequence are rendered so.
    """

    photons: int = 250_000
    k: int = 50
    radius: float | None = None
    spp: int = 16
    light_samples: int | None = None
    max_depth: int | None = None
    passes: int = 1
    pass_samples: tuple[int, ...] = ()
    plan_samples: int | None = None
    adaptive: bool = False
    seed: int = 0
    bucket: int | None = None
    routing: Routing = Routing.FORWARD
    caustic_photons: int = 250_000
    caustic_k: int = 50
    caustic_radius: float | None = None
    volume_photons: int = 250_000
    volume_samples: int = 4
    volume_radius: float | None = None
    integrator: Integrator = Integrator.AUTO
    indirect: Indirect = Indirect.AUTO
    all_effects: bool = False
    strict: bool = False
    instances: Instancing = Instancing.AUTO
    without: tuple[str, ...] = ()
    band: float = 1.0
    inexact: bool = False
    unsteered: bool = False

    @property
    def algorithm(self) -> Algorithm:
        """The integrator's: it is asked for all that depends on which integrator it is."""
        return self.integrator.algorithm

    @property
    def samples_of_pass(self) -> int:
        """Samples a pixel of one pass: they decide what is worth while, and what goes on with more passes as before."""
        return self.plan_samples or -(-self.spp // self.passes)

    @property
    def final_gathers(self) -> bool:
        """Whether indirect light comes by final gathering."""
        return self.algorithm.diffuse_light(self) is DiffuseLight.FINAL_GATHER

    def __post_init__(self) -> None:
        self._make_plain()
        self._make_members()
        _at_least("photons", self.photons, 0)
        _at_least("caustic_photons", self.caustic_photons, 0)
        _at_least("volume_photons", self.volume_photons, 0)
        _at_least("volume_samples", self.volume_samples, 1)
        for name in ("k", "caustic_k"):
            value = getattr(self, name)
            _at_least(name, value, 1)
            if value > MAX_K:
                raise SettingsError(f"{name} is {value}; expected at most {MAX_K}: use more photons, not a larger k")
        _at_least("spp", self.spp, 1)
        _at_least("passes", self.passes, 1)
        self._check_pass_samples()
        for name in ("bucket", "light_samples", "max_depth", "plan_samples"):
            if getattr(self, name) is not None:
                _at_least(name, getattr(self, name), 1)
        if not 0 <= self.seed < 2**32:
            raise SettingsError(f"seed is {self.seed}; expected an integer from 0 to 4294967295")
        shadow_rays = self.spp * (self.light_samples or MOST_SHADOW_RAYS)
        if shadow_rays >= 2**31:
            raise SettingsError(f"spp x light_samples is {shadow_rays}; expected less than 2^31")
        for name, most in (
            ("photons", MAX_PHOTONS),
            ("caustic_photons", MAX_PHOTONS),
            ("volume_photons", MAX_VOLUME_PHOTONS),
        ):
            if getattr(self, name) > most:
                raise SettingsError(
                    f"{name} is {getattr(self, name)}; a map holds at most {most:,}: use several passes"
                )
        for name in ("radius", "caustic_radius", "volume_radius"):
            length = getattr(self, name)
            if length is not None and not (math.isfinite(length) and length > 0):
                raise SettingsError(f"{name} is {length}; expected a positive length in scene units")
        for effect in self.without:
            if effect not in EFFECTS_TO_LEAVE_OUT:
                raise SettingsError(f"without names {effect!r}; expected some of {', '.join(EFFECTS_TO_LEAVE_OUT)}")
        self.algorithm.check(self)
        if not (math.isfinite(self.band) and self.band >= 0):
            raise SettingsError(f"band is {self.band}; expected a share of the gather radius, 0 or more")
        if self.band < 1 and not self.inexact:
            raise SettingsError(
                f"band is {self.band}, narrower than the gather radius: some gathers would miss photons; "
                "use --inexact to accept that, or leave --band out"
            )

    def _check_pass_samples(self) -> None:
        samples, even = self.pass_samples, (len(self.pass_samples), sum(self.pass_samples))
        for each in samples:
            _at_least("one of pass_samples", each, 1)
        if samples and even != (self.passes, self.spp):
            raise SettingsError(
                f"pass_samples are {even[1]} in {even[0]} passes, but spp is {self.spp} and passes is {self.passes}; "
                f"give spp {even[1]} and passes {even[0]}"
            )

    def _make_plain(self) -> None:
        """Numbers of numpy become Python's: settings go into reports and over the wire."""
        whole = (
            "photons",
            "k",
            "caustic_photons",
            "caustic_k",
            "volume_photons",
            "volume_samples",
            "spp",
            "passes",
            "seed",
        )
        optional = ("bucket", "light_samples", "max_depth", "plan_samples")
        chosen = [name for name in optional if getattr(self, name) is not None]
        for name in (*whole, *chosen):
            self._set_plain(name, operator.index, "a whole number")
        self._set_plain("band", _number, "a number")
        for name in ("adaptive", "all_effects", "strict", "inexact", "unsteered"):
            self._set_plain(name, _truth, "True or False")
        for name in ("radius", "caustic_radius", "volume_radius"):
            if getattr(self, name) is not None:
                self._set_plain(name, _number, "a number")
        self._set_plain("pass_samples", _whole_numbers, "whole numbers, as (1, 9, 7)")
        self._set_plain("without", _names, f"names of effects, some of {', '.join(EFFECTS_TO_LEAVE_OUT)}")

    def _set_plain(self, name: str, made: Callable[[Any], object], expected: str) -> None:
        value = getattr(self, name)
        try:
            object.__setattr__(self, name, made(value))
        except TypeError:
            raise SettingsError(f"{name} is {value!r}; expected {expected}") from None

    def _make_members(self) -> None:
        """Choices may be given by name, as on the command line: integrator="path"."""
        kinds: dict[str, type[Enum]] = {
            "integrator": Integrator,
            "indirect": Indirect,
            "routing": Routing,
            "instances": Instancing,
        }
        for name, kind in kinds.items():
            value = getattr(self, name)
            if isinstance(value, kind):
                continue
            named = {member.value: member for member in kind}
            if not isinstance(value, str) or value not in named:
                names = ", ".join(f'"{member}"' for member in named)
                raise SettingsError(f"{name} is {value!r}; expected one of {names}, or a member of {kind.__name__}")
            object.__setattr__(self, name, named[value])


def _number(value: Any) -> float:
    if isinstance(value, str):
        raise TypeError
    return float(value)


def _truth(value: Any) -> bool:
    """A string is none, as "no" would be taken for True; nor is None, which elsewhere means that wdpm chooses."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError
    return bool(value)


def _whole_numbers(value: Any) -> tuple[int, ...]:
    return tuple(map(operator.index, value))


def _names(value: Any) -> tuple[str, ...]:
    if isinstance(value, str):  # its letters are no names
        raise TypeError
    return tuple(value)


def _at_least(name: str, value: int, least: int) -> None:
    if value < least:
        raise SettingsError(f"{name} is {value}; expected an integer of at least {least}")
