"""What the camera adds to a plan: samples, buckets, and how irradiance records are made."""

from __future__ import annotations

from dataclasses import replace

from wdpm.cluster.plan.light_samples import light_samples_of
from wdpm.cluster.records import LEAST_RAYS, NO_CACHE, CachePlan
from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.world import View
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.model.scene import Camera

CACHE_PLAN = CachePlan(
    rounds=6,
    spacing=32,
    rows=11,
    columns=35,
    error=0.5,
    clearance=0.4,
    least=5.0,
    most=5.0,
    wanted=0.1,
    tolerance=0.025,
    extra=2.0,
)
"""Strata about as long as wide; candidates from every 32nd pixel to all: what no record reaches then traces a gather
ray a sample, and shows as single pixels along edges. The tolerance leaves most records of plain rooms as they
are: their light changes evenly, and errors are less than its spread tells. More extra rays would cost more than all
samples. What follows from the image: _cache_plan."""

SAMPLES_OF_PLAN = 32
"""Samples a pixel, in one pass, that CACHE_PLAN is for."""

MOST_RAYS = 4.0
"""Most gather rays of a record, as a share of that plan's: with more, interpolation is further off than they are. (The
least: CachePlan.least_rays.)"""

RECORD_REACH = 0.08
"""Most that a record reaches, as a share of the image: some dozen records across a wall that is all alike."""

RECORD_LEAST = 0.012
"""Least that a record reaches, as a share of the image, but one pixel at least: small images have corners too. At most
CACHE_PLAN.least pixels, or large images would blur them."""

BUCKET_LEAST, BUCKET_MOST = 32, 128
"""Bounds of the side of a bucket that is derived [pixels]."""

BUCKET_SHADOW_RAYS = 1 << 18
"""Most shadow rays of a bucket larger than the least: what is on its way at once."""

BUCKETS_A_WORKER = 8
"""Buckets that each worker gets, at least, before they are made larger: the last ones are shared out evenly."""

BUCKETS_ALONE = 2
"""The same where the last of them are divided."""


def share_of_rays(spp: int, least: float = LEAST_RAYS) -> float:
    """Gather rays of a record in a pass of `spp` samples a pixel, as a share of those of CACHE_PLAN.

    Args:
        least: as CachePlan.least_rays.
    """
    return min(max(spp / SAMPLES_OF_PLAN, least), MOST_RAYS)


def view_of(flat: FlatScene, settings: RenderSettings, workers: int, *, alone: bool = False) -> View:
    """What the camera adds.

    Args:
        workers: how many will share the work; 0 and 1 are alike.
        alone: whether each renders buckets without the others: then the last of them are divided (master.buckets).
    """
    return View(
        camera=flat.camera,
        seed=settings.seed,
        spp=settings.spp,
        light_samples=light_samples_of(flat, settings),
        max_depth=settings.max_depth,
        k=settings.k,
        caustic_k=settings.caustic_k,
        volume_samples=settings.volume_samples,
        bucket=settings.bucket
        or _bucket(flat, settings, max(workers, 1) * (BUCKETS_ALONE if alone else BUCKETS_A_WORKER)),
        diffuse_light=settings.algorithm.diffuse_light(settings),
        cache=_cache_plan(settings, flat.camera),
        routing=settings.routing,
    )


def _bucket(flat: FlatScene, settings: RenderSettings, least: int) -> int:
    """Side of a bucket [pixels]: the paper's 32, or doubled while that leaves at least so many of them.

    What the interpreter does for a bucket it does once, however many samples there are; kernels take what they take.
    """
    shadow_rays = -(-settings.spp // settings.passes) * light_samples_of(flat, settings)
    pixels = flat.camera.width * flat.camera.height
    side = BUCKET_LEAST
    while side < BUCKET_MOST:
        larger = 2 * side
        if larger * larger * shadow_rays > BUCKET_SHADOW_RAYS:
            break
        if pixels < least * larger * larger:
            break
        side = larger
    return side


def _cache_plan(settings: RenderSettings, camera: Camera) -> CachePlan:
    if not settings.algorithm.has_irradiance_cache(settings):
        return NO_CACHE
    side = max(camera.width, camera.height)
    least = min(CACHE_PLAN.least, max(1.0, RECORD_LEAST * side))
    return replace(CACHE_PLAN, least=least, most=max(least, RECORD_REACH * side))
