"""What one pass of a progressive render does: its samples, its photons, and how far these are gathered.

Each pass is a render of its own, from photons of its own and with a part of the samples; the mean of all passes is the
image. The radius shrinks from pass to pass, so slowly that the noise of the mean still vanishes, and the blur with it
(Knaus & Zwicker 2011, "Progressive photon mapping: a probabilistic approach", ACM Transactions on Graphics 30 (3)).
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.allotment import NO_ALLOTMENT, Allotment
from wdpm.cluster.plan.view import MOST_RAYS, SAMPLES_OF_PLAN
from wdpm.cluster.plan.view import share_of_rays as share_of_rays
from wdpm.cluster.records import CachePlan
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.session import Session, SessionResult
from wdpm.cluster.world import MapPlan, PhotonPlan, World
from wdpm.scenes.errors import SettingsError

ALPHA = 2.0 / 3.0
"""How slowly the radius shrinks; at 2/3 noise and bias of the mean fall at the same rate (Knaus & Zwicker 2011)."""

LEAST_CLEARANCE = 0.35
"""Records in corners reach no less far than this share of the way to the nearest thing, however many the samples."""

SAMPLES_OF_REACH = 16
"""Samples a pixel below which records reach further: what they blur is less than what fewer of them, each of which
reaches others, get wrong. With 2 samples (256x256) relMSE fell by 2 to 4 % in sibenik, sponza and among bunnies, for 10
to 13 % fewer gather rays."""

LEAST_K = 4
"""Photons that a gather looks for, at least: from there on, the largest radius alone goes on shrinking."""

MOST_IN_WORDS = 6
"""Passes whose samples are told one by one."""

_STEP_LEFT, _STEP_TOP = 19, 11
"""By which the grid of records' candidates moves from pass to pass, of a spacing that is a power of two: it comes to
all places of either axis before it comes back."""


@dataclass(frozen=True)
class PassPlan:
    """One pass.

    Attributes:
        number: from 0; gives the seed of the photons, and how far they are gathered.
        first_sample: number of the first of its samples, of each pixel.
        spp: how many it takes.
    """

    number: int
    first_sample: int
    spp: int


def spread_samples(spp: int, passes: int) -> tuple[PassPlan, ...]:
    """Passes that take the samples of each pixel in turn, as evenly as can be, the earlier ones the odd samples."""
    ends = [-(-spp * (number + 1) // passes) for number in range(passes)]
    return tuple(
        PassPlan(number, start, stop - start)
        for number, (start, stop) in enumerate(zip([0, *ends[:-1]], ends, strict=True))
    )


def spread_of(settings: RenderSettings) -> tuple[PassPlan, ...]:
    """Passes of a render that begins now."""
    if not settings.pass_samples:
        return spread_samples(settings.spp, settings.passes)
    starts = itertools.accumulate(settings.pass_samples, initial=0)
    return tuple(PassPlan(*each) for each in zip(itertools.count(), starts, settings.pass_samples, strict=False))


def samples_of(passes: Sequence[int], *, given: bool) -> dict[str, Any]:
    """Settings of a render in passes of so many samples each, by name.

    Args:
        given: whether these were named one by one, by which it is planned (RenderSettings.samples_of_pass).
    """
    return {"spp": sum(passes), "passes": len(passes), "pass_samples": tuple(passes) if given else ()}


def is_spread(plans: Sequence[PassPlan]) -> bool:
    """Whether passes take their samples evenly."""
    return tuple(plans) == spread_samples(sum(plan.spp for plan in plans), len(plans))


def passes_in_words(samples: Sequence[int]) -> str:
    """How many passes of how many samples each: "1 pass of 4 samples", or "3 passes of 1, 8 and 9 samples"."""
    passes = f"{len(samples)} {'pass' if len(samples) == 1 else 'passes'}"
    if len(set(samples)) == 1:
        return f"{passes} of {samples[0]} {'sample' if samples[0] == 1 else 'samples'}"
    if len(samples) > MOST_IN_WORDS:
        return f"{passes} of {min(samples)} to {max(samples)} samples"
    return f"{passes} of {', '.join(map(str, samples[:-1]))} and {samples[-1]} samples"


def plans_for(settings: RenderSettings, done: tuple[PassPlan, ...] = ()) -> tuple[PassPlan, ...]:
    """All passes of a render, those that are done included.

    Where the passes asked for would begin with others than were done (a larger --passes spreads the samples thinner),
    those still to do take as many samples as the first, beyond the ones that are taken.

    Raises:
        SettingsError: more passes than samples, or fewer than are done.
    """
    if len(done) > settings.passes:
        raise SettingsError(f"passes is {settings.passes}, but {len(done)} are done already; ask for at least as many")
    if settings.passes <= settings.spp:
        spread = spread_of(settings)
        if spread[: len(done)] == done:
            return spread
    if not done:
        raise SettingsError(
            f"passes is {settings.passes}, more than spp, which is {settings.spp}; each pass needs a sample of its own"
        )
    plans = list(done)
    for number in range(len(done), settings.passes):
        plans.append(PassPlan(number, plans[-1].first_sample + plans[-1].spp, done[0].spp))
    return tuple(plans)


def shrink(number: int, alpha: float = ALPHA) -> float:
    """The squared radius of pass `number`, from 0, as a share of the first one's.

    Knaus & Zwicker 2011: the i-th pass is followed by one whose squared radius is (i + alpha) / (i + 1) of its own.
    """
    share = 1.0
    for i in range(1, number + 1):
        share *= (i + alpha) / (i + 1)
    return share


def pass_seed(seed: int, number: int) -> int:
    """Seed of the photons of a pass; that of the first is `seed` itself."""
    if number == 0:
        return seed
    return int.from_bytes(hashlib.sha256(f"photons of pass {number} of seed {seed}".encode()).digest()[:4], "little")


def session_of(session: Session, plan: PassPlan, allotment: Allotment = NO_ALLOTMENT) -> Session:
    """The session that renders one pass.

    Args:
        session: of the first pass, as `prepare` gives it.
        allotment: the samples of each part of the image.
    """
    share, view = shrink(plan.number), session.view
    return replace(
        session,
        world=session.world.with_photons(photon_plan(session.world, plan.number)),
        view=replace(
            view,
            first_sample=plan.first_sample,
            spp=plan.spp,
            k=smaller_k(view.k, share),
            caustic_k=smaller_k(view.caustic_k, share),
            cache=_other_records(worth(view.cache, plan.spp), plan.number),
            allotment=allotment,
        ),
    )


def worth(plan: CachePlan, spp: int) -> CachePlan:
    """The plan of a cache whose records are as good as `spp` samples a pixel are worth.

    What records get wrong is as much a part of the image as the noise of the samples, and takes as long to get rid of.
    With records that are always alike, few samples would wait for them, and many would end in their noise and blur.
    Radii and gradients ask for some rays, however few the samples; an error asks for none.

    Args:
        plan: for SAMPLES_OF_PLAN samples a pixel.
    """
    share, finer = spp / SAMPLES_OF_PLAN, math.sqrt(share_of_rays(spp, plan.least_rays))
    further = max((SAMPLES_OF_REACH / spp) ** 0.25, 1.0)
    least = plan.least * further
    return replace(
        plan,
        error=plan.error * further,
        least=least,
        most=max(plan.most, least),
        rows=max(1, round(plan.rows * finer)),
        columns=max(3, round(plan.columns * finer)),
        clearance=min(max(plan.clearance * share**-0.25, LEAST_CLEARANCE), 1.0),
        tolerance=plan.tolerance / math.sqrt(min(share, MOST_RAYS)),
    )


def _other_records(plan: CachePlan, number: int) -> CachePlan:
    """Irradiance records of a pass: elsewhere than those of other passes, and closer to each other."""
    shorter = math.sqrt(shrink(number))
    return replace(
        plan,
        error=plan.error * shorter,
        clearance=plan.clearance * shorter,
        least=plan.least * shorter,
        most=plan.most * shorter,
        left=number * _STEP_LEFT % plan.spacing,
        top=number * _STEP_TOP % plan.spacing,
    )


def photon_plan(world: World, number: int) -> PhotonPlan:
    """The photons of pass `number` of a world that is planned for the first pass."""
    share = shrink(number)
    if number == 0:
        return world.photon_plan
    return PhotonPlan(
        seed=pass_seed(world.seed, number),
        global_map=_narrower(world.global_map, share, number),
        caustic_map=_narrower(world.caustic_map, share, number),
        volume_map=_narrower(world.volume_map, share, number),
        # What a photon adds to a ray grows as the disc shrinks. A power of two, so that sums stay exact (beam.py).
        volume_unit=math.ldexp(world.volume_unit, 1 - math.frexp(share)[1]),
        irradiance=replace(
            world.irradiance,
            k=smaller_k(world.irradiance.k, share),
            caustic_k=smaller_k(world.irradiance.caustic_k, share),
            reach=world.irradiance.reach * math.sqrt(share),
        ),
    )


def smaller_k(k: int, share: float) -> int:
    """Photons that a gather looks for in `share` of the area: as many fewer, or its radius would not shrink."""
    return max(round(k * share), min(k, LEAST_K))


def _narrower(plan: MapPlan, share: float, number: int) -> MapPlan:
    """The map of pass `number`, which is gathered from discs of `share` of the area."""
    shorter = math.sqrt(share)
    radius = plan.radius * shorter
    # Points grow denser with the photons of a disc, or the surface's share would be that of an ever larger disc.
    area = plan.point_area * share
    return replace(plan, radius=radius, band=plan.band * shorter, point_area=area, point_set=number)


@dataclass(frozen=True, eq=False)
class PassResult:
    """One pass, rendered.

    Attributes:
        layers: name of layer -> float32, shape [height, width, 3] or [height, width].
        seconds: wall-clock time by phase [s]: partition (of the first pass alone), photons, map, render.
        result: as the cluster gave it.
        allotment: the samples of each part of the image; where there is none, all pixels took those of the plan.
    """

    plan: PassPlan
    layers: dict[str, NDArray[np.float32]]
    seconds: dict[str, float]
    result: SessionResult
    allotment: Allotment = NO_ALLOTMENT
